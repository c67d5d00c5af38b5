// Planes through the volume: shown on request at their reported position, moved by pointer,
// wheel and keys of the page in control; and the style settings.

import assert from "node:assert/strict";
import { test } from "node:test";

import { close, difference, drawn, greys, listen, look, measured, open, PATIENCE, shot, SIZES, steers } from "./page.js";
import { installed } from "./place.js";
import { Session, shared } from "./session.js";

const axe = installed("axe-core");
const NAMES = { 3: "z", 4: "y", 5: "x", 6: "free" };

// Opens a page with control that shows planes, after the volume's first sweep.
async function planes(settings) {
  const { address } = await shared();
  return showing(address, 250, settings);
}

async function showing(address, slices, settings) {
  const seen = await open(address, settings);
  const { page } = seen;
  await steers(page, true);
  await page.waitForFunction((slices) => window.sonoweave.account?.slices > slices, slices).catch(async (error) => {
    // Prints why no slices arrive.
    console.log(JSON.stringify((await measured(page)).account));
    throw error;
  });
  await page.keyboard.press("p");
  await all(page);
  return seen;
}

const told = async (page) => (await measured(page)).planes.told;
const counts = async (page) => Object.values((await measured(page)).planes.pictures).map(({ drawn }) => drawn);

// Waits until each plane has been drawn.
const all = (page) => page.waitForFunction(() => Object.values(window.sonoweave.planes.pictures).every(({ drawn }) => drawn > 0));
// Waits until the description of a plane's last picture fulfils the condition.
async function until(page, kind, holds) {
  const begun = Date.now();
  for (;;) {
    const last = (await told(page))[kind];
    if (last && holds(last)) return last;
    assert.ok(Date.now() - begun < PATIENCE, `${NAMES[kind]}: ${holds} of ${JSON.stringify({ ...last, histogram: undefined })}`);
    await page.waitForTimeout(50);
  }
}

// Returns a plane's position in the world, along its normal.
function offset({ origin, right, down }) {
  const normal = [right[1] * down[2] - right[2] * down[1], right[2] * down[0] - right[0] * down[2], right[0] * down[1] - right[1] * down[0]];
  const long = Math.hypot(...normal);
  return normal.reduce((sum, x, n) => sum + x * origin[n], 0) / long;
}

// Returns the screen position of a point of a plane's canvas, given by fractions.
async function at(page, name, x, y) {
  const box = await page.locator(`#plane-${name}`).boundingBox();
  return [box.x + x * box.width, box.y + y * box.height];
}

// Counts the colours of a plane's canvas: grey pixels, and the blue of unseen ones.
const colours = (page, name) =>
  page.evaluate((name) => {
    const canvas = document.getElementById(`plane-${name}`);
    // The browser complains about reading the page's own canvas.
    const { width, height } = canvas;
    const copy = Object.assign(document.createElement("canvas"), { width, height }).getContext("2d");
    copy.drawImage(canvas, 0, 0);
    const { data } = copy.getImageData(0, 0, width, height);
    const found = { grey: 0, bright: 0, black: 0, blue: 0, other: 0 };
    for (let n = 0; n < data.length; n += 4) {
      const [r, g, b] = data.subarray(n, n + 3);
      if (r === g && g === b) {
        found.grey += 1;
        if (r > 60) found.bright += 1;
        if (r === 0) found.black += 1;
      } else if (b > g && g > r) found.blue += 1;
      else found.other += 1;
    }
    return found;
  }, name);

test("planes are drawn only when they are shown, fit a desk's screen and show what was seen and what was not", async (t) => {
  const { address } = await shared();
  const seen = await open(address);
  const { page } = seen;
  await steers(page, true);
  await drawn(page, "slice", 20);
  assert.deepEqual(await counts(page), [0, 0, 0, 0], "nobody has asked for them");
  assert.ok(!(await page.locator("#planes-panel").isVisible()));
  await page.waitForFunction(() => window.sonoweave.account?.slices > 250);
  await page.getByRole("button", { name: "Planes" }).click();
  await all(page);
  await drawn(page, "view", 1);
  await drawn(page, "slice", 2);
  const height = await page.evaluate(() => [document.documentElement.scrollHeight, innerHeight]);
  assert.ok(height[0] <= height[1], `everything is seen at once: ${height}`);
  // While the planes change, a busy machine may send JPEGs; static planes arrive lossless.
  await page.keyboard.press("f");
  await page.getByRole("button", { name: "Freeze", pressed: true }).waitFor();
  await page.waitForTimeout(500);
  await page.waitForFunction(() => Object.values(window.sonoweave.planes.pictures).every(({ whole }) => whole));
  const found = {};
  for (const name of Object.values(NAMES)) found[name] = await colours(page, name);
  await shot(page, "planes-desk");
  await page.keyboard.press("f");
  await page.getByRole("button", { name: "Freeze", pressed: false }).waitFor();
  for (const [name, of] of Object.entries(found)) {
    assert.equal(of.other, 0, `${name}: greys and the blue of what was not seen alone`);
    assert.ok(of.bright > 200 && of.black > 0 && of.blue > 200, `${name}: ${JSON.stringify(of)}`);
    const { width, height } = await page.locator(`#plane-${name}`).boundingBox();
    assert.ok(width > 60 && height > 120, `${name}: ${width} × ${height}`);
  }
  const lines = await page.locator("#plane-z + svg line[data-of]").evaluateAll((all) => all.map((line) => [line.dataset.of, line.getAttribute("stroke-dasharray")]));
  assert.deepEqual([...new Set(lines.map(([of]) => of))].sort(), ["free", "x", "y"]);
  assert.equal(new Set(lines.filter(([, dash]) => dash).map(([, dash]) => dash)).size, 3, "told apart by their dashes, too");
  // Hidden planes receive no pictures.
  await page.keyboard.press("p");
  assert.ok(!(await page.locator("#planes-panel").isVisible()));
  await drawn(page, "slice", 5);
  const before = await counts(page);
  await drawn(page, "slice", 30);
  assert.deepEqual(await counts(page), before);
  await page.keyboard.press("p");
  await page.waitForFunction((n) => window.sonoweave.planes.pictures[4].drawn > n, before[1]);
  await look(page, "hidden");
  await page.waitForTimeout(500);
  const hidden = await counts(page);
  await page.waitForTimeout(1000);
  assert.deepEqual(await counts(page), hidden, "a hidden page looks at nothing");
  t.diagnostic(`pictures of planes: ${hidden}`);
  assert.deepEqual(seen.complaints, []);
});

test("a click moves the cross there, the wheel goes through, arrows step by a voxel, and home leads back", async () => {
  const seen = await planes();
  const { page } = seen;
  await page.locator("#planes-home").click();
  // Waits for the clicked plane, and for the one that reports the movement.
  for (const kind of [3, 5]) await until(page, kind, ({ home }) => home);
  const before = await told(page);
  // A click in the plane across z moves those across x and y, but not itself.
  await page.mouse.click(...(await at(page, "z", 0.3, 0.6)));
  await until(page, 5, ({ home }) => !home);
  const moved = (await measured(page)).planes.cross;
  const { origin, right, down, size } = before[3];
  const wanted = origin.map((x, n) => x + right[n] * (0.3 * size[0] - 0.5) + down[n] * (0.6 * size[1] - 0.5));
  wanted.forEach((mm, n) => assert.ok(Math.abs(mm - moved[n]) < 1.5 * before[3].mm_per_px, `${moved} where ${wanted} was clicked at`));
  // The plane across x goes through it, in one of the next pictures.
  await until(page, 5, (last) => Math.abs(last.cross[0] - moved[0]) < 1e-9 && Math.abs(offset(last) - offset(before[5])) > 1);
  const after = await told(page);
  assert.ok(Math.abs(offset(after[3]) - offset(before[3])) < 1e-5, "it moved within it");
  // The wheel moves away from the viewer.
  const asked = await listen(page);
  await page.mouse.move(...(await at(page, "z", 0.3, 0.6)));
  await page.mouse.wheel(0, 110);
  const [wish, ...more] = await asked();
  assert.deepEqual([wish.do, more], ["cross", []]);
  const step = Math.hypot(...wish.at.map((x, n) => x - moved[n]));
  assert.ok(Math.abs(step - 2 * after[3].voxel_mm) < 1e-6, `two voxels: ${step} mm`);
  await until(page, 3, ({ cross }) => Math.abs(cross[2] - wish.at[2]) < 1e-9);
  // By keys: a voxel to the right, and back through.
  await page.locator("#plane-y").focus();
  await page.keyboard.press("ArrowRight");
  const [right1] = await asked();
  const along = right1.at.map((x, n) => x - wish.at[n]);
  assert.ok(Math.abs(Math.hypot(...along) - after[4].voxel_mm) < 1e-6, along.join());
  assert.ok(along.every((x, n) => x * after[4].right[n] >= -1e-12), "to the right");
  await page.keyboard.press("PageDown");
  const [through] = await asked();
  assert.ok(Math.abs(Math.hypot(...through.at.map((x, n) => x - right1.at[n])) - 2 * after[4].voxel_mm) < 1e-6);
  await page.keyboard.press("Home");
  assert.deepEqual(await asked(), [{ do: "reset", of: "planes" }]);
  await until(page, 5, ({ home }) => home);
  assert.deepEqual(seen.complaints, []);
});

test("the cross stays where the hand has put it, however late the session's pictures come", async () => {
  let late = 0;
  const through = (socket) => {
    const server = socket.connectToServer();
    // Messages stay in order, however late.
    server.onMessage((message) => setTimeout(() => socket.send(message), late));
  };
  const session = await Session.small();
  const seen = await showing(session.address, 20, { through });
  const { page } = seen;
  await drawn(page, "slice", 2);
  late = 1500;
  await page.mouse.click(...(await at(page, "z", 0.3, 0.6)));
  const put = (await measured(page)).planes.cross;
  // Meanwhile the pictures under way at the click arrive, and those made from them.
  const places = await page.evaluate(async (put) => {
    const { planes } = window.sonoweave;
    const places = new Set();
    for (const begun = performance.now(); performance.now() - begun < 15_000 && !(planes.told[5].cross.every((x, n) => Math.abs(x - put[n]) < 1e-6)); ) {
      await new Promise(requestAnimationFrame);
      places.add(planes.cross.join());
    }
    return [...places];
  }, put);
  assert.deepEqual(places, [put.join()]);
  await until(page, 5, ({ cross }) => cross.every((x, n) => Math.abs(x - put[n]) < 1e-6));
  // The page then follows the session's position again.
  late = 0;
  await page.locator("#planes-home").click();
  await page.waitForFunction((put) => window.sonoweave.planes.cross.join() !== put, put.join());
  assert.deepEqual(seen.complaints, []);
  await close(seen);
  await session.end();
});

test("the free plane is turned by Shift and drag, by its knob and by keys, and the others stay", async () => {
  const seen = await planes();
  const { page } = seen;
  await page.locator("#planes-home").click();
  await until(page, 6, ({ home }) => home);
  // Before the first command, the cross is in the middle of the growing volume.
  await page.mouse.click(...(await at(page, "z", 0.5, 0.5)));
  for (const kind of [3, 4, 5, 6]) await until(page, kind, ({ home }) => !home);
  await page.waitForTimeout(300);
  const before = await told(page);
  const turned = async (act) => {
    const { right } = (await told(page))[6];
    await act();
    await until(page, 6, (now) => Math.hypot(...now.right.map((x, n) => x - right[n])) > 0.02);
  };
  const drag = async (from, to) => {
    await page.mouse.move(...from);
    await page.mouse.down();
    await page.mouse.move(...to, { steps: 6 });
    await page.mouse.up();
  };
  await turned(async () => {
    await page.keyboard.down("Shift");
    await drag(await at(page, "free", 0.4, 0.5), await at(page, "free", 0.7, 0.5));
    await page.keyboard.up("Shift");
  });
  await turned(async () => {
    const { x, y } = await page.getByRole("button", { name: "Turn the free plane" }).boundingBox();
    await drag([x + 20, y + 20], [x - 30, y + 20]);
  });
  await page.locator("#plane-free").focus();
  await turned(async () => {
    for (let n = 0; n < 4; n += 1) await page.keyboard.press("Shift+ArrowRight");
  });
  const after = await told(page);
  for (const kind of [3, 4, 5]) assert.ok(Math.abs(offset(after[kind]) - offset(before[kind])) < 1e-5, NAMES[kind]);
  await shot(page, "planes-turned");
  await page.locator("#planes-home").click();
  await until(page, 6, ({ home }) => home);
});

test("black and white of the planes are dragged and reset", async () => {
  const session = await Session.small();
  const seen = await showing(session.address, 75);
  const { page } = seen;
  const asked = await listen(page);
  const levels = await page.locator("#levels").boundingBox();
  // By key: five times five steps of 1/128 of the range.
  const dark = (await colours(page, "y")).black;
  await page.locator("[data-name=black]").focus();
  for (let n = 0; n < 5; n += 1) await page.keyboard.press("Shift+ArrowRight");
  await until(page, 4, ({ window }) => Math.abs(window[0] - 49.8) < 0.1);
  await page.waitForFunction(() => window.sonoweave.planes.window[0] > 49);
  assert.ok((await colours(page, "y")).black > dark, "more is black");
  // By pointer: white down to the middle.
  await page.mouse.move(levels.x + levels.width - 8, levels.y + levels.height - 12);
  await page.mouse.down();
  await page.mouse.move(levels.x + levels.width / 2, levels.y + levels.height - 12, { steps: 10 });
  await page.mouse.up();
  await until(page, 4, ({ window }) => window[1] < 140);
  assert.ok((await asked()).every((wish) => wish.do === "window"));
  await page.getByRole("button", { name: "Reset greys" }).click();
  await until(page, 4, ({ window: [black, white] }) => black === 0 && white === 255);
  assert.deepEqual(seen.complaints, []);
  await close(seen);
  await session.end();
});

test("the volume's look is chosen, its opacities are dragged, and it is reset", async () => {
  const session = await Session.small();
  const seen = await showing(session.address, 75);
  const { page } = seen;
  await drawn(page, "view", 2);
  const asked = await listen(page);
  const levels = await page.locator("#levels").boundingBox();
  const plain = await greys(page, "view");
  await page.locator("#levels-preset").selectOption("xray");
  const other = async (than, more) => {
    for (let n = 0; n < 300; n += 1) {
      const now = await greys(page, "view");
      if (difference(now, than) > more) return now;
      await page.waitForTimeout(100);
    }
    throw new Error("the volume looks as before");
  };
  const xray = await other(plain, 2);
  assert.equal(await page.locator("[data-name^=point]").count(), 1);
  await page.locator("[data-name=point-0]").focus();
  await asked();
  for (let n = 0; n < 3; n += 1) await page.keyboard.press("ArrowUp");
  await page.waitForTimeout(300);
  await other(xray, 1);
  const wishes = await asked();
  assert.ok(wishes.length > 0 && wishes.every((wish) => wish.do === "transfer" && wish.preset === "xray"), JSON.stringify(wishes));
  assert.ok(Math.abs(wishes.at(-1).points[0][1] - 0.17) < 1e-6, JSON.stringify(wishes.at(-1)));
  // A double click adds a point, Delete removes it.
  await page.mouse.dblclick(levels.x + levels.width * 0.7, levels.y + 30);
  await page.waitForFunction(() => document.querySelectorAll("[data-name^=point]").length === 2);
  await page.locator("[data-name=point-1]").focus();
  await page.keyboard.press("Delete");
  await page.waitForFunction(() => document.querySelectorAll("[data-name^=point]").length === 1);
  await page.locator("#levels-preset").selectOption("surface");
  await page.getByText("it has no curve to drag").waitFor();
  await page.getByRole("button", { name: "Reset look" }).click();
  await page.waitForFunction(() => document.querySelectorAll("[data-name^=point]").length === 4);
  assert.equal(await page.locator("#levels-preset").inputValue(), "");
  // The volume may have grown meanwhile: the style counts as reset if the view resembles the
  // plain one more than the other.
  for (let n = 0; ; n += 1) {
    const now = await greys(page, "view");
    if (difference(now, plain) < difference(now, xray) / 2) break;
    assert.ok(n < 300, "as at the beginning");
    await page.waitForTimeout(100);
  }
  assert.deepEqual(seen.complaints, []);
  await close(seen);
  await session.end();
});

test("errors are laid over the planes on request, and the cross tells its grey value with its interval", async () => {
  const session = await Session.uncertain();
  const seen = await showing(session.address, 40);
  const { page } = seen;
  const button = page.getByRole("button", { name: "Errors" });
  // The middle may be unseen at first.
  await page.waitForFunction(() => /^at .* mm: grey [0-9.]+ ± [0-9.]+, [0-9.]+ slices$/.test(document.getElementById("planes-caption").textContent));
  assert.equal(await button.getAttribute("aria-pressed"), "false");
  assert.equal((await colours(page, "z")).other, 0, "greys and the blue of unseen places only");
  await button.click();
  await until(page, 3, ({ errors }) => errors === true);
  await page.waitForFunction(() => document.getElementById("planes-errors").getAttribute("aria-pressed") === "true");
  for (let n = 0; (await colours(page, "z")).other < 100; n += 1) {
    assert.ok(n < 300, "orange where it is uncertain");
    await page.waitForTimeout(100);
  }
  await shot(page, "planes-errors");
  await button.click();
  await until(page, 3, ({ errors }) => errors === false);
  for (let n = 0; (await colours(page, "z")).other > 0; n += 1) {
    assert.ok(n < 300, "grey again");
    await page.waitForTimeout(100);
  }
  assert.deepEqual(seen.complaints, []);
  await close(seen);
  await session.end();
  // A volume without errors has a value, and nothing to show.
  const plain = await planes();
  await plain.page.waitForFunction(() => /: grey [0-9]+$/.test(document.getElementById("planes-caption").textContent));
  for (const id of ["errors", "weak"]) assert.equal(await plain.page.locator(`#planes-${id}`).isVisible(), false);
  await close(plain);
});

test("places seen weakly are hatched on request where the volume weighs shadows", async () => {
  const session = await Session.shadowed();
  const seen = await showing(session.address, 40);
  const { page } = seen;
  const button = page.getByRole("button", { name: "Weakly seen" });
  assert.equal(await button.getAttribute("aria-pressed"), "false");
  const hatched = async () => (await Promise.all(Object.values(NAMES).map((name) => colours(page, name)))).reduce((sum, { other }) => sum + other, 0);
  assert.equal(await hatched(), 0, "greys and the blue of unseen places only");
  await button.click();
  await until(page, 3, ({ weakly_seen }) => weakly_seen === true);
  for (let n = 0; (await hatched()) < 50; n += 1) {
    assert.ok(n < 300, "violet where only shadows were seen");
    await page.waitForTimeout(100);
  }
  await shot(page, "planes-weakly-seen");
  await button.click();
  await until(page, 3, ({ weakly_seen }) => weakly_seen === false);
  for (let n = 0; (await hatched()) > 0; n += 1) {
    assert.ok(n < 300, "grey again");
    await page.waitForTimeout(100);
  }
  assert.deepEqual(seen.complaints, []);
  await close(seen);
  await session.end();
});

test("who looks on sees the planes of who steers, and moves none", async () => {
  const first = await planes();
  const { address } = await shared();
  const second = await open(address, { size: SIZES.lying });
  await steers(second.page, false);
  await second.page.keyboard.press("p");
  await all(second.page);
  for (const name of ["Reset greys", "Reset look", "Turn the free plane"]) assert.ok(await second.page.getByRole("button", { name }).isDisabled(), name);
  const asked = await listen(second.page);
  await second.page.mouse.click(...(await at(second.page, "z", 0.3, 0.3)));
  await second.page.mouse.wheel(0, 110);
  await second.page.locator("#plane-x").focus();
  await second.page.keyboard.press("ArrowRight");
  assert.deepEqual(await asked(), []);
  await first.page.mouse.click(...(await at(first.page, "z", 0.4, 0.4)));
  const { cross } = (await measured(first.page)).planes;
  await second.page.waitForFunction((cross) => cross.every((x, n) => Math.abs(x - window.sonoweave.planes.cross[n]) < 1e-6), cross);
  await close(second);
  await first.page.locator("#planes-home").click();
  assert.deepEqual([...first.complaints, ...second.complaints], []);
});

test("axe-core finds nothing wrong with planes, on a desk and on a tablet, and all of them is reached by Tab", async (t) => {
  for (const [name, size] of Object.entries(SIZES)) {
    const seen = await planes({ size });
    const { page } = seen;
    await page.evaluate(axe.source);
    const { violations, passes } = await page.evaluate(() => axe.run());
    assert.ok(passes.length > 10, "it looked");
    assert.deepEqual(violations.map(({ impact, id, nodes }) => `${impact} ${id}: ${nodes.map(({ html }) => html).join(" | ")}`), [], name);
    await page.evaluate(() => document.getElementById("planes-panel").scrollIntoView());
    await shot(page, `planes-${name}-access`);
    if (name === "desk") {
      const reached = new Set();
      await page.locator("#planes-open").focus();
      for (let n = 0; n < 40; n += 1) {
        await page.keyboard.press("Tab");
        reached.add(await page.evaluate(() => document.activeElement.id || document.activeElement.dataset.name || document.activeElement.getAttribute("aria-label") || document.activeElement.textContent));
      }
      for (const wanted of ["plane-z", "plane-y", "plane-x", "plane-free", "Turn the free plane", "planes-home", "black", "white", "point-0", "levels-preset", "levels-greys", "levels-looks"]) {
        assert.ok(reached.has(wanted), `${wanted} of ${[...reached].join(", ")}`);
      }
      const small = await page.evaluate(() => [...document.querySelectorAll("#planes-panel button, #planes-panel select")].filter((one) => one.checkVisibility() && one.getBoundingClientRect().height < 44).map(({ id }) => id));
      assert.deepEqual(small, [], "a finger hits them");
    }
    await close(seen);
    t.diagnostic(`${name} ${size.width} × ${size.height}: no violation of any weight`);
  }
});
