// A slow line: pictures come with less quality, which is said, and with all of it again when the line is fast.

import assert from "node:assert/strict";
import { test } from "node:test";

import { close, difference, drawn, greys, open, shot } from "./page.js";
import { shared } from "./session.js";

// How late the page's answers come, ms: longer than a good line takes by far.
const LATE = 400;

test("a slow line has pictures of reduced quality, which is said, and a fast one again whole ones", async (t) => {
  const { address } = await shared();
  let late = 0;
  const encodings = [];
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
    socket.onMessage((message) => setTimeout(() => server.send(message), late));
  };
  const seen = await open(address, { through });
  const { page } = seen;
  const marked = (id, state) => page.locator(`#${id}-reduced`).waitFor({ state, timeout: 120_000 });
  await drawn(page, "slice", 5);
  const whole = bytes;
  late = LATE;
  await marked("slice", "visible");
  await drawn(page, "slice", 10);
  assert.equal(encodings.at(-1), 2);
  assert.ok(bytes < whole / 3, `${bytes} bytes instead of ${whole}`);
  t.diagnostic(`a picture of ${whole} bytes is one of ${bytes} on a slow line`);
  await marked("view", "visible");
  const reduced = await greys(page, "slice");
  assert.ok(Math.max(...reduced.grey) > 40, "something is in it");
  await shot(page, "slow");
  // It goes on, and is still the picture: as wide and high as before, and moving.
  await drawn(page, "slice", 10);
  const later = await greys(page, "slice");
  assert.deepEqual([later.width, later.height], [reduced.width, reduced.height]);
  assert.ok(difference(reduced, later) < 60);
  late = 0;
  await marked("slice", "hidden");
  assert.deepEqual(seen.complaints, []);
  await close(seen);
});
