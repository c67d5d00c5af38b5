// The live B-mode image and the view of the volume: they move at the screen's pace, and only
// while the page is visible.

import assert from "node:assert/strict";
import { setTimeout as wait } from "node:timers/promises";
import { test } from "node:test";

import { close, difference, drawn, greys, look, measured, open, says, SIZES, shot } from "./page.js";
import { shared } from "./session.js";

test("the page stands at once, and both pictures move", async (t) => {
  const { address } = await shared();
  const seen = await open(address);
  const { page } = seen;
  const paint = await page.waitForFunction(() => performance.getEntriesByType("paint").find(({ name }) => name === "first-contentful-paint")?.startTime);
  t.diagnostic(`first paint after ${(await paint.jsonValue()).toFixed(0)} ms`);
  for (const name of ["slice", "view"]) {
    await drawn(page, name, 3);
    const before = await greys(page, name);
    assert.ok(Math.max(...before.grey) > 40, `${name}: something is in it`);
    // A volume that many slices entered already changes slowly.
    let moved = 0;
    for (let tens = 0; moved <= 0.05 && tens < 20; tens++) {
      await drawn(page, name, 10);
      moved = difference(before, await greys(page, name));
    }
    assert.ok(moved > 0.05, `${name}: it moves (by ${moved.toFixed(2)} of 255)`);
  }
  await says(page, "All is well");
  const { account, pictures } = await measured(page);
  assert.ok(account.slices > 0);
  assert.ok(pictures.slice.width > 0 && pictures.slice.frame > 0);
  assert.deepEqual(seen.complaints, []);
});

test("from when a picture was due to its pixels on the screen", async (t) => {
  const { address } = await shared();
  const seen = await open(address);
  await drawn(seen.page, "slice", 60);
  await seen.page.waitForFunction(() => Object.values(window.sonoweave.latencies).every(({ length }) => length > 5));
  const { latencies, decodes, pictures } = await measured(seen.page);
  const share = (values, q) => [...values].sort((a, b) => a - b)[Math.max(0, Math.ceil(q * values.length) - 1)];
  for (const name of ["slice", "view"]) {
    const of = latencies[name];
    assert.ok(of.length > 5, `${name}: ${of.length} were measured`);
    assert.ok(of.every((ms) => ms > 0), `${name}: none is on the screen before it was due`);
    // The lateness depends on the machine: `make console-reach` measures it.
    const { width, height, left_out: out } = pictures[name];
    t.diagnostic(`${name} ${width} × ${height}: on the screen after p50 ${share(of, 0.5).toFixed(0)} ms, p95 ${share(of, 0.95).toFixed(0)} ms, of which here p95 ${share(decodes[name], 0.95).toFixed(1)} ms; ${of.length} pictures, ${out} left out`);
  }
});

test("a hidden page is sent nothing, and one that is seen again goes on", async () => {
  const { address } = await shared();
  const seen = await open(address);
  await drawn(seen.page, "slice", 5);
  await look(seen.page, "hidden");
  // Pictures under way arrive.
  await wait(1500);
  const before = seen.binary;
  await wait(3000);
  assert.equal(seen.binary - before, 0);
  assert.ok((await measured(seen.page)).connected, "the line stays");
  await look(seen.page, "visible");
  await drawn(seen.page, "slice", 5);
  await drawn(seen.page, "view", 2);
});

test("the picture is as wide and high as the tissue, with its scale and marker, and lies wholly on the screen", async () => {
  const { address } = await shared();
  for (const [name, size] of Object.entries(SIZES)) {
    const seen = await open(address, { size });
    const { page } = seen;
    await drawn(page, "slice", 3);
    await drawn(page, "view", 3);
    await page.waitForFunction(() => window.sonoweave.account !== null);
    const { pictures } = await measured(page);
    const about = await page.evaluate(() => window.sonoweave.about);
    const [u, v] = about.pixel_mm;
    const box = await page.locator("#slice").boundingBox();
    const aspect = (pictures.slice.width * u) / (pictures.slice.height * v);
    assert.ok(Math.abs(box.width / box.height / aspect - 1) < 0.02, `${name}: ${box.width} × ${box.height} for ${aspect}`);
    assert.ok(box.y + box.height <= size.height && box.width > 380, `${name}: seen, and large`);
    const depths = await page.locator("#slice-scale .depth").allTextContents();
    const last = Number(depths.at(-1));
    assert.ok(last * 10 <= pictures.slice.height * v && last * 10 > (pictures.slice.height * v) / 2, `${name}: numbers to ${last} cm`);
    const marker = await page.locator("#slice-scale .marker").boundingBox();
    const left = marker.x + marker.width / 2 < box.x + box.width / 2;
    assert.equal(left ? "left" : "right", about.marker, name);
    const [across, down] = await page.evaluate(() => [document.documentElement.scrollWidth - innerWidth, document.documentElement.scrollHeight]);
    assert.ok(across <= 0, `${name}: nothing lies beside the screen`);
    assert.ok(down < 2 * size.height, `${name}: ${down} pixels high`);
    await says(page, "All is well");
    await shot(page, `page-${name}`);
    assert.deepEqual(seen.complaints, []);
    await close(seen);
  }
});

test("the page asks nobody but its own session", async () => {
  const { address } = await shared();
  const seen = await open(address);
  await drawn(seen.page, "slice", 1);
  const origin = new URL(address).origin;
  assert.deepEqual(seen.requests.filter((url) => new URL(url).origin !== origin), []);
  assert.ok(seen.requests.length > 5);
  const policy = (await seen.page.request.get(address)).headers()["content-security-policy"];
  assert.match(policy, /default-src 'none'; script-src 'self'; style-src 'self'/);
});

test("grey, colour and JPEG are drawn as they are, the newest only, and each is answered once", async () => {
  const { address } = await shared();
  const { page } = await open(address);
  const { answers, seen } = await page.evaluate(async () => {
    const { Picture } = await import("/page/picture.js");
    const canvas = document.createElement("canvas");
    const answers = [];
    const picture = new Picture(canvas, (header, drawn) => answers.push([header.sequence, drawn]));
    const frame = () => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)));
    const pixels = () => [...canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data];
    const seen = {};
    picture.offer({ encoding: 0, width: 2, height: 1, sequence: 1 }, new Uint8Array([9, 9]));
    picture.offer({ encoding: 0, width: 2, height: 1, sequence: 2 }, new Uint8Array([0, 200]));
    await frame();
    seen.grey = pixels();
    picture.offer({ encoding: 1, width: 1, height: 2, sequence: 4 }, new Uint8Array([10, 20, 30, 255, 0, 128]));
    await frame();
    seen.colour = pixels();
    picture.offer({ encoding: 0, width: 2, height: 1, sequence: 3 }, new Uint8Array([9, 9]));
    await frame();
    const source = Object.assign(document.createElement("canvas"), { width: 16, height: 16 });
    const context = source.getContext("2d");
    context.fillStyle = "rgb(200, 100, 50)";
    context.fillRect(0, 0, 16, 16);
    const blob = await new Promise((resolve) => source.toBlob(resolve, "image/jpeg", 0.95));
    await picture.offer({ encoding: 2, width: 16, height: 16, sequence: 5 }, new Uint8Array(await blob.arrayBuffer()));
    await frame();
    seen.jpeg = pixels().slice(0, 3);
    await picture.offer({ encoding: 2, width: 16, height: 16, sequence: 6 }, new Uint8Array([1, 2, 3]));
    picture.offer({ encoding: 0, width: 2, height: 1, sequence: 7 }, new Uint8Array([9, 9]));
    picture.forget();
    await frame();
    seen.kept = pixels().length;
    const late = picture.offer({ encoding: 2, width: 16, height: 16, sequence: 99 }, new Uint8Array(await blob.arrayBuffer()));
    picture.restart();
    await late;
    picture.offer({ encoding: 0, width: 2, height: 1, sequence: 1 }, new Uint8Array([5, 6]));
    await frame();
    seen.next = pixels();
    return { answers, seen };
  });
  assert.deepEqual(seen.grey, [0, 0, 0, 255, 200, 200, 200, 255]);
  assert.deepEqual(seen.colour, [10, 20, 30, 255, 255, 0, 128, 255]);
  assert.ok([200, 100, 50].every((value, n) => Math.abs(value - seen.jpeg[n]) <= 4), seen.jpeg.join());
  assert.equal(seen.kept, 16 * 16 * 4, "what was forgotten was not drawn");
  assert.deepEqual(seen.next, [5, 5, 5, 255, 6, 6, 6, 255], "the next session's first, and not the last one's last");
  assert.deepEqual(answers, [[1, false], [2, true], [4, true], [3, false], [5, true], [6, false], [7, false], [1, true]]);
});

// Returns all pixels of the B-mode image in the canvas.
const pixels = (page) =>
  page.evaluate(() => {
    const canvas = document.getElementById("slice");
    const copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height }).getContext("2d");
    copy.drawImage(canvas, 0, 0);
    const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
    return Array.from({ length: data.length / 4 }, (_, n) => data[4 * n]);
  });

test("the scanner's greys are dragged and pressed as far as is said, on this page alone, and a double-click leads back", async () => {
  const { address } = await shared();
  const seen = await open(address);
  const { page } = seen;
  await drawn(page, "slice", 5);
  const caption = page.locator("#slice-caption");
  assert.doesNotMatch(await caption.innerText(), /greys/);
  // The last picture stays while the page is hidden, so that it can be compared.
  await look(page, "hidden");
  await wait(1500);
  const before = await pixels(page);
  assert.ok(before.some((grey) => grey > 40 && grey < 200));
  const shown = async () => {
    await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
    const { level, width } = (await measured(page)).tone;
    const expected = (grey) => Math.min(255, Math.max(0, 255 * ((grey - level) / width + 0.5)));
    const found = await pixels(page);
    const off = found.reduce((most, grey, n) => Math.max(most, Math.abs(grey - expected(before[n]))), 0);
    assert.ok(off <= 0.51, `${off} levels off at level ${level}, width ${width}`);
    return { level, width };
  };
  assert.deepEqual(await shown(), { level: 127.5, width: 255 });
  const box = await page.locator("#slice").boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x - 100, y - 60, { steps: 5 });
  await page.mouse.up();
  const dragged = await shown();
  assert.ok(dragged.width < 255 && dragged.level < 127.5, JSON.stringify(dragged));
  const says = `greys: level ${Math.round(dragged.level)}, width ${Math.round(dragged.width)}`;
  assert.ok((await caption.innerText()).startsWith(says), "before all that may be cut");
  assert.equal(await page.locator("#announcer").innerText(), says);
  await page.locator("#slice").focus();
  for (const key of ["ArrowRight", "ArrowDown", "ArrowDown"]) await page.keyboard.press(key);
  const pressed = await shown();
  assert.ok(pressed.width > dragged.width && pressed.level > dragged.level);
  await shot(page, "greys-dragged");
  await page.mouse.dblclick(x, y);
  assert.deepEqual(await shown(), { level: 127.5, width: 255 });
  assert.doesNotMatch(await caption.innerText(), /greys/);
  // The next pictures are displayed alike.
  await page.keyboard.press("ArrowUp");
  await look(page, "visible");
  await drawn(page, "slice", 3);
  assert.match(await caption.innerText(), /^greys: level 120, width 255/);
  await page.keyboard.press("Home");
  assert.doesNotMatch(await caption.innerText(), /greys/);
  assert.deepEqual(seen.complaints, []);
});

test("nothing that matters is cut on a tablet with planes", async () => {
  const { address } = await shared();
  for (const name of ["lying", "upright"]) {
    const seen = await open(address, { size: SIZES[name] });
    const { page } = seen;
    await says(page, "All is well");
    await page.keyboard.press("p");
    await page.waitForFunction(() => Object.values(window.sonoweave.planes.pictures).every(({ drawn }) => drawn > 0));
    const cut = () =>
      page.evaluate(() => {
        const all = [...document.querySelectorAll(".vital, .sides button, .plane-head, .plane-head span, .measure button, .measure-says, .levels-side button, #planes-caption")];
        return all.filter((one) => one.checkVisibility() && one.scrollWidth > one.clientWidth && one.clientWidth > 0).map(({ textContent }) => textContent);
      });
    assert.deepEqual(await cut(), [], name);
    await shot(page, `planes-whole-${name}`);
    await page.keyboard.press("m");
    assert.deepEqual(await cut(), [], `${name}, measuring`);
    const wide = await page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);
    assert.ok(wide[0] <= wide[1], `${name}: ${wide}`);
    await close(seen);
  }
});
