// The view of the volume by mouse, touch, wheel, buttons and keys; and by one page at a time.

import assert from "node:assert/strict";
import { test } from "node:test";

import { body, close, difference, drawn, greys, listen, measured, open, settled, shot, steers } from "./page.js";
import { shared } from "./session.js";

// Opens a page with control, after the volume's first sweep.
async function steering() {
  const { address } = await shared();
  const seen = await open(address);
  await steers(seen.page, true);
  await seen.page.waitForFunction(() => window.sonoweave.account?.slices > 250);
  return seen;
}

// Returns the projection of the displayed picture.
const lies = (page) => page.evaluate(() => JSON.stringify(window.sonoweave.projected.projection));

// Returns the view after the action has taken effect.
async function after(page, act) {
  let before = await lies(page);
  await act();
  // Pictures under way show the old view. An action without effect changes nothing.
  const elsewhere = (before) => JSON.stringify(window.sonoweave.projected.projection) !== before;
  await page.waitForFunction(elsewhere, before, { timeout: 1500 }).catch(() => {});
  for (let n = 0; n < 5; n += 1) {
    before = await lies(page);
    await settled(page);
    if ((await lies(page)) === before) break;
  }
  return greys(page, "view");
}

const key = (page, name) => after(page, () => page.keyboard.press(name));
const middle = async (page) => {
  const { x, y, width, height } = await page.locator("#view").boundingBox();
  return { x: x + width / 2, y: y + height / 2, width, height };
};

test("standard views by keys and by buttons are six sides, and home", async () => {
  const seen = await steering();
  const { page } = seen;
  const views = {};
  for (const [digit, name] of ["Front", "Back", "Left", "Right", "Above", "Below"].entries()) {
    views[name] = await key(page, String(digit + 2));
    const again = await after(page, () => page.getByRole("button", { name, exact: true }).click());
    await page.locator("#view").focus();
    const [same, turned] = [difference(views[name], again), difference(views[name], await key(page, "1"))];
    assert.ok(turned > 2 * same, `${name}: button and key agree within ${same.toFixed(2)}, home differs by ${turned.toFixed(2)}`);
  }
  const all = Object.entries(views);
  for (const [n, [one, a]] of all.entries()) {
    for (const [other, b] of all.slice(n + 1)) assert.ok(difference(a, b) > 1, `${one} and ${other}: ${difference(a, b).toFixed(2)}`);
  }
  assert.deepEqual(seen.complaints, []);
});

test("dragging turns what is seen, with Shift it rolls, and home leads back", async () => {
  const seen = await steering();
  const { page } = seen;
  const home = await key(page, "1");
  const again = await key(page, "1");
  const drag = async (x, y) => {
    const at = await middle(page);
    await page.mouse.move(at.x, at.y - at.height / 4);
    await page.mouse.down();
    await page.mouse.move(at.x + x * at.width, at.y - at.height / 4 + y * at.height, { steps: 8 });
    await page.mouse.up();
  };
  const turned = await after(page, () => drag(0.4, 0));
  const still = difference(home, again);
  assert.ok(difference(again, turned) > Math.max(1, 3 * still), `turned: ${difference(again, turned).toFixed(2)}, at rest ${still.toFixed(2)}`);
  const up = await after(page, () => drag(0, 0.3));
  assert.ok(difference(turned, up) > Math.max(1, 3 * still), "turned up");
  await key(page, "1");
  await page.keyboard.down("Shift");
  const rolled = await after(page, () => drag(0.3, 0.25));
  await page.keyboard.up("Shift");
  assert.ok(difference(home, rolled) > Math.max(1, 3 * still), "rolled");
  const back = await key(page, "1");
  assert.ok(difference(home, back) < difference(home, turned) / 2, "home again");
});

test("hand, wheel and keys wish what they are for, in its direction and once", async () => {
  const { page } = await steering();
  const asked = await listen(page);
  const at = await middle(page);
  const degrees = 180 / Math.PI;
  const nothing = { do: "turn", right: 0, up: 0, clockwise: 0 };
  const sum = (wishes) =>
    wishes.reduce((sum, wish) => {
      assert.equal(wish.do, "turn");
      return { ...sum, right: sum.right + wish.right, up: sum.up + wish.up, clockwise: sum.clockwise + wish.clockwise };
    }, nothing);
  const drag = async (from, to) => {
    await page.mouse.move(at.x + from[0], at.y + from[1]);
    await page.mouse.down();
    await page.mouse.move(at.x + to[0], at.y + to[1], { steps: 10 });
    await page.mouse.up();
    return sum(await asked());
  };
  const near = (a, b, within) => Object.keys(b).forEach((key) => key === "do" || assert.ok(Math.abs(a[key] - b[key]) <= within, `${key}: ${a[key]} instead of ${b[key]}`));
  const ball = degrees / (Math.min(at.width, at.height) / 2);
  near(await drag([-40, 30], [60, 30]), { ...nothing, right: 100 * ball }, 6);
  near(await drag([50, 40], [50, -30]), { ...nothing, up: 70 * ball }, 6);
  await page.keyboard.down("Shift");
  near(await drag([0, -80], [80, 0]), { ...nothing, clockwise: 90 }, 5);
  await page.keyboard.up("Shift");
  const presses = {
    ArrowRight: { ...nothing, right: 5 }, ArrowLeft: { ...nothing, right: -5 }, ArrowUp: { ...nothing, up: 5 }, ArrowDown: { ...nothing, up: -5 },
    "Shift+ArrowRight": { ...nothing, clockwise: 5 }, "Shift+ArrowLeft": { ...nothing, clockwise: -5 },
    "+": { do: "zoom", by: 0.25 }, "-": { do: "zoom", by: -0.25 },
    w: { do: "centre", at: [0.5, 0.6] }, a: { do: "centre", at: [0.6, 0.5] }, s: { do: "centre", at: [0.5, 0.4] }, d: { do: "centre", at: [0.4, 0.5] },
    1: { do: "look", from: "home" }, 2: { do: "look", from: "front" }, 3: { do: "look", from: "back" }, 4: { do: "look", from: "left" },
    5: { do: "look", from: "right" }, 6: { do: "look", from: "above" }, 7: { do: "look", from: "below" }, Home: { do: "look", from: "home" },
  };
  for (const [key, wish] of Object.entries(presses)) {
    await page.keyboard.press(key);
    assert.deepEqual(await asked(), [wish], key);
  }
  const buttons = { Larger: { do: "zoom", by: 0.5 }, Smaller: { do: "zoom", by: -0.5 }, "Roll with the clock": { ...nothing, clockwise: 15 }, "Roll against the clock": { ...nothing, clockwise: -15 } };
  for (const side of ["Home", "Front", "Back", "Left", "Right", "Above", "Below"]) buttons[side] = { do: "look", from: side.toLowerCase() };
  for (const [name, wish] of Object.entries(buttons)) {
    await page.getByRole("button", { name, exact: true }).click();
    assert.deepEqual(await asked(), [wish], name);
  }
  await page.mouse.move(at.x, at.y);
  await page.mouse.wheel(0, -110);
  assert.deepEqual(await asked(), [{ do: "zoom", by: 0.25 }]);
  await page.mouse.dblclick(at.x + at.width / 4, at.y - at.height / 4);
  const [{ do: what, at: place }, ...more] = await asked();
  assert.deepEqual([what, more], ["centre", []]);
  assert.ok(Math.abs(place[0] - 0.75) < 0.01 && Math.abs(place[1] - 0.25) < 0.01, place.join());
  await page.locator("#view").focus();
  await key(page, "1");
});

test("arrows turn as far as they turn back, and Shift rolls", async () => {
  const seen = await steering();
  const { page } = seen;
  const home = await key(page, "1");
  const times = async (name, n) => {
    for (let at = 0; at < n; at += 1) await page.keyboard.press(name);
  };
  for (const [there, back] of [["ArrowLeft", "ArrowRight"], ["ArrowUp", "ArrowDown"], ["Shift+ArrowLeft", "Shift+ArrowRight"]]) {
    const away = await after(page, () => times(there, 6));
    const again = await after(page, () => times(back, 6));
    const [far, near] = [difference(home, away), difference(home, again)];
    assert.ok(far > 1 && far > 2 * near, `${there}: away ${far.toFixed(2)}, back ${near.toFixed(2)}`);
  }
});

test("wheel, keys and buttons zoom", async () => {
  const seen = await steering();
  const { page } = seen;
  const share = async (act) => body(await after(page, act)).share;
  const home = await share(() => page.keyboard.press("1"));
  const at = await middle(page);
  await page.mouse.move(at.x, at.y);
  const small = await share(() => page.mouse.wheel(0, 440));
  assert.ok(small < 0.6 * home, `a doubling smaller: ${small.toFixed(3)} of ${home.toFixed(3)}`);
  const larger = await share(async () => {
    for (let n = 0; n < 4; n += 1) await page.keyboard.press("+");
  });
  assert.ok(Math.abs(larger / home - 1) < 0.25, `and back by keys: ${larger.toFixed(3)}`);
  const button = await share(() => page.getByRole("button", { name: "Smaller" }).click());
  assert.ok(button < 0.9 * home, "by the button");
});

test("a double click brings its point to the middle, and letters move what is seen", async () => {
  const seen = await steering();
  const { page } = seen;
  const where = async (act) => body(await after(page, act));
  await page.keyboard.press("1");
  const home = await where(async () => {
    for (let n = 0; n < 4; n += 1) await page.keyboard.press("-");
  });
  const at = await middle(page);
  const clicked = await where(() => page.mouse.dblclick(at.x + at.width / 5, at.y));
  assert.ok(Math.abs(home.x - clicked.x - 0.2) < 0.06, `to the left: from ${home.x.toFixed(2)} to ${clicked.x.toFixed(2)}`);
  const moved = await where(() => page.keyboard.press("d"));
  assert.ok(Math.abs(moved.x - clicked.x - 0.1) < 0.05, `to the right: to ${moved.x.toFixed(2)}`);
  const up = await where(() => page.keyboard.press("w"));
  assert.ok(Math.abs(moved.y - up.y - 0.1) < 0.05, `up: from ${moved.y.toFixed(2)} to ${up.y.toFixed(2)}`);
  await key(page, "1");
});

test("two fingers zoom and roll, one turns, and two taps centre", async () => {
  const { address } = await shared();
  const seen = await open(address, { hasTouch: true });
  const { page } = seen;
  await steers(page, true);
  await drawn(page, "view", 2);
  const asked = await listen(page);
  let wishes;
  const at = await middle(page);
  const devtools = await page.context().newCDPSession(page);
  const touch = (type, points) => devtools.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ id, x: at.x + x, y: at.y + y })) });
  const sum = (of, what) => wishes.filter((wish) => wish.do === of).reduce((sum, wish) => sum + (wish[what] ?? 0), 0);

  await touch("touchStart", [[-50, 0], [50, 0]]);
  for (let x = 55; x <= 100; x += 5) await touch("touchMove", [[-x, 0], [x, 0]]);
  await touch("touchEnd", []);
  wishes = await asked();
  assert.ok(Math.abs(sum("zoom", "by") - 1) < 0.15, `apart to twice the distance: ${sum("zoom", "by")} doublings`);
  assert.ok(Math.abs(sum("turn", "clockwise")) < 2 && sum("turn", "right") === 0);

  await touch("touchStart", [[-80, 0], [80, 0]]);
  for (let a = 0.05; a <= 0.5; a += 0.05) {
    const [x, y] = [80 * Math.cos(a), 80 * Math.sin(a)];
    await touch("touchMove", [[-x, -y], [x, y]]);
  }
  await touch("touchEnd", []);
  wishes = await asked();
  assert.ok(Math.abs(sum("turn", "clockwise") - 28.6) < 3, `half a radian with the clock: ${sum("turn", "clockwise")}°`);

  await touch("touchStart", [[-60, 0]]);
  for (let x = -50; x <= 60; x += 10) await touch("touchMove", [[x, 0]]);
  await touch("touchEnd", []);
  wishes = await asked();
  const ball = (120 / (Math.min(at.width, at.height) / 2)) * (180 / Math.PI);
  assert.ok(Math.abs(sum("turn", "right") - ball) < 8 && sum("turn", "clockwise") === 0, `as a ball's surface: ${sum("turn", "right")}° of ${ball.toFixed(1)}°`);

  for (let n = 0; n < 2; n += 1) {
    await touch("touchStart", [[at.width / 4, 0]]);
    await touch("touchEnd", []);
  }
  wishes = await asked();
  const centred = wishes.filter((wish) => wish.do === "centre");
  assert.equal(centred.length, 1);
  assert.ok(Math.abs(centred[0].at[0] - 0.75) < 0.02 && Math.abs(centred[0].at[1] - 0.5) < 0.02, JSON.stringify(centred));
  await page.locator("#view").focus();
  await key(page, "1");
});

test("a second page looks on until it takes control, and a page loaded anew steers again", async () => {
  const first = await steering();
  const { address } = await shared();
  const second = await open(address, { size: { width: 1024, height: 768 } });
  await steers(second.page, false);
  await drawn(second.page, "slice", 2);
  await drawn(second.page, "view", 2);
  await second.page.getByText("Another page steers this view").waitFor();
  assert.ok(await second.page.getByRole("button", { name: "Front", exact: true }).isDisabled(), "no button that does nothing");
  await shot(second.page, "onlooker");
  const asked = await listen(second.page);
  await second.page.keyboard.press("ArrowLeft");
  assert.deepEqual(await asked(), [], "nor a key");

  await second.page.getByRole("button", { name: "Take control" }).click();
  await steers(second.page, true);
  await steers(first.page, false);
  const before = await key(second.page, "1");
  const turned = await key(second.page, "4");
  assert.ok(difference(before, turned) > 1, "it steers");
  await first.page.getByText("Another page steers this view").waitFor();
  await key(second.page, "1");

  await close(second);
  await steers(first.page, true);
  await first.page.reload();
  await steers(first.page, true);
  await drawn(first.page, "slice", 3);
  await drawn(first.page, "view", 3);
  assert.equal((await measured(first.page)).connected, true);
  assert.deepEqual([...first.complaints, ...second.complaints], []);
});
