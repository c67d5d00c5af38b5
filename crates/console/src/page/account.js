// The session status on the cards below the pictures. Only changed texts are written.

import { count, device, devices, frames, kind, milliseconds, recording, volume } from "./words.js";

export const SIGNS = { well: "✓", heed: "!", bad: "✕", wait: "…", plain: "·", rec: "●" };
const RATES = [
  ["frames", "frames"],
  ["poses", "poses"],
  ["pictures", "views"],
];

export class AccountCards {
  #of;

  /// `of(id)` returns the element of that id.
  constructor(of) {
    this.#of = of;
  }

  /// Called once, and after changes.
  about(about) {
    write(this.#of("session"), kind(about));
    this.#of("session").dataset.kind = about.kind;
    document.title = `${about.name} · sonoweave`;
    this.#of("session").title = `sonoweave ${about.version}, ${about.name}`;
  }

  /// Called four times a second. `screen` and `view`: delays until pictures are on this screen;
  /// `shown`: live pictures per second here.
  update(account, { screen, view, shown }) {
    // The devices of an ended session are closed, which is no fault.
    const over = account.desk?.phase === "over";
    this.#vital("devices", over ? { how: "plain", says: "closed" } : devices(account.devices));
    rows(this.#of("devices"), over ? [] : account.devices.map((one) => {
      const { how, name, says, more } = device(one);
      return { how, strong: name, says: more ? `${says}; ${more}` : says };
    }));

    const fates = frames(account);
    this.#vital("frames", fates);
    rows(this.#of("frames"), fates.lines.map(({ how, n, says, key }) => ({ how, key, strong: count(n), says })));
    this.#bar(fates.parts);

    const ms = screen ? Math.round(screen.median) : null;
    write(this.#of("times-vital"), ms === null ? "–" : `${ms} ms to screen`);
    table(this.#of("times"), [
      ["this screen", screen],
      ["in the volume", account.capture_to_volume_ms],
      ["view is drawn", account.capture_to_picture_ms],
      ["view on screen", view],
    ]);
    const rates = RATES.map(([key, says]) => ({ how: "plain", strong: (account.rates[key] ?? 0).toFixed(1), says: `${says}/s` }));
    rates.push({ how: "plain", strong: shown.toFixed(1), says: "shown/s" });
    rows(this.#of("rates"), rates);

    const kept = recording(account.recording, over);
    this.#vital("recording", kept);
    rows(this.#of("recording"), kept.lines);
    write(this.#of("volume"), volume(account.volume));
    rows(this.#of("notes"), account.notes.length > 0 ? account.notes.map((says) => ({ how: "plain", says })) : [{ how: "plain", says: "none" }]);
  }

  #vital(name, { how, says }) {
    const element = this.#of(`${name}-vital`);
    if (element.dataset.how !== how) element.dataset.how = how;
    write(element, `${SIGNS[how]} ${says}`);
  }

  #bar(parts) {
    const bar = this.#of("frames-bar");
    while (bar.children.length < parts.length) bar.append(document.createElement("span"));
    parts.forEach(({ key, share }, n) => {
      bar.children[n].className = key;
      // A part that is not empty stays visible, however small.
      bar.children[n].style.flexGrow = share === 0 ? 0 : Math.max(share, 0.01);
    });
  }
}

export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function rows(list, entries) {
  while (list.children.length > entries.length) list.lastElementChild.remove();
  while (list.children.length < entries.length) {
    const item = document.createElement("li");
    const sign = document.createElement("span");
    sign.className = "sign";
    sign.setAttribute("aria-hidden", "true");
    item.append(sign, document.createElement("strong"), " ", document.createElement("span"));
    list.append(item);
  }
  entries.forEach(({ how, key, strong, says, title }, n) => {
    const item = list.children[n];
    item.className = key ? `${how} ${key}` : how;
    item.title = title ?? "";
    const [sign, name, text] = item.children;
    write(sign, SIGNS[how]);
    write(name, strong ?? "");
    write(text, says);
  });
}

function table(body, entries) {
  while (body.rows.length < entries.length) {
    const row = body.insertRow();
    const head = document.createElement("th");
    head.scope = "row";
    row.append(head);
    row.insertCell();
    row.insertCell();
  }
  entries.forEach(([says, spread], n) => {
    const { cells } = body.rows[n];
    write(cells[0], says);
    write(cells[1], milliseconds(spread?.median));
    write(cells[2], milliseconds(spread?.p99));
  });
}
