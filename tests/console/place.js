// Paths: the program under test, and the output folder. scripts/console-test.sh has filled it
// with the packages of package.json.

import { createRequire } from "node:module";
import { mkdirSync } from "node:fs";
import { fileURLToPath } from "node:url";

const root = new URL("../../", import.meta.url);

/// The page's files.
export const PAGE = fileURLToPath(new URL("crates/console/src/page/", root));
/// A configuration of the virtual bedside.
export const EXAMPLE = fileURLToPath(new URL("docs/examples/virtual.toml", root));
/// Screenshots, and the files of sessions.
export const OUT = fileURLToPath(new URL("out/console-test/", root));
/// The program, as set by scripts/console-test.sh.
export const PROGRAM = process.env.SONOWEAVE ?? fileURLToPath(new URL("target/debug/sonoweave", root));
/// The browser.
export const BROWSER = process.env.CHROMIUM ?? "/usr/bin/chromium";
/// Loads a package of package.json.
export const installed = createRequire(new URL("out/console-test/package.json", root));

mkdirSync(OUT, { recursive: true });
