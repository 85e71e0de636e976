// Holds a page against axe-core's rules of accessibility: WCAG 2.2 A and AA, and its good practice.
//
//     node tests/web/axe.mjs NODE_MODULES CHROMIUM ADDRESS
//
// Prints JSON: for a desktop and a phone, the rules that the page breaks, each with the elements that break it.

import { createRequire } from "node:module";
import { join } from "node:path";
import { launch, LIMIT_MS } from "./browser.mjs";

const [modules, chromium, address] = process.argv.slice(2);
const require = createRequire(import.meta.url);
const axe = require.resolve(join(modules, "axe-core/axe.min.js"));
const TAGS = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"];
const SCREENS = {
  desktop: { viewport: { width: 1360, height: 900 }, colorScheme: "light" },
  phone: { viewport: { width: 390, height: 844 }, colorScheme: "dark", isMobile: true, hasTouch: true },
};

const browser = await launch(modules, chromium);
const said = {};
for (const [name, screen] of Object.entries(SCREENS)) {
  // The page's own policy forbids scripts of others.
  const context = await browser.newContext({ ...screen, bypassCSP: true });
  const page = await context.newPage();
  page.setDefaultTimeout(LIMIT_MS);
  await page.goto(address);
  await page.waitForTimeout(2000);
  // With a building picked, a page has the most on it.
  const first = page.locator("#buildings td a").first();
  if ((await first.count()) > 0) { await first.click(); await page.waitForTimeout(1000); }
  await page.addScriptTag({ path: axe });
  const { violations, passes } = await page.evaluate((tags) => window.axe.run(document, { runOnly: tags }), TAGS);
  said[name] = { broken: violations.map(({ id, nodes }) => ({ rule: id, elements: nodes.map(({ html }) => html.slice(0, 160)) })), kept: passes.length };
}
await browser.close();
process.stdout.write(`${JSON.stringify(said, null, 1)}\n`);
