// A slow line: pictures come with less quality, which is said, and with all of it again when the line is fast.

import assert from "node:assert/strict";
import { test } from "node:test";

import { close, difference, drawn, greys, measured, open, shot } from "./page.js";
import { shared } from "./session.js";

// How late the page's answers come, ms: longer than a good line takes by far.
const LATE = 400;

test("a slow line has pictures of reduced quality, which is said, and a fast one again whole ones", async (t) => {
  const { address } = await shared();
  let late = 0;
  const encodings = [];
  const had = [];
  let bytes = 0;
  const through = (socket) => {
    const server = socket.connectToServer();
    server.onMessage((message) => {
      if (typeof message !== "string" && message[0] === 1) {
        encodings.push(message[1]);
        bytes = message.length;
      }
      socket.send(message);
    });
    // In their order, however late.
    socket.onMessage((message) => {
      const wish = JSON.parse(message);
      if (wish.do === "shown") had.push(wish.had_ms);
      setTimeout(() => server.send(message), late);
    });
  };
  const seen = await open(address, { through });
  const { page } = seen;
  const marked = (state) => page.locator("#slice-reduced").waitFor({ state, timeout: 120_000 });
  await drawn(page, "slice", 5);
  late = LATE;
  await marked("visible");
  await drawn(page, "slice", 10);
  assert.equal(encodings.at(-1), 2);
  const { width, height } = (await measured(page)).pictures.slice;
  const whole = width * height;
  assert.ok(bytes < whole / 3, `${bytes} bytes instead of ${whole}`);
  t.diagnostic(`a picture of ${whole} bytes is one of ${bytes} on a slow line`);
  const reduced = await greys(page, "slice");
  assert.ok(Math.max(...reduced.grey) > 40, "something is in it");
  await shot(page, "slow");
  // It goes on, as wide and high as before.
  await drawn(page, "slice", 10);
  const later = await greys(page, "slice");
  assert.deepEqual([later.width, later.height], [reduced.width, reduced.height]);
  assert.ok(difference(reduced, later) > 0.05, "it moves");
  late = 0;
  await marked("hidden");
  // The page's own time is told with each answer, so that a slow page is no slow line.
  assert.ok(had.length > 50 && had.every((ms) => ms >= 0 && ms < 120_000) && had.some((ms) => ms > 0), `${had.length}: ${had.slice(0, 9)}`);
  assert.deepEqual(seen.complaints, []);
  await close(seen);
});
