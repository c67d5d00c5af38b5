// Known dimensions of the doll in the water tank, and their measurement on the planes.

import assert from "node:assert/strict";

import { measured } from "./page.js";

/// Distance of the legs' axes at z = −45 mm; see crates/phantom/src/body/doll.rs.
export const LEGS_MM = 27;
const LEGS_Z = -45;

// Returns the positions of both legs in the plane across z: the centroids of the bright pixels
// left and right of the middle, as fractions of its picture.
const legs = (page) =>
  page.evaluate(() => {
    const canvas = document.getElementById("plane-z");
    const { width, height } = canvas;
    const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
    const { origin, right, down } = window.sonoweave.planes.told[3];
    const found = [0, 1].map(() => ({ n: 0, x: 0, y: 0 }));
    for (let y = 0; y < height; y += 1) {
      for (let x = 0; x < width; x += 1) {
        const [r, g, b] = data.subarray(4 * (y * width + x), 4 * (y * width + x) + 3);
        const at = [0, 1, 2].map((n) => origin[n] + right[n] * x + down[n] * y);
        // Excludes the probe's face, the tank's floor, and everything beyond a leg's width.
        if (r !== g || g !== b || r < 60 || at[1] < -22 || at[1] > 6 || Math.abs(at[0]) > 26) continue;
        const side = found[at[0] < 0 ? 0 : 1];
        side.n += 1;
        side.x += x;
        side.y += y;
      }
    }
    return found.map(({ n, x, y }) => [x / n / width, y / n / height, n]);
  });

async function click(page, name, x, y) {
  const box = await page.locator(`#plane-${name}`).boundingBox();
  await page.mouse.click(box.x + x * box.width, box.y + y * box.height);
}

/// Moves the plane across z to the legs, and marks their middles; measuring must be open.
export async function markLegs(page) {
  const asked = await page.evaluate((z) => fetch("/v1/do", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ do: "cross", at: [0, 28, z] }) }).then(async (answer) => [answer.status, await answer.text()]), LEGS_Z);
  assert.equal(asked[0], 200, asked[1]);
  // Voxels may be some millimetres wide.
  await page.waitForFunction((z) => Math.abs(window.sonoweave.planes.told[3].origin[2] - z) <= window.sonoweave.planes.told[3].voxel_mm, LEGS_Z);
  await page.waitForTimeout(500);
  const [left, right] = await legs(page);
  assert.ok(left[2] > 40 && right[2] > 40, `both legs are seen: ${left} ${right}`);
  await click(page, "z", left[0], left[1]);
  assert.equal((await measured(page)).measure.points.length, 1);
  await click(page, "z", right[0], right[1]);
}
