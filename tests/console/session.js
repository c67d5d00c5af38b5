// A session at the virtual bedside, with its console.

import { execFileSync, spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";

import { EXAMPLE, OUT, PROGRAM } from "./place.js";

// Time limit for beginning or ending a session, ms.
const PATIENCE = 60_000;
const TELLS = /console: (https?:\/\/\S+)/;

// No session outlives the tests, however they end.
const running = new Set();
process.on("exit", () => running.forEach((child) => child.kill("SIGKILL")));

export class Session {
  #child;
  #place;
  #ended;
  /// Address of its page.
  address;

  /// Begins a session whose console listens at this port, 0 for any free one.
  static async begin(port = 0) {
    const place = mkdtempSync(join(OUT, "session-"));
    return Session.#run(place, ["demo", "--headless", "-o", place, "--console", `127.0.0.1:${port}`]);
  }

  /// Begins a session with small frames and coarse voxels. Its volume is rendered quickly even
  /// on a busy machine.
  static async small() {
    const place = mkdtempSync(join(OUT, "session-"));
    return Session.#run(place, ["live", "--config", small(place, "8"), "--headless", "--console", "127.0.0.1:0"]);
  }

  /// Begins a small session whose volume keeps standard errors.
  static async uncertain() {
    const place = mkdtempSync(join(OUT, "session-"));
    const config = small(place, "8");
    writeFileSync(config, readFileSync(config, "utf8").replace(/^\[volume\].*$/m, "[volume]\nstandard_error = true"));
    return Session.#run(place, ["live", "--config", config, "--headless", "--console", "127.0.0.1:0"]);
  }

  /// Begins a small session whose volume weighs the shadows of a thigh's bone.
  static async shadowed() {
    const place = mkdtempSync(join(OUT, "session-"));
    const config = small(place, "8");
    const text = readFileSync(config, "utf8").replace(/^\[volume\].*$/m, "[volume]\nshadow_weights = true").replace(/^scene = "doll"/m, 'scene = "thigh"');
    writeFileSync(config, text);
    return Session.#run(place, ["live", "--config", config, "--headless", "--console", "127.0.0.1:0"]);
  }

  /// Begins a session that finds its mask by itself: a thigh, which fills the scanner's fan.
  static async searching() {
    const place = mkdtempSync(join(OUT, "session-"));
    const text = readFileSync(EXAMPLE, "utf8").replace(/^#(image_to_probe = )/m, "$1").replace(/^clip_px = .*\n/m, "").replace(/^scene = "doll"/m, 'scene = "thigh"');
    const smaller = { size: '"320x240"', rate_hz: "8", spacing_mm: "2.0", image_size: '"160x160"' };
    const config = join(place, "searching.toml");
    writeFileSync(config, Object.entries(smaller).reduce((text, [key, value]) => text.replace(new RegExp(`^${key} = \\S+`, "m"), `${key} = ${value}`), text));
    return Session.#run(place, ["live", "--config", config, "--headless", "--console", "127.0.0.1:0"]);
  }

  /// Begins the small session with other keys under [picture], and files beside its configuration.
  static async pictured(keys, files = {}) {
    const place = mkdtempSync(join(OUT, "session-"));
    const config = small(place, "20");
    for (const [name, text] of Object.entries(files)) writeFileSync(join(place, name), text);
    const names = Object.keys(keys).join("|");
    const lines = Object.entries(keys).map(([key, value]) => `${key} = ${value}`);
    const text = readFileSync(config, "utf8").replace(new RegExp(`^(${names || "-"}) = .*\n`, "gm"), "");
    writeFileSync(config, text.replace(/^\[picture\].*$/m, ["[picture]", ...lines].join("\n")));
    return Session.#run(place, ["live", "--config", config, "--headless", "--console", "127.0.0.1:0"]);
  }

  /// Begins the small session with more frames per second, recorded in a folder that is kept.
  static async recorded(folder) {
    return Session.#run(null, ["live", "--config", small(folder, "20"), "--record", folder, "--headless", "--console", "127.0.0.1:0"]);
  }

  /// The same with a tracker that has white noise.
  static async noisy(folder) {
    const config = small(folder, "20");
    writeFileSync(config, readFileSync(config, "utf8").replace(/^\[virtual\].*$/m, "[virtual]\ntracker_noise_mm = 0.2\ntracker_noise_deg = 0.2"));
    return Session.#run(null, ["live", "--config", config, "--record", folder, "--headless", "--console", "127.0.0.1:0"]);
  }

  /// Begins a session with frames rendered beforehand, so that rendering does not affect the
  /// measurement. `size` is the frames' size.
  static async painted(folder, size) {
    const text = readFileSync(EXAMPLE, "utf8").replace(/^(reference_station|clip_px).*$/gm, "").replace(/^#painted = true.*$/m, "painted = true").replace(/^size = .*$/m, `size = "${size}"`);
    const config = join(folder, "painted.toml");
    writeFileSync(config, text);
    return Session.#run(null, ["live", "--config", config, "--headless", "--console", "127.0.0.1:0"]);
  }

  /// Replays a recorded session, and saves into a folder.
  static async replay(recording, keep) {
    return Session.#run(null, ["replay", recording, "--keep", keep, "--console", "127.0.0.1:0"]);
  }

  /// Begins a session with the virtual bedside's configuration and additions, in a folder that
  /// is kept.
  static async with(folder, more, host, port = 0) {
    const config = join(folder, "bedside.toml");
    writeFileSync(config, execFileSync(PROGRAM, ["live", "--example", "virtual"]) + more);
    return Session.#run(null, ["live", "--config", config, "--headless", "--console", `${host}:${port}`]);
  }

  static async #run(place, flags) {
    const session = new Session();
    session.#place = place;
    const child = spawn(PROGRAM, flags, { stdio: ["ignore", "ignore", "pipe"] });
    running.add(child);
    session.#child = child;
    session.#ended = new Promise((resolve) => {
      child.on("error", resolve);
      child.on("exit", resolve);
    }).then(() => running.delete(child));
    session.address = await told(child);
    return session;
  }

  /// Its output folder.
  get folder() {
    return this.#place;
  }

  /// Its process id.
  get pid() {
    return this.#child.pid;
  }

  /// Whether this is its process.
  has(child) {
    return this.#child === child;
  }

  /// The port of its console.
  get port() {
    return Number(new URL(this.address).port);
  }

  /// Stops it in the middle of its work, as a machine without memory would; or continues it.
  hang(whether) {
    this.#child.kill(whether ? "SIGSTOP" : "SIGCONT");
  }

  /// Ends it: by SIGINT like a user, or by SIGKILL like a power cut. Its folder is removed.
  async end(signal = "SIGINT") {
    await this.stop(signal);
    this.remove();
  }

  /// Ends it, and keeps its folder.
  async stop(signal = "SIGINT") {
    this.#child.kill(signal);
    const late = setTimeout(() => this.#child.kill("SIGKILL"), PATIENCE);
    await this.#ended;
    clearTimeout(late);
  }

  /// Removes its folder, if it has its own.
  remove() {
    if (this.#place) rmSync(this.#place, { recursive: true, force: true });
  }
}

// Writes the virtual bedside's configuration, made small, into a folder.
function small(folder, hz) {
  const smaller = { clip_px: "[0, 0, 160, 120]", size: '"160x120"', rate_hz: hz, spacing_mm: "2.0", image_size: '"160x160"', frames: "60", gap_mm: "2.725" };
  const lines = readFileSync(EXAMPLE, "utf8").split("\n").map((line) => {
    const [, key] = /^(\w+) = /.exec(line) ?? [];
    return key in smaller ? `${key} = ${smaller[key]}` : line;
  });
  const config = join(folder, "small.toml");
  writeFileSync(config, lines.join("\n"));
  return config;
}

// Returns the console's address, once the program has printed it.
function told(child) {
  return new Promise((resolve, reject) => {
    let said = "";
    const late = setTimeout(() => fail("did not say where its console is"), PATIENCE);
    const fail = (why) => {
      clearTimeout(late);
      reject(new Error(`${PROGRAM} ${why}; it said:\n${said}`));
    };
    child.stderr.on("data", (data) => {
      said += data;
      const found = TELLS.exec(said);
      if (!found) return;
      clearTimeout(late);
      resolve(found[1]);
    });
    child.on("error", (error) => fail(`could not be started: ${error.message}`));
    child.on("exit", (code, signal) => {
      fail(`ended by ${signal ?? `exit code ${code}`} before its console was there`);
    });
  });
}

let common;

/// The session shared by tests that neither end nor disturb it.
export const shared = () => (common ??= Session.begin());

/// Ends the shared session, if there was one.
export const endShared = async () => (await common)?.end();

/// Ends sessions left running by failed tests.
export async function endLeft() {
  const kept = await common;
  for (const child of running) if (!kept?.has(child)) child.kill("SIGKILL");
}
