// Opens the report or `sizeup view` of a textured city in a real browser, and looks at it with textures, heights and status.
//
//     node tests/web/textures.mjs NODE_MODULES CHROMIUM ADDRESS FOLDER
//
// Prints JSON: errors, the ways to colour, which is chosen first, how far the city reaches, and which grounds are hidden. The pictures are FOLDER/WAY.png.

import { join } from "node:path";
import { launch, watchedPage } from "./browser.mjs";

const [modules, chromium, address, folder] = process.argv.slice(2);

const browser = await launch(modules, chromium);
const said = { errors: [] };
const page = await watchedPage(browser, said.errors);
await page.goto(address);
await page.waitForFunction(() => window.sizeup?.showsPhotos());
said.first = await page.inputValue("#colour");
// How far a streamed city's box reaches from the middle of the picture at first, shares of half its width and height.
said.reach = await page.evaluate(() => {
  const { scene, tileset } = window.sizeup;
  if (!tileset) return null;
  const { box } = tileset.root.json.boundingVolume;
  const m = scene.clipFromLocal();
  const corners = Array.from({ length: 8 }, (_, i) => [0, 1, 2].map((axis) => box[axis] + ((i >> axis) % 2 === 0 ? -1 : 1) * box[3 + 4 * axis]));
  const row = (p, k) => m[k] * p[0] + m[4 + k] * p[1] + m[8 + k] * p[2] + m[12 + k];
  return [0, 1].map((k) => Math.max(...corners.map((p) => Math.abs(row(p, k) / row(p, 3)))));
});
// Which grounds of a streamed city are hidden, those that are not first.
said.grounds = await page.evaluate(() => [...(window.sizeup.scene?.photoChunks ?? [])].map(({ isHidden }) => Boolean(isHidden)).sort());
said.ways = await page.evaluate(() => [...document.querySelectorAll("#colour option")].map((option) => option.value));
for (const way of ["textures", "height", "status"]) {
  await page.selectOption("#colour", way);
  await page.waitForTimeout(500);
  await page.locator("#scene").screenshot({ path: join(folder, `${way}.png`) });
}
await browser.close();
process.stdout.write(`${JSON.stringify(said, null, 1)}\n`);
