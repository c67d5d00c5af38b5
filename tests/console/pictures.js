// Makes the documents' pictures of the console and of reports: scripts/pictures.sh.

import { copyFileSync, readFileSync, readdirSync, writeFileSync } from "node:fs";
import { execFileSync } from "node:child_process";
import { join, resolve } from "node:path";
import { setTimeout as wait } from "node:timers/promises";

import { moving } from "./apng.js";
import { close, drawn, open, quit } from "./page.js";
import { OUT, PROGRAM } from "./place.js";
import { Session } from "./session.js";

/// Largest moving picture, bytes.
const MOST = 3e6;
/// Time between two of its frames, how long it runs, and how long the last frame stays, ms.
const [EVERY, LONG, REST] = [250, 11_000, 2500];

const docs = resolve("docs");

// The demo's page, from the first slices on.
const session = await Session.begin();
const small = await open(session.address, { deviceScaleFactor: 0.65 });
await drawn(small.page, "view", 1);
const shots = [];
for (let due = Date.now(); shots.length * EVERY < LONG; due += EVERY) {
  await wait(Math.max(0, due - Date.now()));
  shots.push({ png: await small.page.screenshot(), ms: EVERY });
}
shots.at(-1).ms = REST;
await close(small);
const apng = moving(shots);
if (apng.length > MOST) throw new Error(`the moving picture has ${apng.length} bytes, more than ${MOST}`);
writeFileSync(join(docs, "demo.png"), apng);

// The page once the whole doll is there, at rest for a look at all cards.
const large = await open(session.address);
await drawn(large.page, "view", 20);
await large.page.screenshot({ path: join(docs, "console.png") });
await close(large);
const folder = session.folder;
await session.stop();
copyFileSync(join(folder, "picture.png"), join(docs, "doll.png"));

const run = (words) => execFileSync(PROGRAM, words.split(" "), { cwd: OUT, stdio: "inherit" });
// The tutorial's replay with other settings.
const recording = readdirSync(folder).find((name) => name.endsWith(".mcap"));
const settings = readFileSync(join(folder, "bedside.toml"), "utf8").replace(/^spacing_mm = .*/m, "spacing_mm = 1.5").replace(/^view_deg = .*/m, "view_deg = [60, 10]");
writeFileSync(join(folder, "coarse.toml"), settings);
run(`replay ${join(folder, recording)} --config ${join(folder, "coarse.toml")} -o coarse.mha --picture ${join(docs, "doll-coarse.png")}`);
session.remove();

// The report of the tutorial's calibration, and the wires by it.
for (const words of [
  "phantom -o wires.igs.mha --scene n-wire --image-size 320x240 --tracker-noise 0.05,0.05 --seed 1 --phantom phantom.toml --calibration truth.toml",
  "phantom -o check.igs.mha --scene n-wire --image-size 320x240 --tracker-noise 0.05,0.05 --seed 2 --frames 60 --calibration truth.toml",
  "calibrate probe --phantom phantom.toml --sequence wires.igs.mha --validate check.igs.mha -o probe.toml --report probe.html",
  "reconstruct check.igs.mha --config probe.toml --clip 80,50,160,180 -o wires.mha --weights weights.mha",
  `render wires.mha --weights weights.mha -o ${join(docs, "wires.png")} --view 30,30 --mode mip --image-size 640x400`,
]) run(words);
const report = await open(`file://${join(OUT, "probe.html")}`, { size: { width: 1000, height: 700 } });
await report.page.screenshot({ path: join(docs, "calibration-report.png") });
await close(report);
await quit();
console.log(`pictures: ${shots.length} frames, ${(apng.length / 1e6).toFixed(1)} MB`);
process.exit(0);
