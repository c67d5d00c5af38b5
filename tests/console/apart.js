// A browser without a debugger. One that is attached gets every message of the page's socket as
// text, which takes processor time and delays pictures.

import { spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

import { SIZES } from "./page.js";
import { BROWSER, installed } from "./place.js";

const { chromium } = installed("playwright-core");
const ATTACHES = /ws:\/\/\S+/;

export class Apart {
  #child;
  #profile;
  #debugger;

  /// Opens a page.
  static async open(address, { width, height } = SIZES.desk) {
    const apart = new Apart();
    apart.#profile = mkdtempSync(join(tmpdir(), "sonoweave-browser-"));
    const flags = ["--headless=new", "--no-first-run", "--remote-debugging-port=0", `--user-data-dir=${apart.#profile}`, `--window-size=${width},${height}`];
    // Root has no sandbox; only our own pages are opened.
    if (process.getuid?.() === 0) flags.push("--no-sandbox");
    apart.#child = spawn(BROWSER, [...flags, address], { stdio: ["ignore", "ignore", "pipe"] });
    process.on("exit", () => apart.#child.kill("SIGKILL"));
    apart.#debugger = await new Promise((resolve, reject) => {
      let said = "";
      apart.#child.stderr.on("data", (data) => {
        said += data;
        if (ATTACHES.test(said)) resolve(ATTACHES.exec(said)[0]);
      });
      apart.#child.on("exit", () => reject(new Error(`the browser has ended: ${said}`)));
    });
    return apart;
  }

  /// Evaluates a function in the page, and leaves it alone again.
  async evaluate(of) {
    const browser = await chromium.connectOverCDP(this.#debugger);
    const value = await browser.contexts()[0].pages()[0].evaluate(of);
    // This disconnects only.
    await browser.close();
    return value;
  }

  /// Ends the browser.
  async close() {
    const ended = new Promise((resolve) => this.#child.removeAllListeners("exit").on("exit", resolve));
    this.#child.kill();
    await ended;
    rmSync(this.#profile, { recursive: true, force: true });
  }
}
