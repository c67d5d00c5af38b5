// A session is recorded from the page. Another program then shows it, scrubs through it,
// replays it with other settings, and measures in it.

import assert from "node:assert/strict";
import { mkdirSync, mkdtempSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";

import { LEGS_MM, markLegs } from "./doll.js";
import { audit, difference, greys, measured, open, says, shot, steers } from "./page.js";
import { OUT } from "./place.js";
import { Session } from "./session.js";

const button = (page, name) => page.getByRole("button", { name, exact: true });
const until = (page, is, ...with_) => page.waitForFunction(is, with_);
const phase = (page, name) => until(page, ([name]) => window.sonoweave.account?.desk.phase === name, name);
const account = async (page) => (await measured(page)).account;

// Waits until the replay with these settings has ended.
const ran = (page, tried) => until(page, ([tried]) => {
  const desk = window.sonoweave.account?.desk;
  return desk?.phase === "over" && JSON.stringify(desk.replayed.tried) === tried;
}, JSON.stringify(tried)).catch(async (error) => {
  // Prints what happened instead.
  console.log(JSON.stringify((await account(page)).desk), await page.locator("#settings-says").innerText());
  throw error;
});

// Waits until the slice's picture is of this recorded frame.
const shown = (page, number) => until(page, ([number]) => {
  const { account, pictures } = window.sonoweave;
  const seen = account?.desk.replayed.seen;
  return seen?.number === number && seen.frame === pictures.slice.frame;
}, number);

async function run(page, settings) {
  await button(page, "Settings").click();
  for (const [key, value] of Object.entries(settings)) await page.locator(`[data-key="${key}"]`).fill(value);
  await button(page, "Run again").click();
}

test("a session is recorded, shown again, scrubbed through, run by other settings, and measured", async (t) => {
  const folder = mkdtempSync(join(OUT, "session-"));
  const kept = join(folder, "kept");
  mkdirSync(kept);
  // Recorded by the page's buttons.
  const live = await Session.recorded(folder);
  const first = await open(live.address);
  await steers(first.page, true);
  await until(first.page, () => window.sonoweave.account?.volume?.slices > 120);
  assert.ok(await first.page.locator("#replay").isHidden(), "a live session has no frames to go back to");
  assert.ok(await first.page.locator("#settings-open").isHidden());
  await button(first.page, "Stop").click();
  await phase(first.page, "over");
  await says(first.page, "The recording is complete.");
  const was = await account(first.page);
  await live.end();
  const [recording] = readdirSync(folder).filter((name) => name.endsWith(".mcap"));

  // A calibration beside the recording, half as large.
  writeFileSync(join(folder, "half.toml"), HALF);
  const session = await Session.replay(join(folder, recording), kept);
  const { page, complaints } = await open(session.address);
  await steers(page, true);
  await phase(page, "over");
  await says(page, "Replayed: ");
  await says(page, "As it was recorded.");
  const now = await account(page);
  assert.deepEqual([now.volume, now.slices, now.frames], [was.volume, was.slices, was.frames], "the same came of it");
  assert.match(now.desk.events.at(-1).says, /with the same outcome/);
  for (const name of ["Record", "Freeze", "Clear", "Stop", "Scan"]) assert.equal(await button(page, name).count(), 0, name);
  assert.deepEqual(await audit(page), []);

  // Frame by frame.
  const scrub = page.getByRole("slider", { name: "Recorded frame" });
  const frames = now.desk.replayed.frames;
  assert.equal(Number(await scrub.getAttribute("max")), frames);
  const frame = async (number) => {
    await scrub.fill(`${number}`);
    await page.locator("#scrub-says", { hasText: `frame ${number} of ${frames}` }).waitFor();
    await shown(page, number);
    return greys(page, "slice");
  };
  const early = await frame(10);
  // The probe goes to and fro: one of them alone could show the place of frame 10 again.
  let most = 0;
  for (const number of [40, 70, 100]) most = Math.max(most, difference(await frame(number), early));
  assert.ok(most >= 1, "another picture");
  assert.match(await page.locator("#scrub-says").innerText(), /its place is marked/);
  await page.locator("#view-marks .present").waitFor({ state: "attached" });
  await scrub.focus();
  await page.keyboard.press("ArrowRight");
  await page.locator("#scrub-says", { hasText: `frame 101 of ${frames}` }).waitFor();
  await shot(page, "replayed");

  // Replays with other voxels. A wrong setting is reported in the dialog, and changes nothing.
  await run(page, { "volume.spacing_mm": "-3" });
  await page.locator("#settings-says", { hasText: "volume.spacing_mm: must be positive" }).waitFor();
  await shot(page, "settings");
  assert.deepEqual(await audit(page), []);
  assert.deepEqual((await account(page)).desk.replayed.tried, {});
  await page.locator(`[data-key="volume.spacing_mm"]`).fill("4");
  await button(page, "Run again").click();
  await ran(page, { "volume.spacing_mm": 4 });
  const coarse = await account(page);
  assert.equal(coarse.slices, was.slices);
  assert.ok(coarse.volume.voxels[0] < was.volume.voxels[0], `${coarse.volume.voxels}`);
  await says(page, "volume.spacing_mm = 4");
  // Replays with a calibration beside the session: the content is half as large.
  await run(page, { "calibration.file": "half.toml", "volume.spacing_mm": "2" });
  await ran(page, { "calibration.file": "half.toml", "volume.spacing_mm": 2 });
  assert.ok((await account(page)).volume.mm.some((mm, n) => mm < was.volume.mm[n]), "it is smaller");
  // Replays with another latency.
  await run(page, { "calibration.file": "", "grabber.latency_ms": "0" });
  await ran(page, { "grabber.latency_ms": 0, "volume.spacing_mm": 2 });
  await button(page, "Save volume").click();
  await until(page, () => window.sonoweave.account.desk.events.some(({ says }) => says.includes("the volume is saved")));
  assert.ok(readdirSync(kept).includes("volume-001.mha"));
  // Back to the recorded settings.
  await button(page, "Settings").click();
  await button(page, "As recorded").click();
  await ran(page, {});
  assert.deepEqual((await account(page)).volume, was.volume);
  assert.match((await account(page)).desk.events.at(-1).says, /with the same outcome/);
  // A known dimension of the doll is within the reported error.
  await page.keyboard.press("p");
  await until(page, () => Object.values(window.sonoweave.planes.pictures).every(({ drawn }) => drawn > 0));
  await page.keyboard.press("m");
  await markLegs(page);
  await until(page, () => window.sonoweave.measure.results.length === 1);
  const [{ value, error }] = (await measured(page)).measure.results;
  assert.ok(error < 4 && Math.abs(value - LEGS_MM) <= error, `${value} ± ${error}`);
  t.diagnostic(`the legs are ${value.toFixed(2)} ± ${error.toFixed(2)} mm apart in the replay, ${LEGS_MM} by the doll's description`);
  await shot(page, "replay-measured");
  assert.deepEqual(await audit(page), []);
  assert.deepEqual(complaints, []);
  await session.end();
  rmSync(folder, { recursive: true });
});

// Waits until a replay has ended with this many corrections and this last event.
const corrected = (page, count, event) => until(page, ([count, event]) => {
  const desk = window.sonoweave.account?.desk;
  return desk?.phase === "over" && desk.replayed.corrections.length === count && new RegExp(event).test(desk.events.at(-1)?.says);
}, count, event);

test("the page corrects a recording, says why it cannot, and undoes the correction", async () => {
  const folder = mkdtempSync(join(OUT, "session-"));
  const live = await Session.noisy(folder);
  const first = await open(live.address);
  await until(first.page, () => window.sonoweave.account?.volume?.slices > 80);
  await first.page.close();
  await live.end();
  const [recording] = readdirSync(folder).filter((name) => name.endsWith(".mcap"));
  const session = await Session.replay(join(folder, recording), join(folder, "kept"));
  const { page, complaints } = await open(session.address);
  await steers(page, true);
  await corrected(page, 0, "with the same outcome");
  const before = (await account(page)).volume;
  // Too few breaths: the reason is said, and nothing is stored.
  await button(page, "Settings").click();
  await button(page, "Gate by breathing").click();
  await corrected(page, 0, "no correction: ");
  // Smoothed poses.
  await button(page, "Settings").click();
  await button(page, "Smooth poses").click();
  await corrected(page, 1, "with corrections \\(1 smoothing\\) has ended");
  await button(page, "Settings").click();
  await page.locator("#corrections-list", { hasText: "smoothing: " }).waitFor();
  assert.ok(await button(page, "Smooth poses").isDisabled(), "there is one already");
  await shot(page, "corrections");
  assert.deepEqual(await audit(page), []);
  await button(page, "Undo").click();
  await corrected(page, 0, "with the same outcome");
  assert.deepEqual((await account(page)).volume, before);
  assert.deepEqual(complaints, []);
  await session.end();
  rmSync(folder, { recursive: true });
});

const HALF = `format = "sonoweave-calibration"
version = 1

[image_to_probe]
matrix = [0.5, 0, 0, -40, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]
`;
