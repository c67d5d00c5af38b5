// Lengths, angles, areas and volumes. The user marks places where the planes cross, or visible
// places of the view. The session computes the figure's size and its uncertainty.
//
// For tests and debugging, as `window.sonoweave.measure`: { open, kind, points, results,
// sources }.

/// Kinds of figures: their fewest and most points, and their names.
const FIGURES = {
  distance: { says: "Distance", least: 2, most: 2, more: "two points" },
  angle: { says: "Angle", least: 3, most: 3, more: "three points, the vertex second" },
  area: { says: "Area", least: 3, most: 200, more: "points around it, then Done" },
  ellipsoid: { says: "Volume, three diameters", least: 6, most: 6, more: "the ends of three diameters" },
  stack: { says: "Volume, outlines", least: 3, most: 200, more: "points around each outline, Next between them, then Done" },
};
// Number of results kept.
const KEPT = 20;
// Most slices drawn for a place.
const DRAWN = 12;
// The point of the view that keys mark: fractions of its width and height.
const MIDDLE = [0.5, 0.5];

export class Measure {
  #of;
  #draw;
  #at = () => null;
  #perScreen = () => 1;
  #ask;
  #speak;
  #points = [];
  #contours = [];
  #results = [];
  #sources = null;
  #says = "";
  /// The object described above.
  open = { open: false, kind: "distance", points: [], results: [], sources: null };

  /// `of(id)` returns the element of that id. `at()` returns the crossing of the planes, `{
  /// point, pixel_mm }`, or null if none are shown. `perScreen()` returns the view's pixels for
  /// each pixel of the screen. `draw(figures, slices, open)` draws on the planes and in the view.
  /// `ask(path, body)` sends a request to the session. `speak(words)` announces words to screen
  /// readers.
  constructor(of, { at, perScreen, draw, ask, speak }) {
    this.#of = of;
    this.#draw = draw;
    this.#at = at;
    this.#perScreen = perScreen;
    this.#ask = ask;
    this.#speak = speak;
    const kinds = of("measure-kind");
    for (const [kind, { says }] of Object.entries(FIGURES)) kinds.add(new Option(says, kind));
    kinds.addEventListener("change", () => this.#anew(kinds.value));
    of("measure-open").addEventListener("click", () => this.toggle());
    of("measure-mark").addEventListener("click", () => this.mark());
    of("measure-undo").addEventListener("click", () => this.#undo());
    of("measure-done").addEventListener("click", () => this.#done());
    of("measure-next").addEventListener("click", () => this.#next());
    of("measure-clear").addEventListener("click", () => this.clear());
    of("measure-slices").addEventListener("click", () => this.#slices());
    const keys = (element, mark) =>
      element.addEventListener("keydown", (event) => {
        if (!this.open.open || event.ctrlKey || event.altKey || event.metaKey || event.target.closest("select, button")) return;
        if (event.key === "Enter") mark();
        else if (event.key === "Backspace") this.#undo();
        else return;
        event.preventDefault();
      });
    keys(of("planes-panel"), () => this.mark());
    keys(of("view"), () => this.see(MIDDLE));
    this.settle(false);
    this.#show();
  }

  /// Switches between measuring and the grey value panel.
  toggle() {
    this.open.open = !this.open.open;
    this.#of("measure-open").setAttribute("aria-pressed", String(this.open.open));
    this.#of("measure").hidden = !this.open.open;
    this.#of("levels-panel").hidden = this.open.open;
    this.#of("view").classList.toggle("pointed", this.open.open);
    this.#show();
  }

  /// Moves the panel beside the planes if these are shown, else below the view.
  settle(planes) {
    const panel = this.#of("measure");
    const focused = panel.contains(document.activeElement) ? document.activeElement : null;
    this.#of(planes ? "planes-panel" : "view-panel").append(panel);
    // A moved element loses the focus.
    focused?.focus();
  }

  /// Marks the place where the planes cross; without planes, the place visible in the view's
  /// centre.
  mark() {
    if (!this.open.open) return;
    const at = this.#at();
    if (at) this.#mark(at);
    else this.see(MIDDLE);
  }

  /// Marks the place visible at these fractions of the view's width and height, after the
  /// session has answered which place it is.
  async see(at) {
    if (!this.open.open) return;
    const round = this.#round;
    // Requests run one after the other, in the order of the clicks.
    this.#seen = this.#seen.then(() => this.#ask("/v1/pick", { at }));
    const told = await this.#seen;
    if (round !== this.#round || !this.open.open) return;
    if (told.refused) this.#refused(told.refused);
    else this.#mark({ ...told, pixel_mm: told.pixel_mm * this.#perScreen() });
  }

  #seen = Promise.resolve();
  // Counts the figures begun: a late answer for an earlier figure is discarded.
  #round = 0;

  #mark(place) {
    this.#says = "";
    this.#points.push(place);
    const { most } = FIGURES[this.open.kind];
    if (this.#points.length === most) this.#done();
    else this.#show();
  }

  #refused(why) {
    this.#says = why;
    this.#show();
  }

  #anew(kind) {
    this.#round += 1;
    this.#begin(kind);
  }

  #begin(kind) {
    this.open.kind = kind;
    this.#of("measure-kind").value = kind;
    [this.#points, this.#contours, this.#says] = [[], [], ""];
    this.#show();
  }

  #undo() {
    if (this.#points.length > 0) this.#points.pop();
    else if (this.#contours.length > 0) this.#points = this.#contours.pop();
    this.#show();
  }

  #next() {
    this.#contours.push(this.#points);
    this.#points = [];
    this.#show();
  }

  /// Removes all results, for example when the volume is replaced.
  clear() {
    this.#results = [];
    this.#sources = null;
    this.#anew(this.open.kind);
  }

  async #done() {
    const { kind } = this.open;
    const contours = this.#points.length > 0 ? [...this.#contours, this.#points] : this.#contours;
    const points = this.#points;
    const body = { kind, ...(kind === "stack" ? { contours } : { points }) };
    const figures = kind === "stack" ? contours : [points];
    this.#begin(kind);
    const told = await this.#ask("/v1/measure", body);
    if (told.refused) {
      this.#says = told.refused;
    } else {
      this.#results = [{ ...told, figures }, ...this.#results].slice(0, KEPT);
      this.#speak(`${figure(told)}${unknown(told)}`);
    }
    this.#show();
  }

  async #slices() {
    const at = this.#at() ?? (await this.#ask("/v1/pick", { at: MIDDLE }));
    const told = at.refused ? at : await this.#ask("/v1/slices", { at: at.point });
    this.#sources = told.refused ? null : { ...told, at: at.point };
    this.#refused(told.refused ?? "");
  }

  #show() {
    const { kind } = this.open;
    const { least, most, more } = FIGURES[kind];
    const count = this.#points.length;
    const open = this.open.open;
    const enough = kind === "stack" ? this.#contours.length + (count >= least ? 1 : 0) >= 2 && (count === 0 || count >= least) : count >= least;
    const flexible = least !== most;
    this.#of("measure-done").hidden = !flexible;
    this.#of("measure-done").disabled = !enough;
    this.#of("measure-next").hidden = kind !== "stack";
    this.#of("measure-next").disabled = count < least;
    this.#of("measure-undo").disabled = count === 0 && this.#contours.length === 0;
    this.#of("measure-clear").disabled = this.#results.length === 0 && this.#sources === null && count === 0 && this.#contours.length === 0;
    const marked = `${count} marked${kind === "stack" ? `, ${this.#contours.length} outlines before` : ""}`;
    write(this.#of("measure-says"), this.#says || (count > 0 || this.#contours.length > 0 ? marked : `Mark ${more}: click on the volume or a plane, or press Enter there.`));
    if (this.#says) this.#speak(this.#says);
    this.#of("measure-says").classList.toggle("bad", this.#says !== "");
    this.#list();
    Object.assign(this.open, { points: this.#points, results: this.#results, sources: this.#sources });
    const drawn = (places, kind, done) => ({ points: places.map(({ point }) => point), kind, done });
    const figures = [...this.#results.flatMap(({ kind, figures }) => figures.map((places) => drawn(places, kind, true))), ...[...this.#contours, this.#points].map((places) => drawn(places, kind, false))];
    this.#draw(open ? figures : [], open && this.#sources ? this.#sources.slices.slice(0, DRAWN).map(({ corners }) => corners) : [], open);
  }

  #list() {
    const lines = this.#results.map((result) => [`${figure(result)}${unknown(result)}`, `${[parts(result), ...result.notes].join("; ")}.`]);
    if (this.#sources) lines.unshift(sources(this.#sources));
    const list = this.#of("measure-results");
    while (list.children.length > lines.length) list.lastElementChild.remove();
    while (list.children.length < lines.length) {
      const item = document.createElement("li");
      item.append(document.createElement("strong"), " ", document.createElement("span"));
      list.append(item);
    }
    lines.forEach(([strong, more], n) => {
      write(list.children[n].firstElementChild, strong);
      write(list.children[n].lastElementChild, more);
    });
  }
}

/// `23.4 ± 0.6 mm`: with as many digits as the error justifies.
export function figure({ value, error, unit }) {
  const digits = error >= 10 || error === 0 ? 0 : Math.min(2, 1 - Math.floor(Math.log10(error)));
  const scale = unit === "mm³" && value >= 1000 ? [1000, "ml"] : unit === "mm²" && value >= 100 ? [100, "cm²"] : [1, unit];
  const shown = scale[0] === 1 ? Math.max(0, digits) : Math.min(3, Math.max(0, digits + Math.round(Math.log10(scale[0]))));
  return `${(value / scale[0]).toFixed(shown)} ± ${(error / scale[0]).toFixed(shown)} ${scale[1]}`;
}

/// The words beside a measurement whose calibration error is unknown.
function unknown({ of_calibration: calibration }) {
  return calibration === null ? ", calibration error unknown" : "";
}

function parts({ kind, of_calibration: calibration, of_tracker: tracker, of_sampling: sampling, of_clicks: clicks, of_noise: noise, unit }) {
  const causes = { calibration, tracker, sampling, clicks, noise };
  const known = Object.entries(causes).filter(([, error]) => error !== null).map(([cause, error]) => `${cause} ${error.toFixed(2)}`);
  return `${FIGURES[kind].says.toLowerCase()}; 95 of 100 lie within (${known.join(", ")} ${unit})`;
}

function sources({ count, slices }) {
  if (count === 0) return ["No slice", "reaches this place."];
  const [{ frame, off_mm: off, share, time_s: time }] = slices;
  return [`${count} ${count === 1 ? "slice" : "slices"}`, `made this place; most of it frame ${frame}, ${Math.abs(off).toFixed(2)} mm off, ${Math.round(100 * share)} %, ${time.toFixed(1)} s into the volume. Their planes are drawn.`];
}

function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
