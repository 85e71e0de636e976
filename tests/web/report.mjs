// Opens a report in a real browser, uses it, and says what happened.
//
//     node tests/web/report.mjs NODE_MODULES CHROMIUM ADDRESS OUT_FOLDER BUILDING_ID [--picks]
//     node tests/web/report.mjs NODE_MODULES CHROMIUM ADDRESS OUT_FOLDER --frames
//
// Prints JSON: what was asked for beyond the page itself, errors on its console, what the picture is made of, the colours
// in the middle of buildings on the map, whether the photos under it can be hidden, and what picking the building by the picture, the map and a link says. Leaves screenshots of a desktop and of a phone, and the
// page as it is printed. With --picks: picking and the map only, without layers, paper and a phone. With --frames: seconds until the page is ready, and for pictures at rest, for simple ones and
// for a city that turns: frames per second, and milliseconds of processor time that the browser spends on each.

import { join } from "node:path";
import { launch, LIMIT_MS } from "./browser.mjs";
import { browserSeconds } from "./cpu.mjs";

const [modules, chromium, address, out, id, picksOnly] = process.argv.slice(2);

const browser = await launch(modules, chromium);
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
// Colours in the middle of buildings on the map.
const coloursOnMap = (page) => page.locator("#plan").evaluate((canvas) => {
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const density = canvas.width / canvas.clientWidth;
  const at = (id) => window.sizeup.placeOnMap(id).map((v) => Math.round(v * density));
  const places = window.sizeup.data.buildings.slice(0, 100).map((b) => [b.id, at(b.id)]);
  const known = places.filter(([, place]) => place.every(Number.isFinite));
  return Object.fromEntries(known.map(([id, [x, y]]) => [id, [...data.slice(4 * (y * canvas.width + x), 4 * (y * canvas.width + x) + 3)]]));
});
const picture = (page) => page.evaluate(() => document.getElementById("scene").toDataURL());

if (id === "--frames") {
  const began = Date.now();
  const wide = await open({ viewport: { width: 1360, height: 900 } });
  said.open = { seconds: (Date.now() - began) / 1000, cpuSeconds: browserSeconds() };
  const measure = async (page, seconds, act) => {
    const before = browserSeconds();
    const { framesPerSecond, ...more } = await page.evaluate(act, seconds);
    const used = browserSeconds() - before;
    await page.waitForTimeout(1500);
    return { framesPerSecond, cpuMsPerFrame: (1000 * used) / (framesPerSecond * seconds), ...more };
  };
  const held = (effort) => `((seconds) => { const n = 20; const framesPerSecond = window.sizeup.framesPerSecond(n, ${effort}); return { framesPerSecond, n }; })(0)`;
  const steady = async (effort) => {
    const before = browserSeconds();
    const { framesPerSecond, n } = await wide.evaluate(held(effort));
    return { framesPerSecond, cpuMsPerFrame: (1000 * (browserSeconds() - before)) / (n + 1) };
  };
  said.atRest = await steady(1);
  said.simple = await steady(0.6);
  said.coarse = await steady(0.35);
  await wide.waitForTimeout(1500);
  // The first movement learns how slow the machine is.
  await measure(wide, 3, (seconds) => window.sizeup.turn(seconds));
  said.turning = await measure(wide, 5, (seconds) => window.sizeup.turn(seconds));
  await wide.screenshot({ path: join(out, "large.png") });
  const small = await open({ viewport: { width: 390, height: 844 } });
  await measure(small, 3, (seconds) => window.sizeup.turn(seconds));
  said.phone = await measure(small, 5, (seconds) => window.sizeup.turn(seconds));
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
  // The browser tells the page of its new address when it comes to it; that it never does shows below.
  const shows = (id) => document.getElementById("picked-id")?.textContent === id;
  await page.waitForFunction(shows, said.linked, { timeout: 10000 }).catch(() => {});
  await page.waitForFunction(() => !window.sizeup.isFlying());
  said.pickedByLink = await picked(page);
  said.shownByLink = await page.evaluate((b) => window.sizeup.shows(b), said.linked);
  said.whole = await page.evaluate(() => document.getElementById("whole")?.textContent ?? null);
  said.charts = await page.locator("#picked figcaption").allTextContents();
  said.address = await page.evaluate(() => decodeURIComponent(location.hash));
  await page.screenshot({ path: join(out, "desktop.png") });
  await page.locator("#picked").evaluate((box) => { box.style.maxHeight = "none"; box.style.overflow = "visible"; });
  await page.locator("#picked").screenshot({ path: join(out, "picked.png") });
  said.crops = await page.locator("#crops img").count();
  said.broken = await page.evaluate(() => [...document.images].filter((i) => i.complete && i.naturalWidth === 0).length);
}
if (picksOnly === "--picks") {
  said.onMap = await coloursOnMap(page);
  await browser.close();
  process.stdout.write(`${JSON.stringify(said, null, 1)}\n`);
  process.exit(0);
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
// The map, with the photos under it and without.
const plan = page.locator("#plan");
const hasBackdrop = (await page.locator("#show-backdrop").count()) > 0;
if (hasBackdrop) {
  await page.waitForFunction(() => window.sizeup.hasBackdrop());
  await page.waitForTimeout(250);
  await plan.screenshot({ path: join(out, "map-photo.png") });
  const shown = await plan.evaluate((canvas) => canvas.toDataURL());
  await page.click("#show-backdrop");
  await page.waitForTimeout(250);
  said.backdrop = (await plan.evaluate((canvas) => canvas.toDataURL())) !== shown;
}
await plan.screenshot({ path: join(out, "map.png") });
said.onMap = await coloursOnMap(page);
if (hasBackdrop) await page.click("#show-backdrop");
await page.screenshot({ path: join(out, "page.png"), fullPage: true });
await page.pdf({ path: join(out, "page.pdf"), format: "A4" });
await page.emulateMedia({ media: "print" });
await page.setViewportSize({ width: 780, height: 1100 });
await page.screenshot({ path: join(out, "print.png"), fullPage: true });

const phone = await open({ viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true, colorScheme: "dark" });
said.phoneColours = await coloursOf(phone);
// Nothing sticks out sideways.
said.overflow = await phone.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
await phone.screenshot({ path: join(out, "phone.png") });
await browser.close();
process.stdout.write(`${JSON.stringify(said, null, 1)}\n`);
