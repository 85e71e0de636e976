// Opens `sizeup view` in a real browser and says what happened.
//
//     node tests/web/view.mjs NODE_MODULES CHROMIUM ADDRESS picture.png
//
// Prints JSON: requests that left the server, errors, how many tiles and buildings were loaded before and after coming
// closer, and what is picked in the middle of the picture, or closest to it.

import { launch, watchedPage } from "./browser.mjs";

const [modules, chromium, address, picture] = process.argv.slice(2);

const browser = await launch(modules, chromium);
const said = { elsewhere: [], errors: [] };
const page = await watchedPage(browser, said.errors);
page.on("request", (request) => { if (!request.url().startsWith(address) && !request.url().startsWith("data:")) said.elsewhere.push(request.url()); });
await page.goto(address);
await page.waitForSelector("#reset", { state: "attached" });

async function settle() {
  let [before, now] = [-1, 0];
  while (before !== now) {
    before = now;
    await page.waitForTimeout(700);
    now = await page.evaluate(() => (window.sizeup.tileset.isIdle() ? window.sizeup.tileset.nLoaded : -2));
  }
  return page.evaluate(() => ({ tiles: window.sizeup.tileset.nLoaded, buildings: window.sizeup.tileset.features.length }));
}

said.far = await settle();
await page.locator("#scene").focus();
for (let i = 0; i < 14; i += 1) await page.keyboard.press("+");
said.near = await settle();
// Where a building is, from the middle outwards.
const at = await page.evaluate(() => {
  for (let r = 0; r < 390; r += 4) {
    for (let a = 0; a < 6.3; a += 4 / Math.max(r, 4)) {
      const place = [600 + r * Math.cos(a), 400 + r * Math.sin(a)];
      if (window.sizeup.scene.pick(...place) >= 0) return place;
    }
  }
  return null;
});
if (at) {
  await page.mouse.click(...at);
  said.picked = await page.evaluate(() => ({ id: document.getElementById("picked-id").textContent, height: document.getElementById("picked-height").textContent }));
}
await page.screenshot({ path: picture });
await browser.close();
process.stdout.write(`${JSON.stringify(said, null, 1)}\n`);
