// Accessibility: axe-core's rules, full keyboard control, screen reader texts, and no motion on
// request.

import assert from "node:assert/strict";
import { test } from "node:test";

import { audit, close, drawn, listen, open, says, shot, SIZES, steers } from "./page.js";
import { shared } from "./session.js";

test("axe-core finds nothing wrong, on a desk and on a tablet, with the help open, looking on", async (t) => {
  const { address } = await shared();
  for (const [name, size] of Object.entries(SIZES)) {
    const seen = await open(address, { size });
    const { page } = seen;
    await drawn(page, "view", 2);
    await says(page, "All is well");
    assert.deepEqual(await audit(page), [], name);
    const notice = page.locator("#notice");
    assert.equal(await notice.innerText(), "For research. Not a medical device. Not for diagnosis or treatment.");
    const { y, height } = await notice.boundingBox();
    assert.ok(y >= 0 && y + height <= size.height, `${name}: the purpose is on the first screen`);
    await page.keyboard.press("?");
    await page.getByRole("dialog").waitFor();
    assert.deepEqual(await audit(page), [], `${name}, help`);
    await shot(page, `help-${name}`);
    await page.keyboard.press("Escape");
    if (name === "desk") {
      const second = await open(address, { size });
      await second.page.getByRole("button", { name: "Take control" }).waitFor();
      assert.deepEqual(await audit(second.page), [], "looking on");
      await close(second);
    }
    await close(seen);
    t.diagnostic(`${name} ${size.width} × ${size.height}: no violation of any weight`);
  }
});

test("every control is reached by Tab, in the order in which it is read, is seen to be, and says what it does", async () => {
  const { address } = await shared();
  const seen = await open(address);
  const { page } = seen;
  await steers(page, true);
  assert.equal(await page.evaluate(() => document.activeElement.id), "view", "the view's keys act at once");
  // The available commands are known with the first status message.
  await page.waitForFunction(() => !document.querySelector("[data-command=save]").disabled);
  const wanted = await page.evaluate(() => {
    const all = [...document.querySelectorAll("button, [tabindex='0']")].filter((element) => element.checkVisibility() && !element.disabled && !element.closest("dialog"));
    return all.map((element) => element.id || element.textContent);
  });
  assert.ok(wanted.length >= 13, wanted.join());
  await page.evaluate(() => document.activeElement.blur());
  await page.locator("h1").click();
  const reached = [];
  for (let n = 0; n < wanted.length; n += 1) {
    await page.keyboard.press("Tab");
    const at = await page.evaluate(() => {
      const element = document.activeElement;
      const ringed = [element, element.parentElement].some((one) => {
        const { outlineStyle, outlineWidth } = getComputedStyle(one);
        return outlineStyle !== "none" && parseFloat(outlineWidth) >= 2;
      });
      const { width, height } = element.getBoundingClientRect();
      return { name: element.id || element.textContent, ringed, title: element.title, width, height };
    });
    reached.push(at.name);
    assert.ok(at.ringed, `${at.name}: the focus is seen`);
    assert.ok(at.title.length > 8, `${at.name}: says what it does`);
    assert.ok(at.width >= 44 && at.height >= 44, `${at.name}: a finger hits it (${at.width} × ${at.height})`);
  }
  assert.deepEqual(reached, wanted);
});

test("the help opens and closes by keyboard and gives the focus back, and no key of the view acts elsewhere", async () => {
  const { address } = await shared();
  const seen = await open(address);
  const { page } = seen;
  await steers(page, true);
  const focus = () => page.evaluate(() => document.activeElement.id);
  await page.keyboard.press("?");
  assert.equal(await focus(), "help-close");
  await page.keyboard.press("Enter");
  assert.equal(await focus(), "view");
  await page.locator("#help-open").focus();
  await page.keyboard.press("Enter");
  assert.ok(await page.getByRole("dialog").isVisible());
  await page.keyboard.press("Escape");
  assert.equal(await focus(), "help-open");
  const wishes = await listen(page);
  for (const key of ["ArrowLeft", "2", "w", "+"]) await page.keyboard.press(key);
  assert.deepEqual(await wishes(), []);
});

test("what is spoken does not chatter", async () => {
  const { address } = await shared();
  const seen = await open(address);
  const { page } = seen;
  await says(page, "All is well");
  const live = await page.evaluate(() => [...document.querySelectorAll("[aria-live], [role=status], [role=alert], [role=log]")].map(({ id }) => id));
  // `settings-says` is in a dialog, and reports wrong settings.
  assert.deepEqual(live, ["announcer", "settings-says"]);
  await page.evaluate((live) => {
    const sentences = () => [...document.querySelectorAll("#banner strong")].map(({ textContent }) => textContent).join(" ");
    const watch = (element, changed) => new MutationObserver(changed).observe(element, { childList: true, characterData: true, subtree: true });
    window.spoken = [];
    window.shown = [sentences()];
    for (const element of live.map((id) => document.getElementById(id))) watch(element, () => window.spoken.push(element.textContent));
    watch(document.getElementById("banner"), () => {
      if (sentences() !== window.shown.at(-1)) window.shown.push(sentences());
    });
  }, live);
  await drawn(page, "slice", 60);
  const { spoken, shown } = await page.evaluate(() => ({ spoken: window.spoken, shown: window.shown }));
  // A machine that does not keep up has troubles that come and go: each change is spoken once.
  assert.ok(spoken.length < shown.length, JSON.stringify({ spoken, shown }));
});

test("who wants no motion gets none", async () => {
  const { address } = await shared();
  const seen = await open(address, { reducedMotion: "reduce" });
  const moving = await seen.page.evaluate(() => {
    const durations = [...document.querySelectorAll("*")].map((element) => getComputedStyle(element));
    return durations.filter((of) => parseFloat(of.transitionDuration) > 0 || of.animationName !== "none").length;
  });
  assert.equal(moving, 0);
});
