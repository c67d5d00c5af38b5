// Figures on the planes: a distance of the phantom that is known lies within the error that is told, and a place knows the slices that it was made of.

import assert from "node:assert/strict";
import { test } from "node:test";

import { LEGS_MM, markLegs } from "./doll.js";
import { audit, measured, open, shot, SIZES, steers } from "./page.js";
import { shared } from "./session.js";

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
