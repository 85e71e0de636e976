// Opens the report or `sizeup view` of a textured city in a real browser, and looks at it with textures, heights and status.
//
//     node tests/web/textures.mjs NODE_MODULES CHROMIUM ADDRESS FOLDER
//
// Prints JSON: errors, the ways to colour, and which is chosen first. The pictures are FOLDER/WAY.png.

import { createRequire } from "node:module";
import { join } from "node:path";

const [modules, chromium, address, folder] = process.argv.slice(2);
const { chromium: engine } = createRequire(import.meta.url)(join(modules, "playwright-core"));
const LIMIT_MS = 120_000;

const browser = await engine.launch({ executablePath: chromium, timeout: LIMIT_MS,
  args: ["--enable-unsafe-swiftshader", "--no-sandbox", "--disable-dev-shm-usage"] });
const page = await browser.newPage({ viewport: { width: 1200, height: 800 } });
page.setDefaultTimeout(LIMIT_MS);
const said = { errors: [] };
page.on("console", (message) => { if (message.type() === "error") said.errors.push(message.text()); });
page.on("pageerror", (error) => said.errors.push(String(error)));
await page.goto(address);
await page.waitForFunction(() => window.sizeup?.showsPhotos());
said.first = await page.inputValue("#colour");
said.ways = await page.evaluate(() => [...document.querySelectorAll("#colour option")].map((option) => option.value));
for (const way of ["textures", "height", "status"]) {
  await page.selectOption("#colour", way);
  await page.waitForTimeout(500);
  await page.locator("#scene").screenshot({ path: join(folder, `${way}.png`) });
}
await browser.close();
process.stdout.write(`${JSON.stringify(said, null, 1)}\n`);
