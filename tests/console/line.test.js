// The connection to the session: lost, restored, and at the session's end.

import assert from "node:assert/strict";
import { setTimeout as wait } from "node:timers/promises";
import { test } from "node:test";

import { banner, drawn, look, measured, open, says, shot } from "./page.js";
import { Session } from "./session.js";

test("a lost connection is said, and found again", async (t) => {
  const session = await Session.begin();
  const { port } = session;
  const seen = await open(session.address);
  const { page } = seen;
  await drawn(page, "slice", 5);
  await drawn(page, "view", 2);
  await session.end("SIGKILL");
  await says(page, "Connection lost");
  assert.match(await banner(page), /what you see is old/);
  await page.locator("#slice-word", { hasText: /not live/i }).waitFor();
  await page.getByRole("button", { name: "Try now" }).waitFor();
  assert.match(await page.locator("#announcer").textContent(), /Connection lost/, "it is spoken, too");
  await shot(page, "lost");
  const before = (await measured(page)).pictures.slice.drawn;

  const again = await Session.begin(port);
  const began = Date.now();
  await page.waitForFunction(() => window.sonoweave.connected);
  t.diagnostic(`found again ${Date.now() - began} ms after the session was back`);
  await drawn(page, "slice", 5);
  assert.ok((await measured(page)).pictures.slice.drawn > before);
  await page.locator("#slice-word").waitFor({ state: "hidden" });
  assert.doesNotMatch(await banner(page), /Connection lost/);
  await again.end();
});

test("a page that is not looked at does not look for its session, either, and does when it is", async () => {
  const session = await Session.begin();
  const { page } = await open(session.address);
  await drawn(page, "slice", 2);
  await look(page, "hidden");
  await session.end("SIGKILL");
  await page.waitForFunction(() => !window.sonoweave.connected);
  const again = await Session.begin(session.port);
  await wait(2000);
  assert.equal((await measured(page)).connected, false);
  await look(page, "visible");
  await drawn(page, "slice", 2);
  await again.end();
});

test("whoever does not want to wait tries now", async () => {
  const session = await Session.begin();
  const { page } = await open(session.address);
  await drawn(page, "slice", 2);
  await session.end("SIGKILL");
  await says(page, /again in [45] s/);
  await page.evaluate(() => {
    window.tried = 0;
    const Socket = WebSocket;
    window.WebSocket = function (address) {
      window.tried += 1;
      return new Socket(address);
    };
  });
  await page.getByRole("button", { name: "Try now" }).click();
  assert.equal(await page.evaluate(() => window.tried), 1);
  await says(page, "Connection lost");
});

test("a session that hangs is a lost one, though its socket stays, until it goes on", async () => {
  const session = await Session.begin();
  const { page } = await open(session.address);
  await drawn(page, "slice", 2);
  session.hang(true);
  await says(page, "Connection lost");
  session.hang(false);
  await drawn(page, "slice", 3);
  assert.doesNotMatch(await banner(page), /Connection lost/);
  await session.end();
});
