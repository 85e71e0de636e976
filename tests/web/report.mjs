// Opens a report in a real browser, uses it, and says what happened.
//
//     node tests/web/report.mjs NODE_MODULES CHROMIUM ADDRESS OUT_FOLDER BUILDING_ID
//     node tests/web/report.mjs NODE_MODULES CHROMIUM ADDRESS OUT_FOLDER --frames
//
// Prints JSON: what was asked for beyond the page itself, errors on its console, what the picture is made of, and what
// picking the building by the picture, the map and a link says. Leaves screenshots of a desktop and of a phone. With
// --frames: seconds until the page is ready, and frames per second while the city turns.

import { createRequire } from "node:module";
import { join } from "node:path";

const [modules, chromium, address, out, id] = process.argv.slice(2);
const { chromium: engine } = createRequire(import.meta.url)(join(modules, "playwright-core"));
const LIMIT_MS = 120_000;
const FLAGS = ["--enable-unsafe-swiftshader", "--no-sandbox", "--disable-dev-shm-usage"];

const browser = await engine.launch({ executablePath: chromium, args: FLAGS, timeout: LIMIT_MS });
const said = { requests: [], errors: [] };

async function open(options) {
  const context = await browser.newContext(options);
  const page = await context.newPage();
  page.setDefaultTimeout(LIMIT_MS);
  page.on("console", (message) => {
    // Drivers remark that reading a pixel takes time: that is how a building is picked.
    const isRemark = message.text().includes("GL Driver Message");
    if (["error", "warning"].includes(message.type()) && !isRemark) said.errors.push(message.text());
  });
  page.on("pageerror", (error) => said.errors.push(String(error)));
  page.on("dialog", (dialog) => { said.errors.push(`dialog: ${dialog.message()}`); dialog.dismiss(); });
  page.on("request", (request) => {
    const url = request.url();
    if (url !== address && !url.startsWith("data:") && !url.startsWith("blob:")) said.requests.push(url);
  });
  await page.goto(address);
  await page.waitForSelector("#reset", { state: "attached" });
  await page.waitForTimeout(500);
  return page;
}

// Different colours in the 3D picture, in steps that even out smoothing.
const coloursOf = (page) => page.evaluate(() => {
  const canvas = document.getElementById("scene");
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const context = copy.getContext("2d");
  context.drawImage(canvas, 0, 0);
  const { data } = context.getImageData(0, 0, copy.width, copy.height);
  const found = new Set();
  for (let i = 0; i < data.length; i += 4) found.add((data[i] >> 4) * 256 + (data[i + 1] >> 4) * 16 + (data[i + 2] >> 4));
  return found.size;
});
const picked = (page) => page.evaluate(() => ({
  id: document.getElementById("picked-id")?.textContent ?? null,
  height: document.getElementById("picked-height")?.textContent ?? null,
}));
const picture = (page) => page.evaluate(() => document.getElementById("scene").toDataURL());

if (id === "--frames") {
  const began = Date.now();
  const wide = await open({ viewport: { width: 1360, height: 900 } });
  said.secondsToOpen = (Date.now() - began) / 1000;
  said.sharp = await wide.evaluate(() => window.sizeup.framesPerSecond(30));
  said.coarse = await wide.evaluate(() => window.sizeup.framesPerSecond(30, 0.4));
  await wide.screenshot({ path: join(out, "large.png") });
  const small = await open({ viewport: { width: 390, height: 844 } });
  said.phone = await small.evaluate(() => window.sizeup.framesPerSecond(30));
  await browser.close();
  process.stdout.write(`${JSON.stringify(said, null, 1)}\n`);
  process.exit(0);
}

const page = await open({ viewport: { width: 1360, height: 900 }, colorScheme: "light" });
said.colours = await coloursOf(page);
said.placeholders = await page.evaluate(() => document.documentElement.outerHTML.includes("{{style}}"));
{
  // The box of choices lies over the picture.
  await page.click("#controls summary");
  const at = async (selector, [x, y]) => {
    const element = page.locator(selector);
    await element.scrollIntoViewIfNeeded();
    const box = await element.boundingBox();
    await page.mouse.click(box.x + x, box.y + y);
    await page.waitForTimeout(300);
  };
  await at("#scene", await page.evaluate((b) => window.sizeup.placeOf(b), id));
  said.pickedInScene = await picked(page);
  await page.keyboard.press("Escape");
  said.pickedByEscape = await picked(page);
  await at("#plan", await page.evaluate((b) => window.sizeup.placeOnMap(b), id));
  said.pickedOnMap = await picked(page);
  // A link of the list of issues, else of the list of buildings.
  const issue = page.locator("#issues a").first();
  const link = (await issue.count()) > 0 ? issue : page.locator("#buildings td a").first();
  said.linked = await link.textContent();
  await link.click();
  await page.waitForTimeout(900);
  said.pickedByLink = await picked(page);
  said.address = await page.evaluate(() => decodeURIComponent(location.hash));
  await page.screenshot({ path: join(out, "desktop.png") });
  await page.locator("#picked").evaluate((box) => { box.style.maxHeight = "none"; box.style.overflow = "visible"; });
  await page.locator("#picked").screenshot({ path: join(out, "picked.png") });
  said.crops = await page.locator("#crops img").count();
  said.broken = await page.evaluate(() => [...document.images].filter((i) => i.complete && i.naturalWidth === 0).length);
}
// Every layer changes the picture, with everything in sight.
await page.click("#controls summary");
await page.click("#reset");
await page.waitForTimeout(800);
await page.locator("#scene").focus();
for (let i = 0; i < 8; i += 1) await page.keyboard.press("-");
await page.waitForTimeout(600);
said.layers = {};
for (const box of await page.locator("#controls input").all()) {
  const before = await picture(page);
  await box.click();
  await page.waitForTimeout(250);
  said.layers[await box.getAttribute("id")] = (await picture(page)) !== before;
  await box.click();
  await page.waitForTimeout(250);
}
const before = await picture(page);
await page.selectOption("#colour", "status");
await page.waitForTimeout(250);
said.recolours = (await picture(page)) !== before;
await page.selectOption("#colour", "height");
await page.screenshot({ path: join(out, "page.png"), fullPage: true });

const phone = await open({ viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true, colorScheme: "dark" });
said.phoneColours = await coloursOf(phone);
// Nothing sticks out sideways.
said.overflow = await phone.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
await phone.screenshot({ path: join(out, "phone.png") });
await browser.close();
process.stdout.write(`${JSON.stringify(said, null, 1)}\n`);
