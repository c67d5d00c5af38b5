// Figures on the planes: a distance of the phantom that is known lies within the error that is told, and a place knows the slices that it was made of.

import assert from "node:assert/strict";
import { test } from "node:test";

import { audit, measured, open, shot, SIZES, steers } from "./page.js";
import { shared } from "./session.js";

// Of the doll in the water tank: how far the axes of its legs are apart across z = −45 mm; see src/phantom/body/doll.rs.
const LEGS_MM = 27;
const LEGS_Z = -45;

async function planes(settings) {
  const { address } = await shared();
  const seen = await open(address, settings);
  const { page } = seen;
  await steers(page, true);
  await page.waitForFunction(() => window.sonoweave.account?.slices > 290, null, { timeout: 60_000 });
  await page.keyboard.press("p");
  await page.waitForFunction(() => Object.values(window.sonoweave.planes.pictures).every(({ drawn }) => drawn > 0), null, { timeout: 30_000 });
  return seen;
}

const state = async (page) => (await measured(page)).measure;
const results = (page, n) => page.waitForFunction((n) => window.sonoweave.measure.results.length === n, n, { timeout: 10_000 });

// Where the two legs are in the plane across z, by the middles of what is bright left and right of the middle: pixels of its picture.
const legs = (page) =>
  page.evaluate(() => {
    const canvas = document.getElementById("plane-z");
    const { width, height } = canvas;
    const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
    const { origin, right, down } = window.sonoweave.planes.told[3];
    const found = [0, 1].map(() => ({ n: 0, x: 0, y: 0 }));
    for (let y = 0; y < height; y += 1) {
      for (let x = 0; x < width; x += 1) {
        const [r, g, b] = data.subarray(4 * (y * width + x), 4 * (y * width + x) + 3);
        const at = [0, 1, 2].map((n) => origin[n] + right[n] * x + down[n] * y);
        // Neither the probe's face nor the tank's floor, and no more than a leg aside.
        if (r !== g || g !== b || r < 60 || at[1] < -22 || at[1] > 6 || Math.abs(at[0]) > 26) continue;
        const side = found[at[0] < 0 ? 0 : 1];
        side.n += 1;
        side.x += x;
        side.y += y;
      }
    }
    return found.map(({ n, x, y }) => [x / n / width, y / n / height, n]);
  });

async function click(page, name, x, y) {
  const box = await page.locator(`#plane-${name}`).boundingBox();
  await page.mouse.click(box.x + x * box.width, box.y + y * box.height);
}

test("a distance of the doll is what it is, within the error that is told, by mouse and by keys", async (t) => {
  const seen = await planes();
  const { page } = seen;
  await page.keyboard.press("m");
  await page.locator("#measure").waitFor();
  const asked = await page.evaluate((z) => fetch("/v1/do", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ do: "cross", at: [0, 47, z] }) }).then((answer) => answer.status), LEGS_Z);
  assert.equal(asked, 200);
  await page.waitForFunction((z) => Math.abs(window.sonoweave.planes.told[3].origin[2] - z) < 0.5, LEGS_Z, { timeout: 10_000 });
  await page.waitForTimeout(500);
  const [left, right] = await legs(page);
  assert.ok(left[2] > 100 && right[2] > 100, `both legs are seen: ${left} ${right}`);
  await click(page, "z", left[0], left[1]);
  assert.equal((await state(page)).points.length, 1);
  await click(page, "z", right[0], right[1]);
  await results(page, 1);
  const [{ value, error, unit, of_sampling: sampling }] = (await state(page)).results;
  t.diagnostic(`the legs are ${value.toFixed(2)} ± ${error.toFixed(2)} mm apart, ${LEGS_MM} by the doll's description`);
  assert.equal(unit, "mm");
  assert.ok(error > 0.2 && error < 3 && sampling <= error, `${error}`);
  assert.ok(Math.abs(value - LEGS_MM) <= error, `${value} ± ${error}`);
  assert.match(await page.locator("#measure-results").innerText(), /^\d+\.\d+ ± \d+\.\d+ mm/);
  assert.ok((await page.locator('[data-figure="distance"]').count()) >= 1, "it is drawn");
  // A triangle's area by keys alone: Enter marks, arrows go on.
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
  await page.waitForFunction(() => window.sonoweave.measure.sources !== null, null, { timeout: 10_000 });
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
