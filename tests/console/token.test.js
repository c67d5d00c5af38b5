// A session with a token: the page asks for it, over TLS, and then shows the session.

import assert from "node:assert/strict";
import { chmodSync, copyFileSync, mkdtempSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";

import { close, drawn, open, shot } from "./page.js";
import { installed, OUT } from "./place.js";
import { Session } from "./session.js";

const axe = installed("axe-core");
const TOKEN = "c0ffee00c0ffee00c0ffee00c0ffee00";
const FIXTURES = new URL("../../crates/console/src/tests/", import.meta.url);

test("a page that is not known is asked for the token, which is shown once", async () => {
  const folder = mkdtempSync(join(OUT, "session-token-"));
  const put = (name, mode, from) => {
    const path = join(folder, name);
    if (from) copyFileSync(new URL(from, FIXTURES), path);
    else writeFileSync(path, `${TOKEN}\n`);
    chmodSync(path, mode);
  };
  put("console.crt", 0o644, "bedside-3.crt");
  put("console.key", 0o600, "bedside-3.key");
  put("console.token", 0o600);
  const status = '[status]\ncertificate = "console.crt"\nkey = "console.key"\ntoken_file = "console.token"\nnames = ["localhost"]\n';
  const session = await Session.with(folder, status, "0.0.0.0");
  const { port } = session;
  const seen = await open(`https://localhost:${port}/`, { ignoreHTTPSErrors: true });
  const { page } = seen;
  const token = page.getByLabel("Token");
  await token.waitFor();
  await page.evaluate(axe.source);
  const { violations } = await page.evaluate(() => window.axe.run());
  assert.deepEqual(violations.map(({ id, nodes }) => [id, nodes.map(({ html }) => html)]), []);
  await shot(page, "token");
  await token.fill("wrong");
  await page.keyboard.press("Enter");
  await page.getByRole("alert").filter({ hasText: "This is not the session's token" }).waitFor();
  await shot(page, "token-wrong");
  await token.fill(TOKEN);
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => window.sonoweave?.connected);
  await drawn(page, "slice", 3);
  assert.equal(await page.evaluate(() => document.cookie), "", "no script reads what it is known by");
  await page.reload();
  await drawn(page, "slice", 3);
  // Another browser is not admitted.
  const other = await open(`https://localhost:${port}/`, { ignoreHTTPSErrors: true });
  await other.page.getByLabel("Token").waitFor();
  await close(other);
  // A restarted session does not admit this browser either; it asks for the token again.
  await session.end("SIGKILL");
  const again = await Session.with(folder, status, "0.0.0.0", port);
  await page.getByLabel("Token").waitFor();
  await close(seen);
  await again.end();
});
