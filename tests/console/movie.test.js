// A movie of the view, recorded by the browser.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { test } from "node:test";

import { open, settled, steers } from "./page.js";
import { shared } from "./session.js";

test("recorded view is a movie of its size and time, and it turns", async () => {
  const { address } = await shared();
  const seen = await open(address);
  const { page } = seen;
  await steers(page, true);
  await page.waitForFunction(() => window.sonoweave.account?.slices > 250);
  await settled(page);
  const button = page.locator("#view-record");
  assert.equal(await button.getAttribute("aria-pressed"), "false");
  await button.click();
  assert.equal(await button.getAttribute("aria-pressed"), "true");
  await page.locator("#view").focus();
  for (let n = 0; n < 12; n += 1) {
    await page.keyboard.press("ArrowRight");
    await settled(page);
  }
  await page.waitForFunction(() => /^0:0[2-9]$|^0:[1-9]/.test(document.getElementById("view-recorded").textContent));
  const [saved] = await Promise.all([page.waitForEvent("download"), button.click()]);
  assert.match(saved.suggestedFilename(), /^sonoweave-view-\d{8}-\d{6}\.(mp4|webm)$/);
  assert.equal(await button.getAttribute("aria-pressed"), "false");
  const { kind, movies } = await page.evaluate(() => window.sonoweave.movie);
  assert.equal(movies, 1);
  const bytes = await readFile(await saved.path());
  const size = await page.evaluate(() => ["width", "height"].map((edge) => document.getElementById("view")[edge]));
  // Another page plays it: pictures apart by a second differ.
  const player = await page.context().newPage();
  const played = await player.evaluate(
    async ([data, kind]) => {
      const video = document.createElement("video");
      video.muted = true;
      video.src = URL.createObjectURL(new Blob([Uint8Array.from(atob(data), (c) => c.charCodeAt(0))], { type: kind }));
      const next = (name) => new Promise((resolve, reject) => {
        video.addEventListener(name, resolve, { once: true });
        video.addEventListener("error", () => reject(new Error(video.error.message)), { once: true });
      });
      await next("loadeddata");
      const size = [video.videoWidth, video.videoHeight];
      // Without a length in the file, seeking beyond it gives the length.
      const seek = async (time) => {
        const done = next("seeked");
        video.currentTime = time;
        await done;
        return video.currentTime;
      };
      const pixels = () => {
        const canvas = Object.assign(document.createElement("canvas"), { width: size[0], height: size[1] });
        const to = canvas.getContext("2d");
        to.drawImage(video, 0, 0);
        return to.getImageData(0, 0, size[0], size[1]).data;
      };
      await seek(0);
      const first = pixels();
      const length = await seek(1e6);
      await seek(length / 2);
      const later = pixels();
      let sum = 0;
      for (let n = 0; n < first.length; n += 4) sum += Math.abs(first[n] - later[n]);
      return { size, length, apart: sum / (first.length / 4) };
    },
    [bytes.toString("base64"), kind],
  );
  assert.deepEqual(played.size, size);
  assert.ok(played.length > 1.5 && played.length < 120, `${played.length} s`);
  assert.ok(played.apart > 1, `pictures differ by ${played.apart.toFixed(2)} grey levels`);
  assert.deepEqual(seen.complaints, []);
});
