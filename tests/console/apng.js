// A moving picture from screenshots: an APNG with one palette. Pixels that have not changed are
// transparent, so that a frame takes little more than its changes.

import { crc32, deflateSync, inflateSync } from "node:zlib";

const SIGNATURE = Buffer.from([0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a]);
/// Index of the transparent colour.
const CLEAR = 255;

function* chunks(png) {
  for (let at = SIGNATURE.length; at < png.length; ) {
    const length = png.readUInt32BE(at);
    yield [png.toString("latin1", at + 4, at + 8), png.subarray(at + 8, at + 8 + length)];
    at += length + 12;
  }
}

function chunk(name, data) {
  const body = Buffer.concat([Buffer.from(name, "latin1"), data]);
  const ends = Buffer.alloc(8);
  ends.writeUInt32BE(data.length, 0);
  ends.writeUInt32BE(crc32(body), 4);
  return Buffer.concat([ends.subarray(0, 4), body, ends.subarray(4)]);
}

// Returns the pixels of a PNG of eight bits a channel, as three bytes each.
function pixels(png) {
  const parts = [];
  let [width, height, channels] = [0, 0, 0];
  for (const [name, data] of chunks(png)) {
    if (name === "IHDR") {
      [width, height, channels] = [data.readUInt32BE(0), data.readUInt32BE(4), { 2: 3, 6: 4 }[data[9]]];
      if (data[8] !== 8 || !channels || data[12]) throw new Error("not a plain screenshot");
    }
    if (name === "IDAT") parts.push(data);
  }
  const raw = inflateSync(Buffer.concat(parts));
  const stride = width * channels;
  const rows = Buffer.alloc(stride * height);
  for (let y = 0; y < height; y += 1) {
    const filter = raw[y * (stride + 1)];
    for (let x = 0; x < stride; x += 1) {
      const a = x >= channels ? rows[y * stride + x - channels] : 0;
      const b = y ? rows[(y - 1) * stride + x] : 0;
      const c = x >= channels && y ? rows[(y - 1) * stride + x - channels] : 0;
      const p = a + b - c;
      const nearest = Math.abs(p - a) <= Math.abs(p - b) && Math.abs(p - a) <= Math.abs(p - c) ? a : Math.abs(p - b) <= Math.abs(p - c) ? b : c;
      rows[y * stride + x] = raw[y * (stride + 1) + 1 + x] + [0, a, b, (a + b) >> 1, nearest][filter];
    }
  }
  const rgb = Buffer.alloc(3 * width * height);
  for (let n = 0; n < width * height; n += 1) rows.copy(rgb, 3 * n, channels * n, channels * n + 3);
  return { width, height, rgb };
}

// A colour with fewer levels, as a number.
const coarse = (rgb, n) => ((rgb[3 * n] >> 2) << 12) | ((rgb[3 * n + 1] >> 2) << 6) | (rgb[3 * n + 2] >> 2);
const fine = (key) => [key >> 12, (key >> 6) & 63, key & 63].map((level) => (level << 2) | (level >> 4));

// Returns the most frequent colours, and the index of the nearest one by colour.
function palette(frames) {
  const counts = new Map();
  for (const { width, height, rgb } of frames) {
    for (let n = 0; n < width * height; n += 1) counts.set(coarse(rgb, n), (counts.get(coarse(rgb, n)) ?? 0) + 1);
  }
  const colours = [...counts.keys()].sort((a, b) => counts.get(b) - counts.get(a) || a - b).slice(0, CLEAR).map(fine);
  const away = ([r, g, b], [s, h, c]) => (r - s) ** 2 + (g - h) ** 2 + (b - c) ** 2;
  const nearest = (colour) => colours.reduce((best, other, n) => (away(other, colour) < away(colours[best], colour) ? n : best), 0);
  return { colours, index: new Map([...counts.keys()].map((key) => [key, nearest(fine(key))])) };
}

const compressed = (width, height, indices) => {
  const raw = Buffer.alloc((width + 1) * height);
  for (let y = 0; y < height; y += 1) indices.copy(raw, y * (width + 1) + 1, y * width, (y + 1) * width);
  return deflateSync(raw, { level: 9 });
};

/// Returns an APNG of screenshots (PNG), each with its time of display in ms. It repeats for ever.
export function moving(shots) {
  const frames = shots.map(({ png }) => pixels(png));
  const [{ width, height }] = frames;
  const { colours, index } = palette(frames);
  const header = Buffer.alloc(13);
  header.writeUInt32BE(width, 0);
  header.writeUInt32BE(height, 4);
  header.set([8, 3], 8);
  const plays = Buffer.alloc(8);
  plays.writeUInt32BE(frames.length, 0);
  const opacities = Buffer.alloc(CLEAR + 1, 255);
  opacities[CLEAR] = 0;
  const table = Buffer.alloc(3 * (CLEAR + 1));
  colours.forEach((colour, n) => table.set(colour, 3 * n));
  const out = [SIGNATURE, chunk("IHDR", header), chunk("PLTE", table), chunk("tRNS", opacities), chunk("acTL", plays)];
  let [sequence, before] = [0, null];
  frames.forEach(({ rgb }, n) => {
    const whole = Buffer.alloc(width * height);
    for (let at = 0; at < whole.length; at += 1) whole[at] = index.get(coarse(rgb, at));
    const changed = before ? Buffer.from(whole.map((colour, at) => (colour === before[at] ? CLEAR : colour))) : whole;
    before = whole;
    const control = Buffer.alloc(26);
    control.writeUInt32BE(sequence++, 0);
    control.writeUInt32BE(width, 4);
    control.writeUInt32BE(height, 8);
    control.writeUInt16BE(shots[n].ms, 20);
    control.writeUInt16BE(1000, 22);
    // Nothing is cleared, and the frame is laid over the last one.
    control.set([0, n ? 1 : 0], 24);
    out.push(chunk("fcTL", control));
    const data = compressed(width, height, changed);
    if (n === 0) {
      out.push(chunk("IDAT", data));
    } else {
      const number = Buffer.alloc(4);
      number.writeUInt32BE(sequence++, 0);
      out.push(chunk("fdAT", Buffer.concat([number, data])));
    }
  });
  return Buffer.concat([...out, chunk("IEND", Buffer.alloc(0))]);
}
