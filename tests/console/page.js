// A page of the console in a real browser, and functions to query it.

import assert from "node:assert/strict";
import { join } from "node:path";

import { BROWSER, installed, OUT } from "./place.js";

const { chromium } = installed("playwright-core");
const axe = installed("axe-core");

/// A desktop screen, and a tablet in landscape and portrait.
export const SIZES = {
  desk: { width: 1280, height: 800 },
  lying: { width: 1024, height: 768 },
  upright: { width: 820, height: 1180 },
};

/// Time limit of waiting, ms: it ends a test that hangs, also on a machine that is busy.
export const PATIENCE = 180_000;

// Root has no sandbox; only our own pages are opened.
const SANDBOX = process.getuid?.() === 0 ? ["--no-sandbox"] : [];
// WebGL without a graphics processor: slow, with the same results.
const SOFTWARE = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"];
const browsers = {};
const launch = (graphics) => (browsers[graphics] ??= chromium.launch({ executablePath: BROWSER, args: [...SANDBOX, ...(graphics ? SOFTWARE : [])] }));

/// Closes the browsers.
export const quit = async () => Promise.all(Object.values(browsers).map(async (browser) => (await browser).close()));

/// Closes contexts left open by failed tests.
export const closeAll = async () => {
  for (const browser of Object.values(browsers)) await Promise.all((await browser).contexts().map((context) => context.close()));
};

/// Opens the page at this address. `complaints` collects the browser's errors and warnings;
/// `binary` counts the received pictures. `through(socket)`, if given, intercepts the page's
/// connection; it receives playwright's WebSocketRoute. `graphics` is for a browser with WebGL.
export async function open(address, { size = SIZES.desk, through, graphics = false, ...settings } = {}) {
  const context = await (await launch(graphics)).newContext({ viewport: size, ...settings });
  context.setDefaultTimeout(PATIENCE);
  const page = await context.newPage();
  if (through) await page.routeWebSocket(/\/v1\/stream$/, through);
  const seen = { page, complaints: [], requests: [], binary: 0 };
  page.on("console", (message) => {
    if (["error", "warning"].includes(message.type())) seen.complaints.push(message.text());
  });
  page.on("pageerror", (error) => seen.complaints.push(error.message));
  page.on("request", (request) => seen.requests.push(request.url()));
  page.on("websocket", (socket) =>
    socket.on("framereceived", ({ payload }) => {
      if (typeof payload !== "string") seen.binary += 1;
    }),
  );
  await page.goto(address);
  return seen;
}

/// Closes a page and its context.
export const close = ({ page }) => page.context().close();

/// Returns the page's measurements (`window.sonoweave`).
export const measured = (page) => page.evaluate(() => window.sonoweave);

/// Waits until this page has control, or has not.
export const steers = (page, whether) =>
  page.waitForFunction((whether) => window.sonoweave.control === whether, whether);

/// Records the page's commands from now on, except acknowledgements. The returned function
/// gives them.
export async function listen(page) {
  await page.evaluate(() => {
    window.wishes = [];
    const send = WebSocket.prototype.send;
    WebSocket.prototype.send = function (text) {
      const wish = JSON.parse(text);
      if (wish.do !== "shown") window.wishes.push(wish);
      send.call(this, text);
    };
  });
  // Commands wait for the screen's next frame.
  return () => page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => resolve(window.wishes.splice(0))))));
}

/// Waits until this many more pictures of this name (`slice`, `view`) were drawn.
export async function drawn(page, name, more = 1) {
  const before = (await measured(page)).pictures[name].drawn;
  await page.waitForFunction(([name, n]) => window.sonoweave.pictures[name].drawn >= n, [name, before + more]);
}

/// Waits until the finest view of the volume is shown, or until the requested view has been
/// shown for a while.
export async function settled(page) {
  await drawn(page, "view", 2);
  const finest = () => !window.sonoweave.pictures.view.refining;
  await page.waitForFunction(finest, null, { timeout: 1500, polling: "raf" }).catch(() => {});
}

/// Returns a canvas' grey values, reduced to 96 pixels width for quick comparison: `{ width,
/// height, grey }`.
export function greys(page, id) {
  return page.evaluate((id) => {
    const from = document.getElementById(id);
    const width = 96;
    const height = Math.round((width * from.height) / from.width);
    const to = Object.assign(document.createElement("canvas"), { width, height }).getContext("2d");
    to.drawImage(from, 0, 0, width, height);
    const { data } = to.getImageData(0, 0, width, height);
    const grey = Array.from({ length: width * height }, (_, n) => Math.round((data[4 * n] + data[4 * n + 1] + data[4 * n + 2]) / 3));
    return { width, height, grey };
  }, id);
}

/// Returns the mean difference of two such images, of 255.
export function difference(a, b) {
  return a.grey.reduce((sum, grey, n) => sum + Math.abs(grey - b.grey[n]), 0) / a.grey.length;
}

/// Returns the part that differs from the background, which is that of the corners: its
/// fraction of the area, and its middle in fractions of width and height.
export function body({ width, height, grey }) {
  const corners = [0, width - 1, width * (height - 1), width * height - 1].map((n) => grey[n]).sort((a, b) => a - b);
  const ground = corners[1];
  let [n, x, y] = [0, 0, 0];
  grey.forEach((value, at) => {
    if (Math.abs(value - ground) < 20) return;
    n += 1;
    x += at % width;
    y += Math.floor(at / width);
  });
  return { share: n / grey.length, x: x / Math.max(1, n) / width, y: y / Math.max(1, n) / height };
}

/// Returns the first and worst sentence of the banner.
export const banner = (page) => page.locator("#banner p").first().innerText();

/// Waits until the banner says this.
export const says = (page, words) => page.locator("#banner", { hasText: words }).waitFor();

/// Makes the page believe that its window is covered (`hidden`) or uncovered (`visible`).
export const look = (page, state) =>
  page.evaluate((state) => {
    Object.defineProperty(document, "visibilityState", { value: state, configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
  }, state);

/// Takes a screenshot, for people.
export const shot = (page, name) => page.screenshot({ path: join(OUT, `${name}.png`) });

/// Returns axe-core's findings, one per line.
export async function audit(page) {
  // The page's policy refuses foreign scripts; the browser's own interface does not.
  await page.evaluate(axe.source);
  const { violations, passes } = await page.evaluate(() => axe.run());
  assert.ok(passes.length > 10, "it looked");
  return violations.map(({ impact, id, nodes }) => `${impact} ${id}: ${nodes.map(({ html }) => html).join(" | ")}`);
}
