// The session commands: record, freeze, clear, mark, snapshot, save. Each has a button and a key.
// The page asks for confirmation before a command that loses data.

const KEYS = { r: "record", f: "freeze", Delete: "clear", b: "mark", k: "snapshot", v: "save" };

export class CommandButtons {
  #buttons = {};
  #ask;
  #send;
  #steers = false;
  #desk = null;
  #volume = null;
  #pending = null;

  /// `row` holds the buttons, `ask` is the confirmation dialog, `send(message)` sends a command to
  /// the session.
  constructor(row, ask, send) {
    this.#ask = ask;
    this.#send = send;
    for (const button of row.querySelectorAll("[data-command]")) {
      this.#buttons[button.dataset.command] = button;
      button.addEventListener("click", () => this.#choose(button.dataset.command));
    }
    document.addEventListener("keydown", (event) => {
      if (event.defaultPrevented || event.ctrlKey || event.altKey || event.metaKey || event.repeat || document.querySelector("dialog[open]")) return;
      if (event.target.closest?.("input, select, textarea")) return;
      const command = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
      if (!command) return;
      event.preventDefault();
      this.#choose(command === "record" && this.#desk?.records && this.#desk.phase === "running" ? "stop" : command);
    });
    // The dialog's own `close` event arrives with the screen's next frame, when the next
    // question may already be open.
    ask.querySelector("form").addEventListener("submit", ({ submitter }) => {
      if (submitter.value === "yes") this.#send(this.#pending);
    });
    this.#show();
  }

  /// Receives the session's status; null while the connection is lost.
  update(desk, volume) {
    this.#desk = desk;
    this.#volume = volume;
    this.#show();
  }

  /// Sets whether this page has control.
  control(steers) {
    this.#steers = steers === true;
    this.#show();
  }

  #choose(command) {
    if (this.#buttons[command].disabled) return;
    const { records = false, frozen = false } = this.#desk ?? {};
    const lost = this.#volume && !records;
    if (command === "freeze") this.#send({ do: "freeze", on: !frozen });
    else if (command === "clear") this.#sure({ do: "clear" }, "Throw this volume away?", records ? "It begins anew with the next slice. The recording keeps all slices." : "It begins anew with the next slice. It is not recorded: what is not saved is lost.", "Clear");
    else if ((command === "record" || command === "scan") && lost && this.#desk.phase === "running") this.#sure({ do: command }, "Begin a new volume?", "This one is not recorded: what is not saved is lost.", "Begin anew");
    else this.#send({ do: command });
  }

  #sure(message, question, consequence, yes) {
    this.#pending = message;
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
    set("mark", runs && records, "Marks this moment in the recording, such as the end of breathing out, for a gate by markers (key B)");
    this.#buttons.mark.hidden = !(runs && records);
    set("snapshot", may && keeps, `Keeps the pictures that you see as PNG files (key K)${nowhere}`);
    set("save", may && keeps && saving === null && Boolean(this.#volume), `Writes the volume as it is now, with its weights (key V)${nowhere}`);
  }
}
