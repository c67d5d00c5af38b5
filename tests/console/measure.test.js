// Figures on the planes and in the view. A known distance of the phantom must lie within the
// reported error, and a place must report the slices that contributed to it.

import assert from "node:assert/strict";
import { test } from "node:test";

import { LEGS_MM, markLegs } from "./doll.js";
import { audit, measured, open, PATIENCE, settled, shot, SIZES, steers } from "./page.js";
import { shared } from "./session.js";

// Distance of the middles of the doll's feet, across y = −11 mm: crates/phantom/src/body/doll.rs.
const FEET_MM = 31.5;
const FEET_Y = -11;

async function planes(settings) {
  const { address } = await shared();
  const seen = await open(address, settings);
  const { page } = seen;
  await steers(page, true);
  await page.waitForFunction(() => window.sonoweave.account?.slices > 290);
  await page.keyboard.press("p");
  await page.waitForFunction(() => Object.values(window.sonoweave.planes.pictures).every(({ drawn }) => drawn > 0));
  return seen;
}

const state = async (page) => (await measured(page)).measure;
const results = (page, n) => page.waitForFunction((n) => window.sonoweave.measure.results.length === n, n);

test("a distance of the doll is what it is, within the error that is told, by mouse and by keys", async (t) => {
  const seen = await planes();
  const { page } = seen;
  await page.keyboard.press("m");
  await page.locator("#measure").waitFor();
  await markLegs(page);
  await results(page, 1);
  const [{ value, error, unit, of_sampling: sampling }] = (await state(page)).results;
  t.diagnostic(`the legs are ${value.toFixed(2)} ± ${error.toFixed(2)} mm apart, ${LEGS_MM} by the doll's description`);
  assert.equal(unit, "mm");
  assert.ok(error > 0.2 && error < 3 && sampling <= error, `${error}`);
  assert.ok(Math.abs(value - LEGS_MM) <= error, `${value} ± ${error}`);
  assert.match(await page.locator("#measure-results").innerText(), /^\d+\.\d+ ± \d+\.\d+ mm/);
  assert.ok((await page.locator('[data-figure="distance"]').count()) >= 1, "it is drawn");
  // A triangle's area by keys alone: Enter marks, arrows move on.
  await page.locator("#measure-kind").selectOption("area");
  await page.locator("#plane-z").focus();
  const go = async (key, times) => {
    for (let n = 0; n < times; n += 1) await page.keyboard.press(key);
  };
  await page.keyboard.press("Enter");
  await go("ArrowRight", 10);
  await page.keyboard.press("Enter");
  await go("ArrowDown", 10);
  await page.keyboard.press("Enter");
  await page.getByRole("button", { name: "Done" }).click();
  await results(page, 2);
  const [area] = (await state(page)).results;
  const voxel = await page.evaluate(() => window.sonoweave.planes.told[3].voxel_mm);
  assert.ok(Math.abs(area.value - 50 * voxel * voxel) < 0.01 * area.value, `${area.value}`);
  await page.getByRole("button", { name: "Slices here" }).click();
  await page.waitForFunction(() => window.sonoweave.measure.sources !== null);
  const { sources } = await state(page);
  assert.ok(sources.count >= 1 && Math.abs(sources.slices[0].off_mm) < 2, JSON.stringify(sources.slices[0]));
  await page.locator(".slice-line").first().waitFor({ state: "attached" });
  await shot(page, "measured");
  assert.deepEqual(await audit(page), []);
  const height = await page.evaluate(() => [document.documentElement.scrollHeight, innerHeight]);
  assert.ok(height[0] <= height[1], `everything is seen at once: ${height}`);
  await page.getByRole("button", { name: "Clear all" }).click();
  assert.deepEqual((await state(page)).results, []);
  assert.deepEqual(seen.complaints, []);
});

// Returns the position of a world point in the view, as fractions of its width and height.
const inView = (page, at) =>
  page.evaluate((at) => {
    const [i, j, w] = window.sonoweave.projected.projection.map((row) => row.reduce((sum, x, n) => sum + x * [...at, 1][n], 0));
    const { width, height } = document.getElementById("view");
    return [(i / w + 0.5) / width, (j / w + 0.5) / height];
  }, at);

// Returns the grey value of the plane across x at a world point in it.
const greyAt = (page, at) =>
  page.evaluate((at) => {
    const { origin, right, down } = window.sonoweave.planes.told[5];
    const along = (axis) => at.reduce((sum, x, n) => sum + (x - origin[n]) * axis[n], 0) / axis.reduce((sum, x) => sum + x * x, 0);
    const canvas = document.getElementById("plane-x");
    // The browser complains about reading the page's own canvas.
    const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height }).getContext("2d");
    copy.drawImage(canvas, 0, 0);
    return copy.getImageData(Math.round(along(right)), Math.round(along(down)), 1, 1).data[0];
  }, at);

// Points at the view by `act`; again, as a person would, while a busy session says that its picture
// is still being drawn.
async function point(page, act) {
  const begun = Date.now();
  for (;;) {
    assert.ok(Date.now() - begun < PATIENCE, "the picture is drawn at last");
    const answered = page.waitForResponse(/\/v1\/pick$/);
    await act();
    if ((await answered).status() !== 503) return;
  }
}

test("what is seen in the view is pointed at by mouse and by keys, without planes, and lies where they show it", async (t) => {
  const { address } = await shared();
  const seen = await open(address);
  const { page } = seen;
  await steers(page, true);
  await page.waitForFunction(() => window.sonoweave.account?.slices > 290);
  await page.keyboard.press("m");
  await page.locator("#view-panel #measure").waitFor();
  assert.ok(!(await page.locator("#planes-panel").isVisible()));
  // From below, along +z, the soles of the feet come first.
  await page.keyboard.press("7");
  await page.waitForFunction(() => Math.abs(window.sonoweave.projected.projection?.[0][2]) < 1e-9);
  await settled(page);
  const box = await page.locator("#view").boundingBox();
  const clickAt = async ([x, y]) => page.mouse.click(box.x + x * box.width, box.y + y * box.height);
  const feet = [[-FEET_MM / 2, FEET_Y, 0], [FEET_MM / 2, FEET_Y, 0]];
  await point(page, async () => clickAt(await inView(page, feet[0])));
  await page.waitForFunction(() => window.sonoweave.measure.points.length === 1);
  await page.locator("#view-figures circle").waitFor({ state: "attached" });
  await point(page, async () => clickAt(await inView(page, feet[1])));
  await results(page, 1);
  const [{ value, error, of_sampling: sampling, figures }] = (await state(page)).results;
  const [left, right] = figures[0];
  t.diagnostic(`the feet are ${value.toFixed(2)} ± ${error.toFixed(2)} mm apart, ${FEET_MM} by the doll's description; seen at z ${left.point[2].toFixed(1)} and ${right.point[2].toFixed(1)} mm, each within ${left.depth_mm.toFixed(2)} mm`);
  assert.ok(Math.abs(value - FEET_MM) <= error, `${value} ± ${error}`);
  assert.ok(sampling <= error && left.depth_mm > 0.1 && left.along[2] > 0.999, JSON.stringify(left));
  // The figure is drawn at its position, also after the view has turned.
  const drawnAt = () => page.locator('#view-figures [data-figure="distance"] circle').first().evaluate((circle) => [Number(circle.getAttribute("cx")), Number(circle.getAttribute("cy"))]);
  const where = async () => (await inView(page, left.point)).map((share, n) => share * [box.width, box.height][n]);
  const meet = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]) < 1.5;
  const before = await drawnAt();
  assert.ok(meet(before, await where()), `${before}`);
  await shot(page, "measured-view");
  for (let n = 0; n < 3; n += 1) await page.keyboard.press("ArrowRight");
  await page.waitForFunction(() => Math.abs(window.sonoweave.projected.projection[0][2]) > 0.1);
  await settled(page);
  const after = await drawnAt();
  assert.ok(meet(after, await where()) && !meet(after, before), `${before} ${after}`);
  // Beside the volume nothing is visible. Keys mark the middle, which the cross-hair shows.
  assert.equal(await page.locator("#view-figures [data-hair]").count(), 8);
  await point(page, () => page.mouse.click(box.x + 2, box.y + 2));
  await page.locator("#measure-says", { hasText: "nothing opaque is visible there" }).waitFor();
  assert.equal((await state(page)).points.length, 0);
  await point(page, () => page.keyboard.press("Enter"));
  await page.waitForFunction(() => window.sonoweave.measure.points.length === 1);
  await page.keyboard.press("Backspace");
  assert.equal((await state(page)).points.length, 0);
  assert.deepEqual(await audit(page), []);
  // At the crossing of the planes, grey values grow along the ray.
  await page.locator("#measure-mark").focus();
  await page.keyboard.press("p");
  assert.equal(await page.evaluate(() => document.activeElement.id), "measure-mark", "the focus stays where it was");
  await page.locator("#planes-panel #measure").waitFor();
  await page.evaluate((at) => fetch("/v1/do", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ do: "cross", at }) }), left.point);
  await page.waitForFunction((x) => Math.abs(window.sonoweave.planes.told[5]?.origin[0] - x) < 0.5, left.point[0]);
  await page.waitForTimeout(500);
  const along = (mm) => greyAt(page, left.point.map((x, n) => x + left.along[n] * mm));
  const [near, there] = [await along(-6), await along(1.5)];
  assert.ok(there > near + 30, `${near} before it, ${there} behind`);
  // The browser's own log reports the refused requests.
  assert.deepEqual(seen.complaints.filter((text) => !/422|503/.test(text)), []);
});

test("what is no figure is refused with a sentence, on a tablet", async () => {
  const { page } = await planes({ size: SIZES.lying });
  await page.keyboard.press("m");
  await page.locator("#measure-kind").selectOption("angle");
  await page.locator("#plane-z").focus();
  for (let n = 0; n < 3; n += 1) await page.keyboard.press("Enter");
  await page.locator("#measure-says", { hasText: "at one place" }).waitFor();
  assert.deepEqual((await state(page)).results, []);
  await shot(page, "measure-lying");
  assert.deepEqual(await audit(page), []);
});
