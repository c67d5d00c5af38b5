// Session commands by buttons and keys: freeze, clear, stop, save, record; and the confirmation
// dialogs.

import assert from "node:assert/strict";
import { readdirSync } from "node:fs";
import { test } from "node:test";

import { audit, banner, difference, drawn, greys, measured, open, says, shot, steers } from "./page.js";
import { Session } from "./session.js";

const button = (page, name) => page.getByRole("button", { name, exact: true });
const until = (page, is, ...with_) => page.waitForFunction(is, with_);
const slices = async (page) => (await measured(page)).account.volume?.slices ?? 0;
const phase = (page, name) => until(page, ([name]) => window.sonoweave.account?.desk.phase === name, name);
const happened = (page, what) => until(page, ([what]) => window.sonoweave.account.desk.events.some(({ says }) => says.includes(what)), what);

test("a newcomer comes from the demo to a saved volume and a recording by what the buttons say", async () => {
  const session = await Session.begin();
  const { page, complaints } = await open(session.address);
  await steers(page, true);
  await drawn(page, "view", 3);
  await says(page, "All is well; it is recorded.");
  assert.ok(await button(page, "Record").isDisabled(), "it is being recorded already");
  await button(page, "Save volume").click();
  await happened(page, "the volume is saved");
  await says(page, "the volume is saved: ");
  await button(page, "Snapshot").click();
  await happened(page, "the pictures are saved");
  await shot(page, "saved");
  await button(page, "Stop").click();
  await phase(page, "over");
  await says(page, "Stopped: this volume stays in view.");
  await happened(page, "the recording is complete");
  // The view of an ended session can still be turned.
  const before = await greys(page, "view");
  await button(page, "Above").click();
  for (let n = 0; difference(await greys(page, "view"), before) < 2; n += 1) {
    assert.ok(n < 300, "seen from above");
    await page.waitForTimeout(100);
  }
  await page.locator("#slice-word", { hasText: "stopped" }).waitFor();
  assert.equal(await page.locator("#recording-vital").innerText(), "✓ complete");
  await shot(page, "over");
  assert.deepEqual(await audit(page), []);
  await page.keyboard.press("v");
  await until(page, () => window.sonoweave.account.desk.events.filter(({ says }) => says.includes("is saved")).length === 2);
  await page.keyboard.press("r");
  await phase(page, "running");
  await until(page, () => window.sonoweave.account.desk.records && window.sonoweave.account.volume?.slices > 3);
  const files = readdirSync(session.folder);
  const sessions = files.filter((name) => name.endsWith(".mcap"));
  assert.equal(sessions.length, 2, files.join(" "));
  for (const name of ["volume-001.mha", "volume-001-weights.mha", "volume-002.mha", "snapshot-001-scanner.png", "snapshot-001-volume.png"]) {
    assert.ok(files.includes(name), `${name}: ${files.join(" ")}`);
  }
  assert.deepEqual(complaints, []);
  await session.end();
});

test("one key freezes, and what would be lost is asked about first", async () => {
  const session = await Session.begin();
  const { page } = await open(session.address);
  const other = await open(session.address);
  await steers(page, true);
  await until(page, () => window.sonoweave.account?.volume?.slices > 10);
  await page.keyboard.press("f");
  await says(page, "Frozen: no slices are inserted into the volume.");
  await page.locator("#slice-word", { hasText: "frozen" }).waitFor();
  assert.equal(await page.locator("#banner p", { hasText: /frozen/i }).count(), 1, "it is said once");
  assert.equal(await button(page, "Freeze").getAttribute("aria-pressed"), "true");
  // Slices on their way at the command are still inserted.
  await until(page, () => window.sonoweave.account.refused.frozen > 45);
  const held = await slices(page);
  await until(page, () => window.sonoweave.account.refused.frozen > 75);
  assert.equal(await slices(page), held);
  await shot(page, "held");
  // A page without control may not freeze.
  assert.ok(await button(other.page, "Freeze").isDisabled());
  await other.page.keyboard.press("f");
  await page.waitForTimeout(500);
  assert.equal((await measured(page)).account.frozen, true);
  await page.keyboard.press("Delete");
  await page.getByRole("dialog", { name: "Throw this volume away?" }).waitFor();
  await shot(page, "sure");
  assert.deepEqual(await audit(page), []);
  await page.keyboard.press("Escape");
  assert.equal(await slices(page), held, "nothing was done");
  // The answer belongs to the second question, asked before the screen's next frame.
  await page.evaluate(() => {
    const ask = document.getElementById("ask");
    const key = (key) => document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
    key("Delete");
    ask.close();
    key("Delete");
  });
  await page.getByRole("dialog").getByRole("button", { name: "Clear", exact: true }).click();
  await until(page, () => window.sonoweave.account.volume === null);
  await page.keyboard.press("f");
  await until(page, () => window.sonoweave.account.volume?.slices > 3);
  assert.doesNotMatch(await banner(page), /Frozen/);
  await session.end();
});
