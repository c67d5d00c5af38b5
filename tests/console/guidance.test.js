// Scan guidance: the probe's speed is visible at a glance, bad guidance appears in the banner,
// and missed regions are marked in the view.

import assert from "node:assert/strict";
import { test } from "node:test";

import { banner, drawn, open, says, shot, SIZES } from "./page.js";
import { installed } from "./place.js";
import { shared } from "./session.js";

const axe = installed("axe-core");

const TOO_FAST = {
  spacing: { gapless_mm: 5.15, even_mm: 2.35 },
  speed: {
    verdict: "too-fast", says: "too fast: 182 mm/s where 155 mm/s leaves no gaps", mm_per_s: 170, across_mm_per_s: 165, edge_mm_per_s: 182,
    slices_per_s: 30, gapless_mm_per_s: 155, even_mm_per_s: 71, images_per_cm: 1.65,
  },
  holes: { open: 2, closed: 1, beyond: 0, forgotten: 0, widest_mm: 9, nearest: "go back 14 mm", points: 100 },
  contact: "there",
  sensors: [],
  advice: [
    { how: "bad", key: "too-fast", sentence: "Slow down: 182 mm/s where 155 mm/s leaves no gaps.", more: "Slices lie too far apart across the picture." },
    { how: "heed", key: "holes", sentence: "2 parts were left out: go back 14 mm.", more: "" },
  ],
  slices: 100,
  pictures: 30,
};
const GOOD = {
  spacing: { gapless_mm: 5.15, even_mm: 2.35 },
  speed: {
    verdict: "good", says: "good: 18 mm/s", mm_per_s: 17, across_mm_per_s: 16, edge_mm_per_s: 18,
    slices_per_s: 30, gapless_mm_per_s: 155, even_mm_per_s: 71, images_per_cm: 17,
  },
  holes: { open: 0, closed: 0, beyond: 0, forgotten: 0, widest_mm: 0, nearest: null, points: 0 },
  contact: "there",
  sensors: [],
  advice: [],
  slices: 100,
  pictures: 30,
};
const HOLES = [[[100, 120], [200, 110], [210, 260], [110, 270]], [[230, 120], [300, 110], [310, 260], [240, 270]]];
const PRESENT = [[320, 120], [420, 110], [430, 260], [330, 270]];

// Opens a page whose session's guidance is replaced by `coach`. Given `holes` replace the
// session's marks.
async function guided({ coach, holes, size = SIZES.desk }) {
  const { address } = await shared();
  const through = (socket) => {
    const server = socket.connectToServer();
    server.onMessage((message) => {
      if (typeof message !== "string") return socket.send(message);
      const word = JSON.parse(message);
      if (word.marks && holes) return undefined;
      if (word.account && coach) Object.assign(word.account.coach, coach);
      if (word.account && holes) socket.send(JSON.stringify({ marks: { sequence: 1, size: [512, 512], present: PRESENT, holes } }));
      return socket.send(JSON.stringify(word));
    });
  };
  const seen = await open(address, { through, size });
  await drawn(seen.page, "slice", 2);
  return seen;
}

const vital = (page, words) => page.locator("#guidance-vital", { hasText: words }).waitFor();

test("a sweep at a good speed is told as one", async () => {
  const { page, complaints } = await guided({ coach: GOOD });
  await vital(page, "✓ good · 18 mm/s");
  assert.equal(await page.locator("#guidance-gauge").getAttribute("aria-label"), "Speed across the picture: good: 18 mm/s; even up to 71 mm/s, without gaps up to 155 mm/s");
  assert.match(await page.locator("#guidance-facts").innerText(), /17 images\/cm[^]*nothing\s+left out/);
  const needle = await page.locator("#guidance-gauge .needle").boundingBox();
  const even = await page.locator("#guidance-gauge .even").boundingBox();
  assert.ok(needle.x + needle.width / 2 <= even.x + even.width + 1, "the needle is in the zone that is good");
  assert.deepEqual(complaints, []);
  await shot(page, "guidance-good");
});

// A slow machine leaves pictures out, so that any verdict may be the true one.
test("the session's own speed is told, and the present slice is marked where the view is", async () => {
  const { page, complaints } = await guided({});
  await drawn(page, "view", 1);
  await vital(page, /[a-z] · \d+ mm\/s/);
  assert.match(await page.locator("#guidance-gauge").getAttribute("aria-label"), /\d+ mm\/s/);
  assert.match(await page.locator("#guidance-facts").innerText(), /images\/cm/);
  await page.locator("#view-marks .present").waitFor({ state: "attached" });
  const [marks, view] = await Promise.all(["#view-marks", "#view"].map((id) => page.locator(id).boundingBox()));
  assert.deepEqual(marks, view);
  const [width, height] = (await page.locator("#view-marks").getAttribute("viewBox")).split(" ").slice(2).map(Number);
  const path = await page.locator("#view-marks .present").getAttribute("d");
  const corners = path.match(/-?[\d.]+/g).map(Number);
  assert.equal(corners.length, 8);
  // It lies in the picture, or hardly beside it.
  assert.ok(corners.every((place, n) => place > -0.5 * [width, height][n % 2] && place < 1.5 * [width, height][n % 2]), path);
  const [hidden, left] = await page.evaluate(() => [document.querySelector("#view-legend").hidden, document.querySelectorAll("#view-marks .hole").length]);
  assert.equal(hidden, left === 0, "the legend is there when a mark needs it");
  assert.deepEqual(complaints, []);
});

test("what is too fast is said at the top, large on the card, and beside the zone that is good", async () => {
  for (const [name, size] of Object.entries(SIZES)) {
    const { page, complaints } = await guided({ coach: TOO_FAST, holes: HOLES, size });
    await says(page, "Slow down: 182 mm/s where 155 mm/s leaves no gaps.");
    assert.match(await banner(page), /✕/);
    await vital(page, "✕ too fast · 182 mm/s");
    const { fontSize } = await page.locator("#guidance-vital").evaluate((element) => ({ fontSize: parseFloat(getComputedStyle(element).fontSize) }));
    assert.ok(fontSize >= 25, `${fontSize} px`);
    const cut = await page.locator("#guidance-vital").evaluate((element) => element.scrollWidth > element.clientWidth);
    assert.equal(cut, false, `${name}: the speed is read whole`);
    assert.match(await page.locator("#guidance-facts").innerText(), /1\.6|1\.7/);
    assert.match(await page.locator("#guidance-facts").innerText(), /2 parts\s+left out: go back 14 mm/);
    assert.match(await page.locator("#guidance-advice").innerText(), /Slow down: 182/);
    const needle = await page.locator("#guidance-gauge .needle").boundingBox();
    const gaps = await page.locator("#guidance-gauge .gaps").boundingBox();
    assert.ok(needle.x + needle.width / 2 >= gaps.x, "the needle is where gaps are");
    await page.locator("#view-marks .hole").first().waitFor({ state: "attached" });
    assert.equal(await page.locator("#view-marks .hole").count(), 2);
    assert.match(await page.locator("#view-legend").innerText(), /left out[^]*slice now/);
    const { height } = await page.locator("#view-legend").boundingBox();
    assert.ok(height < 30, `${name}: the legend is one line, not ${height} px`);
    const ground = await page.locator("#view-legend-slice").evaluate((element) => getComputedStyle(element).backgroundImage);
    assert.equal(ground, "none", "its words are not hatched");
    await page.evaluate(axe.source);
    const { violations } = await page.evaluate(() => axe.run());
    assert.deepEqual(violations.map(({ id, nodes }) => `${id} ${nodes.map(({ html }) => html).join()}`), [], name);
    assert.deepEqual(complaints, []);
    await shot(page, `guidance-${name}`);
  }
});

test("lost contact is said at the top with what to do", async () => {
  const advice = [{ how: "bad", key: "contact", sentence: "No contact: add gel and press the probe on.", more: "Nothing comes back from the depth of the picture." }];
  const { page } = await guided({ coach: { contact: "lost", advice } });
  await says(page, "No contact: add gel and press the probe on.");
  assert.match(await page.locator("#guidance-facts").innerText(), /no contact/);
  assert.match(await page.locator("#announcer").textContent(), /No contact/);
});
