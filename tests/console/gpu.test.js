// The volume drawn by the page itself: the session's picture within the stated difference, the
// session's bricks to the byte, and the session's pictures wherever the page cannot draw.

import assert from "node:assert/strict";
import { join } from "node:path";
import { pathToFileURL } from "node:url";
import { test } from "node:test";

import { audit, close, drawn, measured, open, shot, steers } from "./page.js";
import { PAGE } from "./place.js";
import { Session } from "./session.js";

// Differences from the session's picture, of 255: root mean square, all but a thousandth, the
// largest.
const RMS = 1.5;
const USUAL = 6;
const MOST = 16;

const BRICKS = 7;
const VIEW = 2;
const HEADER = 40;

const caption = (page, words) => page.locator("#view-caption", { hasText: words }).waitFor();
const here = (page) => page.waitForFunction(() => window.sonoweave.own.here);

// Opens a page that may draw slowly.
const drawing = (address, settings = {}) => open(`${address}?gpu=software`, { graphics: true, ...settings });

async function command(address, message) {
  const answer = await fetch(new URL("/v1/do", address), { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(message) });
  assert.equal(answer.status, 200, await answer.text());
}

// Waits for some slices, and then for a volume that no longer changes.
async function still(page, address, slices = 40) {
  await page.waitForFunction((slices) => window.sonoweave.account?.slices >= slices, slices);
  await command(address, { do: "freeze", on: true });
  await page.waitForFunction(() => window.sonoweave.own.missing === 0);
}

// Compares the page's picture with the session's, once the session's has settled, and both have
// the same bricks and the same view. Returns the differences.
async function compared(page) {
  return page.evaluate(async () => {
    const { difference, sessionPixels } = await import("/page/gpu_check.js");
    const { own } = window.sonoweave;
    const pause = () => new Promise((resolve) => setTimeout(resolve, 400));
    let last = null;
    for (let tries = 0; tries < 50; tries += 1) {
      const [now, mine] = [await sessionPixels(), own.view.pixels()];
      const off = difference(mine, now);
      // Neither changes any more.
      if (last && difference(now, last.now).most === 0 && difference(mine, last.mine).most === 0) {
        return { ...off, lit: mine.data.filter((value, n) => n % 4 === 0 && value > 40).length };
      }
      last = { now, mine };
      await pause();
    }
    throw new Error("the session's picture does not settle");
  });
}

function agrees(t, name, { rms, usual, most, lit }) {
  t.diagnostic(`${name}: rms ${rms.toFixed(2)}, 99.9 % within ${usual}, largest ${most}; ${lit} bright pixels`);
  assert.ok(lit > 100, `${name}: something is in it`);
  assert.ok(rms <= RMS && usual <= USUAL && most <= MOST, `${name}: rms ${rms}, 99.9 % ${usual}, largest ${most}`);
}

// FNV-1a, as on the page below.
const hash = (bytes) => bytes.reduce((sum, byte) => Math.imul(sum ^ byte, 16777619) >>> 0, 2166136261);

test("bricks are parsed, and wrong messages are refused as a whole", async () => {
  const { BrickStore, parseBricks } = await import(pathToFileURL(join(PAGE, "bricks.js")));
  const record = (at, empty, fill = 0) => {
    const bytes = new Uint8Array(empty ? 10 : 10 + 2048);
    new DataView(bytes.buffer).setInt16(0, at[0], true);
    new DataView(bytes.buffer).setInt16(2, at[1], true);
    new DataView(bytes.buffer).setInt16(4, at[2], true);
    bytes.set([empty ? 1 : 0, fill, fill, 0], 6);
    if (!empty) bytes.fill(fill, 10);
    return bytes;
  };
  const joined = (...parts) => Uint8Array.from(parts.flatMap((part) => [...part]));
  const box = [[-2, 0, 0], [3, 4, 5]];
  const good = joined(record([-2, 3, 4], false, 7), record([2, 0, 0], true));
  const [first, second] = parseBricks(good, 2, box);
  assert.deepEqual([first.at, first.low, first.voxels.length, first.voxels[2047]], [[-2, 3, 4], 7, 2048, 7]);
  assert.deepEqual([second.at, second.voxels], [[2, 0, 0], null]);
  // Cut at any byte, it is refused.
  for (let length = 0; length < good.length; length += 1) assert.throws(() => parseBricks(good.subarray(0, length), 2, box), /cut off/);
  for (const [bytes, count, why] of [
    [good, 1, /follow the last brick/],
    [good, 3, /cut off/],
    [good, 4e9, /cut off/],
    [record([3, 0, 0], true), 1, /outside of the volume/],
    [record([0, -1, 0], true), 1, /outside of the volume/],
    [joined(record([0, 0, 0], true).with(6, 2)), 1, /kind 2/],
  ]) assert.throws(() => parseBricks(bytes, count, box), why);
  const store = new BrickStore();
  assert.equal(store.box(), null);
  store.take([first, second]);
  assert.deepEqual([store.box(), store.bricks.size, store.takeChanged()], [[[-3, 2, 3], [0, 5, 6]], 1, [[-2, 3, 4], [2, 0, 0]]]);
  store.keep([[0, 0, 0], [3, 4, 5]]);
  assert.deepEqual([store.box(), store.bricks.size, store.takeChanged()], [null, 0, [[-2, 3, 4]]]);
});

test("a page draws the session's picture: presets, turned, zoomed and growing", async (t) => {
  const { address } = await Session.pictured({});
  const seen = await drawing(address);
  const { page } = seen;
  await here(page);
  await caption(page, /^drawn here$/);
  // No picture of the volume is sent any more.
  const sent = await page.evaluate(() => window.sonoweave.pictures.view.sequence);
  await still(page, address, 60);
  assert.equal((await measured(page)).pictures.view.sequence, sent);
  agrees(t, "phantom", await compared(page));
  await shot(page, "drawn-here");
  await steers(page, true);
  await page.locator("#view").focus();
  for (const key of ["ArrowRight", "ArrowRight", "ArrowUp", "+", "+"]) await page.keyboard.press(key);
  agrees(t, "phantom, turned", await compared(page));
  await page.locator("#view").dblclick({ position: { x: 200, y: 150 } });
  agrees(t, "phantom, centred", await compared(page));
  for (const preset of ["tissue", "xray", "bone"]) {
    await command(address, { do: "transfer", preset });
    agrees(t, preset, await compared(page));
  }
  await command(address, { do: "transfer", preset: "surface" });
  await caption(page, /^drawn by the session: pages do not draw thin surfaces$/);
  await command(address, { do: "transfer", preset: "tissue" });
  await here(page);
  agrees(t, "tissue again", await compared(page));
  const { own } = await measured(page);
  assert.equal(own.dropped, 0);
  t.diagnostic(`${own.bricks} bricks, ${own.work.textures} textures, ${own.work.pictures} pictures, ${own.work.bricks} bricks lit`);
  assert.deepEqual(await audit(page), []);
  assert.deepEqual(seen.complaints, []);
  await close(seen);
});

// Returns a relay of the page's connection, which calls `received(bytes)` for each of the session's
// binary messages, and `begun(server)` for each connection.
const relay = (received, begun = () => {}) => (socket) => {
  const server = socket.connectToServer();
  begun(server);
  server.onMessage((message) => {
    if (typeof message !== "string") received(message);
    socket.send(message);
  });
  socket.onMessage((message) => server.send(message));
};

// Returns the bricks of a message: [indices, bytes], null for one of which nothing was seen.
function bricksOf(message) {
  const all = [];
  for (let from = HEADER; message[0] === BRICKS && from < message.length; ) {
    const at = [0, 2, 4].map((axis) => message.readInt16LE(from + axis));
    const empty = message[from + 6] === 1;
    all.push([at, empty ? null : message.subarray(from + 10, from + 10 + 2048)]);
    from += empty ? 10 : 10 + 2048;
  }
  return all;
}

const COLOUR = `format = "sonoweave-transfer"
version = 1
gradient = [[0.0, 0.2], [20.0, 1.0]]
[opacity]
curve = [[60.0, 0.0], [120.0, 0.3], [255.0, 0.9]]
[colour]
perceptual = [0.0, 255.0]
`;
const REGION = `format = "sonoweave-transfer"
version = 1
[opacity]
region = [[40.0, 0.0], [140.0, 1.0], [255.0, 1.0]]
`;
const CROP = `format = "sonoweave-crop"
version = 1
[[operation]]
hide = "beyond_plane"
point = [0.0, 0.0, 0.0]
normal = [1.0, 0.0, 0.0]
`;

test("a page draws the session's picture: modes, colours, perspective, light and crops", async (t) => {
  for (const [name, keys, files] of [
    ["mip", { mode: '"mip"' }],
    ["average", { mode: '"average"' }],
    ["opacity", { mode: '"opacity"' }],
    ["colour", { transfer: '"colour.toml"', background: "[0.2, 0.1, 0.4]" }, { "colour.toml": COLOUR }],
    ["mip in colour", { mode: '"mip"', transfer: '"colour.toml"' }, { "colour.toml": COLOUR }],
    ["region", { transfer: '"region.toml"' }, { "region.toml": REGION }],
    ["perspective", { perspective_deg: 40, step_voxels: 0.7, depth_cue: "[1.0, 0.4]" }],
    ["crop", { crop: '"crop.toml"', light: "[1.0, -1.0, 1.0]" }, { "crop.toml": CROP }],
  ]) {
    const session = await Session.pictured(keys, files);
    const sides = new Set();
    const through = relay((message) => bricksOf(message).forEach(([[x], bytes]) => bytes && sides.add(x > 0)));
    const seen = await drawing(session.address, { through });
    await here(seen.page);
    await still(seen.page, session.address);
    agrees(t, name, await compared(seen.page));
    // The crop hides one side of the world.
    assert.deepEqual([...sides].sort(), name === "crop" ? [false] : [false, true], name);
    await shot(seen.page, `drawn-here-${name.replaceAll(" ", "-")}`);
    assert.deepEqual(seen.complaints, [], name);
    await close(seen);
    await session.end();
  }
});

test("after a new connection, the page has the session's bricks to the byte", async () => {
  const { address } = await Session.pictured({});
  let bricks = new Map();
  const sockets = [];
  const take = ([at, bytes]) => (bytes ? bricks.set(at.join(), hash(bytes)) : bricks.delete(at.join()));
  const through = relay(
    (message) => bricksOf(message).forEach(take),
    (server) => {
      sockets.push(server);
      bricks = new Map();
    },
  );
  const seen = await drawing(address, { through });
  const { page } = seen;
  await here(page);
  // One of the page's own accord, and one in the middle of the bricks' transmission.
  for (let n = 0; n < 2; n += 1) {
    const before = sockets.length;
    await sockets.at(-1).close();
    await page.waitForFunction(() => !window.sonoweave.own.here);
    while (sockets.length === before) await page.waitForTimeout(50);
  }
  await here(page);
  await still(page, address);
  await compared(page);
  const found = await page.evaluate((places) => {
    const hash = (bytes) => bytes.reduce((sum, byte) => Math.imul(sum ^ byte, 16777619) >>> 0, 2166136261);
    const { view } = window.sonoweave.own;
    return places.map((at) => hash(view.read(at.split(",").map(Number))));
  }, [...bricks.keys()]);
  assert.ok(bricks.size > 100 && bricks.size === (await measured(page)).own.bricks, `${bricks.size}`);
  assert.deepEqual(found, [...bricks.values()]);
  await close(seen);
});

test("where the page cannot draw, the session does, and the page says why", async (t) => {
  const { address } = await Session.pictured({});
  const kinds = [];
  const through = relay((message) => kinds.push(message[0]));
  const cases = [
    ["an imitated graphics processor", "", null, /no fast WebGL 2/],
    ["a browser without WebGL 2", "?gpu=software", () => delete window.WebGL2RenderingContext, /has no WebGL 2/],
    [
      "small textures",
      "?gpu=software",
      () => {
        const { getParameter } = WebGL2RenderingContext.prototype;
        WebGL2RenderingContext.prototype.getParameter = function (name) {
          return name === WebGL2RenderingContext.MAX_3D_TEXTURE_SIZE ? 16 : getParameter.call(this, name);
        };
      },
      /too large for this page/,
    ],
    [
      "slow frames",
      "",
      () => {
        const { getParameter, readPixels } = WebGL2RenderingContext.prototype;
        WebGL2RenderingContext.prototype.getParameter = function (name) {
          return name === 0x9246 ? "a graphics processor" : getParameter.call(this, name);
        };
        WebGL2RenderingContext.prototype.readPixels = function (...all) {
          for (const began = performance.now(); performance.now() - began < 60; );
          readPixels.apply(this, all);
        };
      },
      /draws too slowly/,
    ],
  ];
  for (const [name, query, changes, why] of cases) {
    const seen = await open("about:blank", { graphics: true, through });
    const { page } = seen;
    if (changes) await page.addInitScript(changes);
    await page.goto(address + query);
    await caption(page, why);
    t.diagnostic(`${name}: ${await page.locator("#view-caption").innerText()}`);
    // Pictures go on, and no bricks come any more.
    await drawn(page, "view", 3);
    kinds.length = 0;
    await drawn(page, "view", 3);
    assert.ok(kinds.includes(VIEW) && !kinds.includes(BRICKS), name);
    assert.equal((await measured(page)).own.here, false);
    await close(seen);
  }
});

test("lost graphics, wrong bricks and a slow line lead back to the session's pictures for a while", async (t) => {
  const { address } = await Session.pictured({});
  let [late, wrong] = [false, false];
  const through = relay((message) => {
    if (message[0] !== BRICKS) return;
    // Bricks are said to be missing; and one to lie far outside.
    if (late) message.writeUInt32LE(5, 8);
    if (message.length === HEADER) return;
    if (wrong) message.writeInt16LE(30_000, HEADER);
    wrong = false;
  });
  const seen = await drawing(address, { through });
  const { page } = seen;
  await here(page);
  const left = await page.evaluate(async () => {
    const { own, pictures } = window.sonoweave;
    const before = pictures.view.sequence;
    window.lose = own.view.context.getExtension("WEBGL_lose_context");
    const began = performance.now();
    window.lose.loseContext();
    while (own.here) await new Promise((resolve) => setTimeout(resolve));
    const left = performance.now() - began;
    while (pictures.view.sequence === before) await new Promise((resolve) => setTimeout(resolve));
    return [left, performance.now() - began];
  });
  t.diagnostic(`the loss is noticed after ${left[0].toFixed(0)} ms, and the session's picture is there after ${left[1].toFixed(0)} ms`);
  await caption(page, /by the session: the browser has taken its graphics away/);
  await drawn(page, "view", 2);
  await page.evaluate(() => window.lose.restoreContext());
  await here(page);
  wrong = true;
  await page.waitForFunction(() => window.sonoweave.own.dropped === 1);
  assert.match(seen.complaints.splice(0).join("\n"), /bricks dropped: a brick at 30000,/);
  late = true;
  await caption(page, /by the session: the line is slow/);
  await drawn(page, "view", 2);
  late = false;
  await here(page);
  await close(seen);
});

test("?gpu-check behind the address shows times and the difference from the session's picture", async (t) => {
  const { address } = await Session.pictured({});
  const seen = await open(`${address}?gpu=software&gpu-check`, { graphics: true });
  const { page } = seen;
  const said = page.locator("#gpu-check");
  await said.filter({ hasText: /takes [\d.]+ ms, a turned one [\d.]+ ms; \d+ bricks .* rms \d/ }).waitFor();
  t.diagnostic(await said.innerText());
  assert.deepEqual(await audit(page), []);
  await shot(page, "gpu-check");
  await close(seen);
  // Where the page cannot draw, the reason is there.
  const other = await open(`${address}?gpu-check`, { graphics: true });
  await other.page.locator("#gpu-check", { hasText: "drawn by the session: this browser has no fast WebGL 2" }).waitFor();
  await close(other);
});
