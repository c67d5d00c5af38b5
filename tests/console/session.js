// A session at the virtual bedside, with its console.

import { execFileSync, spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";

import { EXAMPLE, OUT, PROGRAM } from "./place.js";

// For how long a session may take to begin or to end, ms.
const PATIENCE = 60_000;
const TELLS = /console: (https?:\/\/\S+)/;

// None outlives the tests, however they end.
const running = new Set();
process.on("exit", () => running.forEach((child) => child.kill("SIGKILL")));

export class Session {
  #child;
  #place;
  #ended;
  /// Where its page is.
  address;

  /// Begins one whose console listens at this port, 0 for any that is free.
  static async begin(port = 0) {
    const place = mkdtempSync(join(OUT, "session-"));
    return Session.#run(place, ["demo", "--headless", "--out", place, "--console", `127.0.0.1:${port}`]);
  }

  /// One with small pictures and coarse voxels, whose volume is drawn anew at once however busy the machine is.
  static async small() {
    const place = mkdtempSync(join(OUT, "session-"));
    return Session.#run(place, ["live", "--config", small(place, "8"), "--headless", "--console", "127.0.0.1:0"]);
  }

  /// The same at more pictures a second, recorded in a folder that is left as it is.
  static async recorded(folder) {
    return Session.#run(null, ["live", "--config", small(folder, "20"), "--record", folder, "--headless", "--console", "127.0.0.1:0"]);
  }

  /// One whose pictures are painted beforehand, so that painting takes no time from what is measured; pictures are so large.
  static async painted(folder, size) {
    const text = readFileSync(EXAMPLE, "utf8").replace(/^reference_station.*$/m, "").replace(/^#painted = true.*$/m, "painted = true").replace(/^size = .*$/m, `size = "${size}"`);
    const config = join(folder, "painted.toml");
    writeFileSync(config, text);
    return Session.#run(null, ["live", "--config", config, "--headless", "--console", "127.0.0.1:0"]);
  }

  /// Shows a recorded session, and keeps what it is told to keep in a folder.
  static async replay(recording, keep) {
    return Session.#run(null, ["replay", recording, "--keep", keep, "--console", "127.0.0.1:0"]);
  }

  /// Begins one by the virtual bedside's own configuration with more behind it, in a folder that is left as it is.
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

  /// Where it leaves what it leaves.
  get folder() {
    return this.#place;
  }

  /// Its process.
  get pid() {
    return this.#child.pid;
  }

  /// Whether this is its process.
  has(child) {
    return this.#child === child;
  }

  /// The port that its console listens at.
  get port() {
    return Number(new URL(this.address).port);
  }

  /// Stops it in the middle of whatever it does, as a machine without memory would; or lets it go on.
  hang(whether) {
    this.#child.kill(whether ? "SIGSTOP" : "SIGCONT");
  }

  /// Ends it: by SIGINT as its user would, or by SIGKILL as a power cut would.
  async end(signal = "SIGINT") {
    this.#child.kill(signal);
    const late = setTimeout(() => this.#child.kill("SIGKILL"), PATIENCE);
    await this.#ended;
    clearTimeout(late);
    if (this.#place) rmSync(this.#place, { recursive: true, force: true });
  }
}

// The virtual bedside's own configuration, but for what makes it small, as a file in a folder.
function small(folder, hz) {
  const smaller = { size: '"160x120"', rate_hz: hz, spacing_mm: "2.0", image_size: '"160x160"', frames: "60" };
  const lines = readFileSync(EXAMPLE, "utf8").split("\n").map((line) => {
    const [, key] = /^(\w+) = /.exec(line) ?? [];
    return key in smaller ? `${key} = ${smaller[key]}` : line;
  });
  const config = join(folder, "small.toml");
  writeFileSync(config, lines.join("\n"));
  return config;
}

// The address, once the program says it.
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

/// The session that tests look at which neither end nor disturb it.
export const shared = () => (common ??= Session.begin());

/// Ends it, if there was one.
export const endShared = async () => (await common)?.end();

/// Ends what a test that has failed has left running.
export async function endLeft() {
  const kept = await common;
  for (const child of running) if (!kept?.has(child)) child.kill("SIGKILL");
}
