// Performance and cost of pages, in figures. It measures the delay from a picture's due time to
// this browser's screen during capture, and the cost of three pages that view a static session.
// It checks that nothing is rendered after the last page is closed. Frames are rendered
// beforehand. Each part takes SECONDS_EACH, 30 by default; nothing else should run meanwhile.

import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";

import { Apart } from "./apart.js";
import { close, open, PATIENCE, quit } from "./page.js";
import { OUT } from "./place.js";
import { Session } from "./session.js";

const SECONDS = Number(process.env.SECONDS_EACH ?? 30);
const HZ = 100; // USER_HZ of every Linux

const share = (values, of) => {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted.length === 0 ? NaN : sorted[Math.min(sorted.length - 1, Math.floor(of * sorted.length))];
};
const ms = (values) => `p50 ${share(values, 0.5).toFixed(0)}, p95 ${share(values, 0.95).toFixed(0)}, most ${Math.max(...values).toFixed(0)} ms (${values.length} of the last seconds)`;
const cpu = (pid) => {
  const fields = readFileSync(`/proc/${pid}/stat`, "utf8").split(") ")[1].split(" ");
  return (Number(fields[11]) + Number(fields[12])) / HZ;
};
const account = async (address) => (await fetch(`${address}v1/account`)).json();
const metric = async (address, name) => Number(new RegExp(`^${name} (\\S+)`, "m").exec(await (await fetch(`${address}metrics`)).text())?.[1]);
const rest = (seconds) => new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
const until = async (holds) => {
  for (const began = Date.now(); !(await holds()); await rest(0.1)) {
    if (Date.now() - began > PATIENCE) throw new Error(`not within ${PATIENCE} ms: ${holds}`);
  }
};
const busy = async (pid, seconds) => {
  const before = cpu(pid);
  await rest(seconds);
  return (100 * (cpu(pid) - before)) / seconds;
};

// Figures for the documents, by their names.
const figures = {};

const folder = mkdtempSync(join(OUT, "session-"));
const session = await Session.painted(folder, "512x512");
const { address, pid } = session;
try {
  const browser = await Apart.open(address);
  await until(async () => (await account(address)).slices >= 60);
  const before = await account(address);
  const drawn = () => browser.evaluate(() => ({ ...window.sonoweave.pictures, at: Date.now() }));
  const from = await drawn();
  await rest(SECONDS);
  const to = await drawn();
  const seconds = (to.at - from.at) / 1000;
  const latencies = await browser.evaluate(() => window.sonoweave.latencies);
  const after = await account(address);
  await browser.close();
  const lost = (told) => told.lost + told.dropped;
  for (const name of ["slice", "view"]) {
    const { width, height } = to[name];
    figures[`${name}/delay`] = { median: share(latencies[name], 0.5), p95: share(latencies[name], 0.95), most: Math.max(...latencies[name]) };
    figures[`${name}/pictures a second`] = (to[name].drawn - from[name].drawn) / seconds;
    console.log(`${name} ${width} × ${height}: due until on the screen ${ms(latencies[name])}; ${((to[name].drawn - from[name].drawn) / seconds).toFixed(1)} a second`);
  }
  figures["lost or dropped"] = lost(after) - lost(before);
  console.log(`meanwhile ${after.frames - before.frames} frames, ${lost(after) - lost(before)} lost or dropped`);

  await fetch(`${address}v1/do`, { method: "POST", headers: { "Content-Type": "application/json" }, body: '{"do":"stop"}' });
  await until(async () => (await account(address)).desk.phase === "over");
  const pages = [await open(address), await open(address), await open(address)];
  await rest(5);
  const three = await busy(pid, SECONDS);
  for (const page of pages) await close(page);
  await rest(5);
  const none = await busy(pid, SECONDS);
  figures["three pages/CPU, % of a core"] = three;
  console.log(`a session that stands still: ${three.toFixed(2)} % of a core with three pages that see it, ${none.toFixed(2)} % with none`);
  await fetch(`${address}v1/do`, { method: "POST", headers: { "Content-Type": "application/json" }, body: '{"do":"scan"}' });
  await rest(5);
  const [pictures, slices] = [await metric(address, "sonoweave_pictures_total"), (await account(address)).slices];
  await rest(SECONDS);
  const [inserted, drawnMeanwhile] = [(await account(address)).slices - slices, (await metric(address, "sonoweave_pictures_total")) - pictures];
  figures["without a page/pictures"] = drawnMeanwhile;
  console.log(`nobody looks: ${inserted} slices inserted, ${drawnMeanwhile} pictures of them drawn`);
  // Shorter parts are a smoke test.
  writeFileSync(join(OUT, "figures.json"), JSON.stringify({ quick: SECONDS < 40, figures }, null, 2));
} finally {
  await session.end();
  await quit();
  rmSync(folder, { recursive: true, force: true });
}
