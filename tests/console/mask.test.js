// The mask on the page: its shapes and handles, tested without a browser, and its card and outline
// on the live picture: found and confirmed, dragged as a rectangle and as a fan, and taken back.

import assert from "node:assert/strict";
import { cpSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { pathToFileURL } from "node:url";

import { audit, banner, open, says, shot, steers } from "./page.js";
import { OUT, PAGE } from "./place.js";
import { Session } from "./session.js";

cpSync(PAGE, join(OUT, "page"), { recursive: true });
const { apart, first, handles, kind, moved, outline } = await import(pathToFileURL(join(OUT, "page", "mask_shape.js")).href);

const button = (page, name) => page.getByRole("button", { name, exact: true });
const until = (page, is, ...with_) => page.waitForFunction(is, with_);
const SIZE = [640, 480];
const RECTANGLE = { rectangle: { x: 100, y: 50, width: 400, height: 300 } };
const FAN = { fan: { origin_px: [320, -40], radii_px: [100, 400], angles_deg: [-30, 30] } };

test("a handle moves its own edge, and no edge passes another or leaves the frame", () => {
  assert.deepEqual(moved(RECTANGLE, "left", [-20.4, 99], SIZE).rectangle, { x: 80, y: 50, width: 420, height: 300 });
  assert.deepEqual(moved(RECTANGLE, "left", [900, 0], SIZE).rectangle, { x: 492, y: 50, width: 8, height: 300 });
  assert.deepEqual(moved(RECTANGLE, "right", [900, 0], SIZE).rectangle, { x: 100, y: 50, width: 540, height: 300 });
  assert.deepEqual(moved(RECTANGLE, "top", [0, -900], SIZE).rectangle, { x: 100, y: 0, width: 400, height: 350 });
  assert.deepEqual(moved(RECTANGLE, "bottom", [0, 10], SIZE).rectangle, { x: 100, y: 50, width: 400, height: 310 });
  assert.deepEqual(moved(FAN, "apex", [3, -4], SIZE).fan.origin_px, [323, -44]);
  assert.deepEqual(moved(FAN, "inner", [50, 12.5], SIZE).fan.radii_px, [112.5, 400], "only along the beam");
  assert.deepEqual(moved(FAN, "inner", [0, 900], SIZE).fan.radii_px, [392, 400]);
  assert.deepEqual(moved(FAN, "outer", [0, -900], SIZE).fan.radii_px, [100, 108]);
  assert.ok(moved(FAN, "first", [-20, 0], SIZE).fan.angles_deg[0] < -30);
  assert.equal(moved(FAN, "last", [-400, 0], SIZE).fan.angles_deg[1], -28, "two degrees beside the other edge");
  assert.deepEqual(FAN.fan.radii_px, [100, 400], "the shape before stays");
});

test("outlines and handles lie on the edges", () => {
  assert.deepEqual(outline(RECTANGLE)[0], [99.5, 49.5]);
  const far = outline(FAN).map(([u, v]) => Math.hypot(u - 320, v + 40));
  assert.ok(far.every((away) => Math.abs(away - 100) < 1e-9 || Math.abs(away - 400) < 1e-9));
  assert.deepEqual([outline("whole"), handles("outline"), kind("whole")], [[], [], null]);
  assert.deepEqual([RECTANGLE, FAN].map((shape) => handles(shape).length), [4, 5]);
  assert.deepEqual(first("rectangle", SIZE).rectangle, { x: 0, y: 0, width: 640, height: 480 });
  assert.equal(kind(first("fan", SIZE)), "fan");
});

test("handles lie within the picture and apart, those beyond it beside the others", () => {
  const size = [300, 200];
  assert.deepEqual(apart([[150, 90], [10, 190]], size, 10), [[150, 90], [10, 190]]);
  assert.deepEqual(apart([[150, -60], [150, 20], [150, 250]], size, 10), [[174, 10], [150, 20], [150, 190]]);
  const crowd = apart(Array(5).fill([299, 199]), size, 10);
  crowd.forEach(([x, y], n) => {
    assert.ok(x >= 10 && x <= 290 && y === 190);
    crowd.slice(n + 1).forEach(([u]) => assert.ok(Math.abs(x - u) > 20, JSON.stringify(crowd)));
  });
});

// A session that looks for its mask, on a page that shows its card, once it is found.
async function found() {
  const session = await Session.searching();
  const { page, complaints } = await open(session.address);
  await steers(page, true);
  await until(page, () => window.sonoweave.account?.mask?.origin === "found" && window.sonoweave.account.desk.phase === "running");
  await page.locator("#mask-vital").click();
  await until(page, () => window.sonoweave.mask.mask?.origin === "found");
  const { mask } = await page.evaluate(() => window.sonoweave.mask);
  return { session, page, complaints, mask };
}

test("the mask that was found is shown, and confirmed by its button", async () => {
  const { session, page, complaints, mask } = await found();
  const { origin_px: [u, v], radii_px: [near, far], angles_deg: angles } = mask.shape.fan;
  assert.equal(mask.sure, true, mask.says);
  assert.ok(Math.abs(u - 159.5) < 2 && v < 0 && near > 90 && far < 330 && angles[0] < -25 && angles[1] > 25, mask.says);
  assert.equal(await page.locator("#mask-vital").innerText(), "Mask: found in the first frames; please confirm");
  assert.equal(await page.locator("#mask-says").innerText(), mask.says);
  // The outline lies on the fan's edges, wherever the page shows the picture.
  const drawn = await page.evaluate(() => {
    const { offsetWidth, offsetHeight } = document.getElementById("slice");
    const points = document.querySelector("#mask-outline polygon").getAttribute("points").split(" ");
    return { size: [offsetWidth, offsetHeight], points: points.map((point) => point.split(",").map(Number)) };
  });
  const scale = drawn.size.map((length, axis) => length / mask.size_px[axis]);
  const wanted = outline(mask.shape).map((point) => point.map((x, axis) => (x + 0.5) * scale[axis]));
  assert.equal(drawn.points.length, wanted.length);
  drawn.points.forEach((point, n) => point.forEach((x, axis) => assert.ok(Math.abs(x - wanted[n][axis]) <= 0.06, `${point} for ${wanted[n]}`)));
  await shot(page, "mask-found");
  assert.deepEqual(await audit(page), []);
  await button(page, "Confirm").click();
  await until(page, () => window.sonoweave.account.mask.origin === "confirmed");
  await page.locator("#mask-confirm").waitFor({ state: "hidden" });
  const { mask: confirmed } = await page.evaluate(() => window.sonoweave.account);
  assert.deepEqual(confirmed.shape, mask.shape);
  assert.equal(await page.locator("#mask-vital").innerText(), "Mask: confirmed");
  assert.deepEqual(complaints, []);
  await session.end();
});

test("a fan that was found is dragged by its near arc, and used", async () => {
  const { session, page, complaints, mask } = await found();
  const { fan } = mask.shape;
  await button(page, "Adjust").click();
  assert.equal(await page.locator("#mask-kind").inputValue(), "fan");
  const arc = page.getByRole("slider", { name: "Near arc" });
  await arc.waitFor();
  const { x, y, width, height } = await arc.boundingBox();
  await page.mouse.move(x + width / 2, y + height / 2);
  await page.mouse.down();
  await page.mouse.move(x + width / 2, y + height / 2 + 30, { steps: 4 });
  await page.mouse.up();
  const { draft } = await page.evaluate(() => window.sonoweave.mask);
  const scale = (await page.evaluate(() => document.getElementById("slice").offsetHeight)) / mask.size_px[1];
  assert.ok(Math.abs(draft.fan.radii_px[0] - fan.radii_px[0] - 30 / scale) < 0.5, JSON.stringify([fan, draft, scale]));
  assert.deepEqual({ ...draft.fan, radii_px: null }, { ...fan, radii_px: null }, "only the arc has moved");
  assert.equal(draft.fan.radii_px[1], fan.radii_px[1]);
  await shot(page, "mask-fan");
  await button(page, "Use this").click();
  await until(page, ([near]) => window.sonoweave.account.mask.origin === "operator" && window.sonoweave.account.mask.shape.fan?.radii_px[0] === near, draft.fan.radii_px[0]);
  assert.match(await page.locator("#mask-config").innerText(), /^clip_px = "none"\nfan = \{ origin_px = /);
  assert.deepEqual(complaints, []);
  await session.end();
});

// Names of handles, and the element that a pointer meets at the middle of each.
async function met(page) {
  await page.locator("#slice-room").scrollIntoViewIfNeeded();
  // The picture has its final size two frames after the card has left it.
  await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
  return page.evaluate(() =>
    [...document.querySelectorAll("#mask-outline circle")].map((circle) => {
      const { x, y, width, height } = circle.getBoundingClientRect();
      const at = document.elementFromPoint(x + width / 2, y + height / 2);
      return [circle.dataset.handle, at?.dataset?.handle ?? at?.id ?? String(at)];
    }),
  );
}

test("each handle of a fan and a rectangle is reached by a pointer, on every screen", async () => {
  const { session, page, complaints } = await found();
  const screens = [
    [1280, 800],
    [1920, 1080],
    [390, 844],
  ];
  for (const [width, height] of screens) {
    await page.setViewportSize({ width, height });
    await button(page, "Adjust").click();
    // The fan that was found, and the shapes that the choice begins with.
    for (const [kind, count] of [["found", 5], ["rectangle", 4], ["fan", 5]]) {
      if (kind !== "found") await page.locator("#mask-kind").selectOption(kind);
      const reached = await met(page);
      await shot(page, `mask-${kind}-${width}`);
      assert.equal(reached.length, count);
      for (const [name, at] of reached) assert.equal(at, name, `${kind} at ${width}×${height}`);
    }
    await button(page, "Adjust").click();
    assert.equal(await page.locator("#mask-says").isVisible(), true);
  }
  assert.deepEqual(complaints, []);
  await session.end();
});

test("the mask is shown on the picture, dragged, used, and taken back", async () => {
  const session = await Session.small();
  const { page, complaints } = await open(session.address);
  await steers(page, true);
  await until(page, () => window.sonoweave.account?.mask && window.sonoweave.account.desk.phase === "running");
  await page.locator("#mask-vital").click();
  await button(page, "Adjust").click();
  await page.locator("#mask-kind").selectOption("rectangle");
  const size = (await page.evaluate(() => window.sonoweave.mask.mask)).size_px;
  const right = page.getByRole("slider", { name: "Right side" });
  const before = Number(await right.getAttribute("aria-valuenow"));
  await right.focus();
  await page.keyboard.press("Shift+ArrowLeft");
  await page.keyboard.press("ArrowLeft");
  assert.equal(Number(await right.getAttribute("aria-valuenow")), before - 11);
  const { x, y, width } = await right.boundingBox();
  await page.mouse.move(x + width / 2, y + width / 2);
  await page.mouse.down();
  await page.mouse.move(x - 60, y + width / 2, { steps: 4 });
  await page.mouse.up();
  const { rectangle } = await page.evaluate(() => window.sonoweave.mask.draft);
  assert.ok(rectangle.x + rectangle.width < before - 11, JSON.stringify(rectangle));
  await shot(page, "mask");
  assert.deepEqual(await audit(page), []);
  await button(page, "Use this").click();
  await until(page, ([wanted]) => {
    const { mask } = window.sonoweave.account;
    const found = mask.shape.rectangle ?? {};
    return mask.origin === "operator" && Object.entries(wanted).every(([key, value]) => found[key] === value);
  }, rectangle);
  await says(page, "slices have another mask from now on");
  const keys = `clip_px = [${rectangle.x}, ${rectangle.y}, ${rectangle.width}, ${rectangle.height}]`;
  assert.equal(await page.locator("#mask-config").innerText(), keys);
  await button(page, "Whole frame").click();
  await until(page, () => window.sonoweave.account.mask.shape === "whole");
  assert.deepEqual(size, (await page.evaluate(() => window.sonoweave.mask.mask)).size_px);
  assert.deepEqual(complaints, []);
  // A page without control shows the mask, and cannot change it.
  const other = await open(session.address);
  await other.page.locator("#mask-vital").click();
  assert.ok(await button(other.page, "Whole frame").isDisabled());
  assert.match(await banner(page), /\S/);
  await session.end();
});
