// What the session is told to do: to record, freeze, clear, and to keep what is seen. Each has a button and a key, and is asked about first where something would be lost.

const KEYS = { r: "record", f: "freeze", Delete: "clear", k: "snapshot", v: "save" };

export class Deeds {
  #buttons = {};
  #ask;
  #send;
  #steers = false;
  #desk = null;
  #volume = null;
  #asked = null;

  /// `row` holds the buttons, `ask` is the dialog that asks, `send(wish)` brings it to the session.
  constructor(row, ask, send) {
    this.#ask = ask;
    this.#send = send;
    for (const button of row.querySelectorAll("[data-deed]")) {
      this.#buttons[button.dataset.deed] = button;
      button.addEventListener("click", () => this.#wish(button.dataset.deed));
    }
    document.addEventListener("keydown", (event) => {
      if (event.defaultPrevented || event.ctrlKey || event.altKey || event.metaKey || event.repeat || document.querySelector("dialog[open]")) return;
      if (event.target.closest?.("input, select, textarea")) return;
      const deed = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
      if (!deed) return;
      event.preventDefault();
      this.#wish(deed === "record" && this.#desk?.records && this.#desk.phase === "running" ? "stop" : deed);
    });
    // The dialog's own `close` comes with the screen's next frame, when the next question may be open already.
    ask.querySelector("form").addEventListener("submit", ({ submitter }) => {
      if (submitter.value === "yes") this.#send(this.#asked);
    });
    this.#show();
  }

  /// What the session tells of itself; null while it is not heard.
  tell(desk, volume) {
    this.#desk = desk;
    this.#volume = volume;
    this.#show();
  }

  /// Whether this page steers.
  control(steers) {
    this.#steers = steers === true;
    this.#show();
  }

  #wish(deed) {
    if (this.#buttons[deed].disabled) return;
    const { records = false, frozen = false } = this.#desk ?? {};
    const lost = this.#volume && !records;
    if (deed === "freeze") this.#send({ do: "freeze", on: !frozen });
    else if (deed === "clear") this.#sure({ do: "clear" }, "Throw this volume away?", records ? "It begins anew with the next slice. The recording keeps all slices." : "It begins anew with the next slice. It is not recorded: what is not saved is lost.", "Clear");
    else if ((deed === "record" || deed === "scan") && lost && this.#desk.phase === "running") this.#sure({ do: deed }, "Begin a new volume?", "This one is not recorded: what is not saved is lost.", "Begin anew");
    else this.#send({ do: deed });
  }

  #sure(wish, question, consequence, yes) {
    this.#asked = wish;
    this.#ask.querySelector("h2").textContent = question;
    this.#ask.querySelector("p").textContent = consequence;
    this.#ask.querySelector("[value=yes]").textContent = yes;
    this.#ask.showModal();
  }

  #show() {
    const { phase = null, records = false, frozen = false, keeps = false, saving = null } = this.#desk ?? {};
    const may = this.#steers && (phase === "running" || phase === "over");
    const runs = may && phase === "running";
    const nowhere = keeps ? "" : "; this session was started without a folder to keep anything in (--keep DIR)";
    const set = (name, enabled, title) => {
      const button = this.#buttons[name];
      if (button.disabled === enabled) button.disabled = !enabled;
      if (button.title !== title) button.title = title;
    };
    set("record", may && keeps && !(phase === "running" && records), `Begins a new volume and records all that it is made of (key R)${nowhere}`);
    set("stop", runs, `Ends the ${records ? "recording; its volume" : "session; its volume"} stays in view${records ? " (key R)" : ""}`);
    set("scan", may && phase === "over", "Begins a new volume without recording it");
    this.#buttons.stop.hidden = phase === "over";
    this.#buttons.scan.hidden = phase !== "over";
    set("freeze", runs, frozen ? "Slices go into the volume again (key F)" : "Pictures are no longer used until this is pressed again (key F)");
    this.#buttons.freeze.setAttribute("aria-pressed", String(frozen));
    set("clear", runs && this.#volume !== null && this.#volume !== undefined, "Throws the volume away and begins it anew (key Delete)");
    set("snapshot", may && keeps, `Keeps the pictures that you see as PNG files (key K)${nowhere}`);
    set("save", may && keeps && saving === null && Boolean(this.#volume), `Writes the volume as it is now, with its weights (key V)${nowhere}`);
  }
}
