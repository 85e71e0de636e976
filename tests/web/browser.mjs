// The browser of all scripts here.

import { createRequire } from "node:module";
import { join } from "node:path";

export const LIMIT_MS = 120_000;

// A browser at `chromium`, led by playwright-core of the folder `modules`.
export async function launch(modules, chromium) {
  const { chromium: engine } = createRequire(import.meta.url)(join(modules, "playwright-core"));
  const args = ["--enable-unsafe-swiftshader", "--no-sandbox", "--disable-dev-shm-usage"];
  return engine.launch({ executablePath: chromium, args, timeout: LIMIT_MS });
}

// A page of it whose errors are added to `errors`.
export async function watchedPage(browser, errors) {
  const page = await browser.newPage({ viewport: { width: 1200, height: 800 } });
  page.setDefaultTimeout(LIMIT_MS);
  page.on("console", (message) => { if (message.type() === "error") errors.push(message.text()); });
  page.on("pageerror", (error) => errors.push(String(error)));
  return page;
}
