// Troubles appear in the banner, are announced once to screen readers, and mark outdated
// pictures.

import assert from "node:assert/strict";
import { test } from "node:test";

import { banner, drawn, open, says, shot } from "./page.js";
import { shared } from "./session.js";

// Opens a page whose session's messages can be changed: `tell` changes the status from now on,
// `leave` closes the connection for good, and later attempts wait.
async function changed() {
  const { address } = await shared();
  let change = {};
  let line;
  let left = false;
  const through = async (socket) => {
    if (left) await new Promise(() => {});
    line = socket;
    const server = socket.connectToServer();
    server.onMessage((message) => {
      if (typeof message !== "string") return socket.send(message);
      const word = JSON.parse(message);
      return socket.send(JSON.stringify(word.account ? { account: { ...word.account, ...change } } : word));
    });
  };
  const seen = await open(address, { through });
  await drawn(seen.page, "slice", 2);
  await drawn(seen.page, "view", 1);
  const leave = () => {
    left = true;
    return line.close({ code: 1001 });
  };
  return { ...seen, tell: (next) => (change = next), leave };
}

const spoken = (page) => page.locator("#announcer").textContent();
const word = (page, text) => page.locator("#slice-word", { hasText: text }).waitFor();

test("a frozen scanner is said, and its picture is marked", async () => {
  const { page, tell } = await changed();
  tell({ frozen_s: 12.4 });
  await says(page, "The scanner is frozen");
  await word(page, "frozen");
  assert.match(await spoken(page), /The scanner is frozen/);
  await shot(page, "frozen");
  tell({});
  await page.locator("#slice-word").waitFor({ state: "hidden" });
});

test("a silent device is said with what to do, and its card says it, too", async () => {
  const { page, tell } = await changed();
  const why = "/dev/ttyUSB0 has said nothing for 5 s; check the cable";
  tell({ devices: [{ name: "tracking", state: "silent", why, clock: "holdover" }, { name: "grabber", state: "running", why: "", clock: "locked" }] });
  await says(page, "tracking is silent");
  assert.match(await banner(page), /check the cable/);
  assert.match(await page.locator(".card.devices").innerText(), /one needs you[^]*tracking is silent/);
  await shot(page, "silent");
});

test("a stage that stands still, a disk in trouble and metal are said, the worst first", async () => {
  const { page, tell } = await changed();
  const recording = { path: "/a/SESSION.mcap", bytes: 1e9, minutes_left: 4, lost: 7, trouble: "the disk is full" };
  tell({ still: ["insertion"], recording, bent: true });
  await says(page, "stands still: insertion");
  const lines = await page.locator("#banner p").allInnerTexts();
  assert.match(lines.join(), /stands still[^]*recording is in trouble[^]*room for 4 more minutes/);
  assert.match(await page.locator(".card.recording").innerText(), /in trouble[^]*7 of what came are not in it[^]*the disk is full/);
});

test("an end that the session tells, or by which it closes the line, is no lost connection", async () => {
  const first = await changed();
  first.tell({ ended: true });
  await says(first.page, "The session has ended");
  await word(first.page, "not live");
  await shot(first.page, "ended");
  const second = await changed();
  await second.leave();
  await says(second.page, "The session has ended");
  assert.match(await spoken(second.page), /The session has ended/);
});
