// All tests of the console's page, one after the other: two cores cannot render two sessions.

import { after, afterEach } from "node:test";

import { closeAll, quit } from "./page.js";
import { endLeft, endShared } from "./session.js";

await import("./words.test.js");
await import("./pictures.test.js");
await import("./steering.test.js");
await import("./movie.test.js");
await import("./commands.test.js");
await import("./mask.test.js");
await import("./planes.test.js");
await import("./measure.test.js");
await import("./replay.test.js");
await import("./access.test.js");
await import("./troubles.test.js");
await import("./guidance.test.js");
await import("./line.test.js");
await import("./slow.test.js");
await import("./token.test.js");
await import("./gpu.test.js");

afterEach(async () => {
  await closeAll();
  await endLeft();
});
after(async () => {
  await quit();
  await endShared();
});
