// A slow connection: pictures have a reduced quality, which is reported, and full quality again
// when the connection is fast.

import assert from "node:assert/strict";
import { test } from "node:test";

import { close, difference, drawn, greys, measured, open, shot } from "./page.js";
import { shared } from "./session.js";

// Delay of the page's answers, ms: far longer than on a good connection.
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
    // Messages stay in order, however late.
    socket.onMessage((message) => {
      const wish = JSON.parse(message);
      if (wish.do === "shown") had.push(wish.had_ms);
      setTimeout(() => server.send(message), late);
    });
  };
  const seen = await open(address, { through });
  const { page } = seen;
  const marked = (state) => page.locator("#slice-reduced").waitFor({ state });
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
  // The pictures go on, as wide and high as before.
  await drawn(page, "slice", 10);
  const later = await greys(page, "slice");
  assert.deepEqual([later.width, later.height], [reduced.width, reduced.height]);
  assert.ok(difference(reduced, later) > 0.05, "it moves");
  late = 0;
  await marked("hidden");
  // Each answer reports the page's own time, so that a slow page does not count as a slow
  // connection.
  assert.ok(had.length > 50 && had.every((ms) => ms >= 0 && ms < 120_000) && had.some((ms) => ms > 0), `${had.length}: ${had.slice(0, 9)}`);
  assert.deepEqual(seen.complaints, []);
  await close(seen);
});
