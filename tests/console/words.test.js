// The page's texts, tested without a browser: its modules are copied so that node loads them as
// modules.

import assert from "node:assert/strict";
import { cpSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { pathToFileURL } from "node:url";

import { OUT, PAGE } from "./place.js";

cpSync(PAGE, join(OUT, "page"), { recursive: true });
const of = (name) => import(pathToFileURL(join(OUT, "page", name)).href);
const words = await of("words.js");
const { troubles } = await of("troubles.js");
const { parse } = await of("header.js");
const { quantile } = await of("measurements.js");

const WELL = {
  slices: 90, frames: 100, refused: { "no pose": 4, "the same picture": 3 }, dropped: 1, lost: 2,
  rates: { frames: 30, poses: 60, pictures: 20 },
  devices: [{ name: "tracking", state: "running", why: "", clock: "locked" }, { name: "grabber", state: "running", why: "", clock: "locked" }],
  frozen_s: null, bent: false, recording: null, volume: null, notes: [], ended: false,
};
const OPEN = { open: true, ever: true, lost_s: 0, next_s: null };
const keys = (line, account, blank_s = 0) => troubles({ line: { ...OPEN, ...line }, account, blank_s }).map(({ key }) => key);

test("every frame is accounted for, and a share is never rounded up to all", () => {
  const { lines, says, parts } = words.frames(WELL);
  const told = Object.fromEntries(lines.map(({ n, says }) => [says, n]));
  assert.deepEqual(told, {
    "in the volume": 90, "refused: no pose": 4, "refused: the same picture": 3,
    "dropped: there was no time for them": 1, "lost before they came": 2, "under way": 2,
  });
  assert.equal(says, "90.0 % used");
  assert.ok(Math.abs(parts.reduce((sum, { share }) => sum + share, 0) - 1) < 1e-9);
  assert.equal(words.frames({ ...WELL, slices: 99_999, frames: 100_000, refused: { "no pose": 1 }, dropped: 0, lost: 0 }).says, "99.9 % used");
  assert.equal(words.frames({ ...WELL, slices: 5, frames: 5, refused: {}, dropped: 0, lost: 0 }).how, "well");
  const how = (slices, refused, lost) => words.frames({ ...WELL, slices, frames: slices + refused, refused: { "no pose": refused }, dropped: 0, lost }).how;
  assert.deepEqual([how(99, 1, 0), how(90, 10, 0), how(999, 0, 1), how(90, 0, 10)], ["well", "heed", "heed", "bad"]);
  assert.equal(words.frames({ ...WELL, slices: 0, frames: 0, refused: {}, dropped: 0, lost: 0 }).says, "none yet");
});

test("every reason that frames are refused for has its words", () => {
  const source = readFileSync(join(PAGE, "../../../core/src/refusal.rs"), "utf8");
  const names = [...source.matchAll(/Self::\w+ => "(\w+)",/g)].map(([, name]) => name.replaceAll("_", " "));
  assert.ok(names.length > 20, names.join());
  for (const name of names) assert.notEqual(words.reason(name), name);
  assert.equal(words.reason("a reason of tomorrow"), "a reason of tomorrow");
});

test("numbers are written as people read them", () => {
  assert.equal(words.count(1234567), "1\u202f234\u202f567");
  assert.equal(words.many(1, "frame"), "1 frame");
  assert.equal(words.duration(59.4), "59 s");
  assert.equal(words.duration(200), "3 min 20 s");
  assert.equal(words.duration(7500), "2 h 5 min");
  assert.equal(words.bytes(999), "999 bytes");
  assert.equal(words.bytes(1234567890), "1.2 GB");
  assert.equal(words.milliseconds(null), "–");
  assert.equal(words.milliseconds(19.64), "19.6");
});

test("a recording tells how long there is room, and whether something is missing in it", () => {
  const file = { path: "/a/SESSION.mcap", bytes: 5e6, minutes_left: 187.9, lost: 0, trouble: "" };
  assert.equal(words.recording(file).says, "on · 3 h 7 min");
  assert.equal(words.recording({ ...file, minutes_left: 9.9 }).how, "heed");
  assert.equal(words.recording({ ...file, lost: 3 }).how, "bad");
  assert.equal(words.recording({ ...file, trouble: "the disk is full" }).how, "bad");
  const slow = words.recording({ ...file, slow_disk: true });
  assert.deepEqual([slow.how, slow.lines.at(-1).how], ["heed", "heed"]);
  assert.match(slow.lines.at(-1).says, /the disk is slow/);
  assert.equal(words.recording({ ...file, minutes_left: null }).says, "on");
  assert.equal(words.recording(null).says, "not recorded");
});

test("what is wrong is said, the worst first, and what explains it keeps its consequence from being said, too", () => {
  assert.deepEqual(keys({}, WELL), ["well"]);
  assert.deepEqual(keys({ open: false, lost_s: 3, next_s: 1 }, WELL), ["line"]);
  assert.deepEqual(keys({ open: false, ever: false }, null), ["line"]);
  assert.deepEqual(keys({}, null), ["account"]);
  assert.deepEqual(keys({}, { ...WELL, ended: true }), ["ended"]);
  assert.deepEqual(keys({ open: false, lost_s: 3 }, { ...WELL, ended: true }), ["ended"]);
  assert.deepEqual(keys({ open: false, gone: true, lost_s: 3 }, WELL), ["ended"]);
  assert.deepEqual(keys({}, { ...WELL, still: ["insertion"] }), ["still insertion"]);
  assert.deepEqual(keys({}, { ...WELL, frozen_s: 4 }, 9), ["frozen"]);
  assert.deepEqual(keys({}, WELL, 3), ["blank"]);
  assert.deepEqual(keys({}, WELL, 1.5), ["well"]);
  const silent = { ...WELL, devices: [{ ...WELL.devices[0], state: "silent", why: "check the cable" }, WELL.devices[1]] };
  assert.deepEqual(keys({}, { ...silent, bent: true }, 9), ["device tracking silent locked", "bent"]);
  assert.match(troubles({ line: OPEN, account: silent, blank_s: 0 })[0].more, /check the cable/);
  const held = { ...WELL, devices: [{ ...WELL.devices[0], clock: "holdover" }] };
  assert.deepEqual(keys({}, held), ["device tracking running holdover"]);
  const file = { path: "a", bytes: 1, minutes_left: 3, lost: 0, trouble: "the disk is full" };
  assert.deepEqual(keys({}, { ...WELL, recording: file }), ["disk the disk is full", "room"]);
  assert.deepEqual(keys({}, { ...WELL, slices: 0 }), ["first"]);
});

test("the guidance's speed stands among what the volume needs, and what is bad is said at the top", () => {
  const speed = {
    verdict: "good", says: "good: 31 mm/s", mm_per_s: 30, across_mm_per_s: 29, edge_mm_per_s: 31.2, slices_per_s: 30,
    gapless_mm_per_s: 150, even_mm_per_s: 75, images_per_cm: 9.63,
  };
  const told = {
    spacing: { gapless_mm: 5, even_mm: 2.5 }, speed, contact: "there", sensors: [], advice: [],
    holes: { open: 0, closed: 0, beyond: 0, nearest: null },
  };
  const { how, says, facts, gauge } = words.guidance(told);
  assert.deepEqual([how, says], ["well", "good · 31 mm/s"]);
  assert.deepEqual(facts.map(({ how, strong, says }) => [how, strong, says]), [["plain", "9.6", "images/cm; at least 2.0"], ["plain", "nothing", "left out"]]);
  assert.ok(Math.abs(gauge.zones[0] - 0.4) < 1e-9 && Math.abs(gauge.zones[1] - 0.4) < 1e-9 && Math.abs(gauge.zones[2] - 0.2) < 1e-9);
  assert.ok(Math.abs(gauge.at - 31.2 / 187.5) < 1e-9);
  const at = (changes) => words.guidance({ ...told, speed: { ...speed, ...changes } });
  assert.deepEqual([at({ verdict: "too-fast", edge_mm_per_s: 160 }).how, at({ verdict: "too-fast", edge_mm_per_s: 160 }).says], ["bad", "too fast · 160 mm/s"]);
  assert.equal(at({ verdict: "too-fast", edge_mm_per_s: 900 }).gauge.at, 1);
  assert.equal(at({ verdict: "fast", edge_mm_per_s: 90 }).how, "heed");
  const still = at({ verdict: "still", images_per_cm: null });
  assert.deepEqual([still.says, still.facts[0].strong], ["still", "–"]);
  assert.equal(at({ verdict: "sideways", mm_per_s: 40 }).says, "sideways · 40 mm/s");
  assert.deepEqual([words.guidance({ ...told, speed: null }).says, words.guidance({ ...told, speed: null }).gauge], ["no slices", null]);
  assert.deepEqual(words.guidance(null), { how: "plain", says: "–", facts: [], gauge: null, advice: [] });
  const left = (holes) => words.guidance({ ...told, holes: { ...told.holes, ...holes } }).facts[1];
  assert.deepEqual([left({ open: 1, nearest: "go back 14 mm" }).strong, left({ open: 1, nearest: "go back 14 mm" }).says], ["1 part", "left out: go back 14 mm"]);
  assert.equal(left({ open: 96, beyond: 3 }).says, "left out, and 3 gaps beyond");
  assert.equal(left({ closed: 2 }).says, "left out any more; 2 parts found again");
  const advice = [{ how: "bad", key: "contact", sentence: "No contact.", more: "m" }, { how: "bad", key: "frozen", sentence: "Frozen.", more: "" }, { how: "heed", key: "holes", sentence: "1 part.", more: "" }];
  assert.deepEqual(keys({}, { ...WELL, coach: { ...told, advice } }), ["guidance contact"]);
  assert.deepEqual(keys({}, { ...WELL, coach: told }), ["well"]);
});

test("the same trouble keeps its key while its numbers go on, so that it is spoken once", () => {
  const at = (lost_s, next_s) => troubles({ line: { open: false, ever: true, lost_s, next_s }, account: WELL, blank_s: null })[0];
  assert.equal(at(3, 1).key, at(60, 5).key);
  assert.notEqual(at(3, 1).more, at(60, 5).more);
});

test("a picture's header is read, and what is none is refused by a sentence", () => {
  const bytes = new ArrayBuffer(40 + 6);
  const to = new DataView(bytes);
  to.setUint8(0, 2);
  to.setUint8(1, 1);
  to.setUint16(2, 3, true);
  to.setUint32(4, 2, true);
  to.setUint32(8, 1, true);
  to.setUint32(12, 7, true);
  to.setFloat64(16, 1.5e12, true);
  to.setFloat64(24, 1.5e12 + 20, true);
  to.setBigUint64(32, 123n, true);
  const { header, pixels } = parse(bytes);
  assert.deepEqual(header, {
    kind: 2, encoding: 1, refining: true, timed: false, width: 2, height: 1, sequence: 7, captured: 1.5e12, sent: 1.5e12 + 20, frame: 123,
  });
  assert.equal(pixels.length, 6);
  assert.throws(() => parse(bytes.slice(0, 39)), /39 bytes has no header/);
  assert.throws(() => parse(bytes.slice(0, 45)), /5 bytes instead of 6/);
  to.setUint32(4, 0xffffffff, true);
  assert.throws(() => parse(bytes), /4294967295 × 1 pixels/);
  to.setUint8(0, 8);
  assert.throws(() => parse(bytes), /kind 8/);
});

test("a voxel has its interval, and where another sweep would halve it that is said", () => {
  assert.equal(words.readout({ value: 81.5, error: null, slices: null, halved_by: null }), "grey 82");
  const known = { value: 81.52, error: 6.24, slices: 2.34, halved_by: null };
  assert.equal(words.readout(known), "grey 81.5 ± 6.2, 2.3 slices");
  assert.equal(words.readout({ ...known, halved_by: 7.02 }), "grey 81.5 ± 6.2, 2.3 slices; sweep here again: 8 more halve the error");
});

test("quantiles are samples of the nearest rank", () => {
  assert.equal(quantile([], 0.5), null);
  assert.equal(quantile([3, 1, 2], 0.5), 2);
  assert.equal(quantile([3, 1, 2, 4], 0.99), 4);
});
