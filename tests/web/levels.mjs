// Opens `sizeup view` of a textured city in a real browser, and goes away from it and comes closer.
//
//     node tests/web/levels.mjs NODE_MODULES CHROMIUM ADDRESS
//
// Prints JSON: errors, and for each place the tiles of buildings that are drawn and how many buildings there are.

import { launch, watchedPage } from "./browser.mjs";

const [modules, chromium, address] = process.argv.slice(2);

const browser = await launch(modules, chromium);
const said = { errors: [] };
const page = await watchedPage(browser, said.errors);
await page.goto(address);
await page.waitForFunction(() => window.sizeup?.showsPhotos());

async function at(distance) {
  await page.evaluate((metres) => { window.sizeup.scene.camera.distance = metres; window.sizeup.scene.redraw(); }, distance);
  await page.waitForTimeout(500);
  await page.waitForFunction(() => window.sizeup.showsPhotos());
  await page.waitForTimeout(500);
  return page.evaluate(() => {
    const { scene, tileset } = window.sizeup;
    const isDrawn = ({ chunk }) => chunk && !chunk.isHidden && scene.chunks.has(chunk);
    const name = (tile) => tile.content.uri.replace("tiles/", "").replace(".glb", "");
    return { drawn: tileset.tiles.filter(isDrawn).map(name).sort(), buildings: tileset.features.length };
  });
}

said.far = await at(2000);
said.near = await at(60);
said.again = await at(2000);
await browser.close();
process.stdout.write(`${JSON.stringify(said, null, 1)}\n`);
