// Grey value panel: the histogram of the planes' pixels, the planes' window (black and white),
// and the opacity curve of the volume's picture. The user drags handles, or moves them by keys.

const SVG = "http://www.w3.org/2000/svg";
// The pointer takes the nearest handle within this distance, CSS pixels.
const NEAR = 26;
// Shortest interval between commands, ms: rendering their result takes time.
const OFTEN = 60;
// Steps by keys.
const STEP = { grey: 1 / 128, opacity: 0.05, large: 5 };
const MOST_POINTS = 16;
// Margins of the curve; the grey ramp lies below it.
const ROOM = { left: 8, right: 8, top: 8, bottom: 24 };

export class Levels {
  #room;
  #svg;
  #preset;
  #says;
  #greys;
  #looks;
  #send;
  #steers = false;
  #levels = [0, 255];
  #counts = new Map();
  #window = [0, 255];
  #style = null;
  #points = null;
  #held = null;
  #own = -Infinity;
  #sent = new Map();
  #ground = svg("g", {});
  #grips = new Map();
  #drawing = false;

  /// `send(message)` sends a command to the session.
  constructor({ room, preset, says, greys, looks }, send) {
    this.#room = room;
    this.#preset = preset;
    this.#says = says;
    this.#greys = greys;
    this.#looks = looks;
    this.#send = send;
    this.#svg = svg("svg", { id: "levels", role: "group", "aria-label": "Grey levels: window of the planes and opacity of the volume" });
    this.#svg.append(this.#ground);
    room.append(this.#svg);
    new ResizeObserver(() => this.#draw()).observe(room);
    preset.addEventListener("change", () => {
      this.#reset({ do: "transfer", preset: preset.value || null });
    });
    greys.addEventListener("click", () => this.#reset({ do: "reset", of: "window" }));
    looks.addEventListener("click", () => this.#reset({ do: "transfer" }));
    this.#listen();
    this.control(false);
  }

  control(steers) {
    this.#steers = steers;
    for (const one of [this.#preset, this.#greys, this.#looks]) one.disabled = !steers;
    this.#svg.classList.toggle("steered", steers);
    this.#draw();
  }

  /// Receives the histogram and window that come with a plane.
  counts({ kind, histogram, levels, window }) {
    this.#counts.set(kind, histogram);
    this.#levels = levels;
    if (!this.#isOwn()) this.#window = window;
    this.#draw();
  }

  /// Receives the style of the volume's picture; null if no volume is rendered.
  style(told) {
    this.#style = told;
    if (!told) return;
    if (!this.#isOwn()) this.#points = told.points;
    const options = [["", `as configured (${told.configured})`, ""], ...told.presets.map(([name, purpose]) => [name, name, purpose])];
    this.#preset.replaceChildren(
      ...options.map(([value, text, title]) => Object.assign(document.createElement("option"), { value, textContent: text, title })),
    );
    this.#preset.value = told.preset ?? "";
    const says = !told.heeded ? "This session's picture heeds no opacities." : told.points ? "Bars: greys of what the planes show." : "This look shows surfaces: it has no curve to drag.";
    if (this.#says.textContent !== says) this.#says.textContent = says;
    this.#draw();
  }

  #isOwn() {
    return this.#held !== null || performance.now() - this.#own < 500;
  }

  #reset(message) {
    [this.#own, this.#held] = [-Infinity, null];
    // Commands waiting to be sent are outdated.
    for (const last of this.#sent.values()) {
      clearTimeout(last.timer);
      last.timer = null;
    }
    this.#send(message);
  }

  #size() {
    return { width: Math.max(60, this.#room.clientWidth), height: Math.max(60, this.#room.clientHeight) };
  }

  #x(grey) {
    const [low, high] = this.#levels;
    const { width } = this.#size();
    return ROOM.left + ((grey - low) / (high - low)) * (width - ROOM.left - ROOM.right);
  }

  #y(opacity) {
    const { height } = this.#size();
    return ROOM.top + (1 - opacity) * (height - ROOM.top - ROOM.bottom);
  }

  #at(event) {
    const { left, top } = this.#svg.getBoundingClientRect();
    const [x, y] = [event.clientX - left, event.clientY - top];
    const { width, height } = this.#size();
    const [low, high] = this.#levels;
    const grey = low + ((x - ROOM.left) / (width - ROOM.left - ROOM.right)) * (high - low);
    const opacity = 1 - (y - ROOM.top) / (height - ROOM.top - ROOM.bottom);
    return { x, y, grey: clamp(grey, low, high), opacity: clamp(opacity, 0, 1) };
  }

  // Returns the handles: { name, x, y }.
  #handles() {
    const { height } = this.#size();
    const ends = this.#window.map((grey, n) => ({ name: n === 0 ? "black" : "white", x: this.#x(grey), y: height - ROOM.bottom / 2 }));
    const points = this.#edits() ? this.#points.map(([grey, opacity], n) => ({ name: `point-${n}`, n, x: this.#x(grey), y: this.#y(opacity) })) : [];
    return [...ends, ...points];
  }

  #edits() {
    return this.#points !== null && this.#style?.heeded === true;
  }

  #listen() {
    this.#svg.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || !this.#steers) return;
      const { x, y } = this.#at(event);
      const [nearest] = this.#handles().map((handle) => ({ ...handle, far: Math.hypot(handle.x - x, handle.y - y) })).sort((a, b) => a.far - b.far);
      if (!nearest || nearest.far > NEAR) return;
      event.preventDefault();
      this.#svg.setPointerCapture(event.pointerId);
      this.#held = nearest;
      this.#focus(nearest.name);
    });
    this.#svg.addEventListener("pointermove", (event) => {
      if (!this.#held) return;
      const { grey, opacity } = this.#at(event);
      this.#move(this.#held.name, grey, opacity);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      this.#svg.addEventListener(end, () => {
        if (this.#held) this.#own = performance.now();
        this.#held = null;
      });
    }
    this.#svg.addEventListener("dblclick", (event) => {
      if (!this.#steers || !this.#edits()) return;
      const { grey, opacity } = this.#at(event);
      this.#add(grey, opacity);
    });
    this.#svg.addEventListener("keydown", (event) => {
      const name = event.target.dataset?.name;
      if (!name || !this.#steers || event.ctrlKey || event.altKey || event.metaKey) return;
      if (this.#key(name, event.key, event.shiftKey ? STEP.large : 1)) event.preventDefault();
    });
  }

  #key(name, key, times) {
    const [low, high] = this.#levels;
    const aside = { ArrowLeft: -1, ArrowRight: 1 }[key];
    const up = { ArrowDown: -1, ArrowUp: 1 }[key];
    const end = ["black", "white"].indexOf(name);
    const n = Number(name.split("-")[1]);
    if (end < 0 && !this.#points?.[n]) return false;
    const [grey, opacity] = end < 0 ? this.#points[n] : [this.#window[end], 0];
    if (aside) this.#move(name, grey + aside * times * STEP.grey * (high - low), opacity);
    else if (up && end < 0) this.#move(name, grey, clamp(opacity + up * times * STEP.opacity, 0, 1));
    else if (up) this.#move(name, grey + up * times * STEP.grey * (high - low), opacity);
    else if (end < 0 && key === "Delete" && this.#points.length > 1) this.#points = this.#points.toSpliced(n, 1);
    else if (end < 0 && (key === "Insert" || key === "+")) this.#add(...halfway(this.#points, n, high));
    else return false;
    if (key === "Delete") this.#curve();
    this.#own = performance.now();
    return true;
  }

  #add(grey, opacity) {
    if (this.#points.length >= MOST_POINTS) return;
    const points = [...this.#points, [grey, opacity]].sort((a, b) => a[0] - b[0]);
    if (points.some(([at], n) => n > 0 && at - points[n - 1][0] < this.#least())) return;
    this.#points = points;
    this.#curve();
  }

  // Smallest distance between points, and between the window's ends.
  #least() {
    return (this.#levels[1] - this.#levels[0]) / 512;
  }

  #move(name, grey, opacity) {
    const [low, high] = this.#levels;
    const least = this.#least();
    this.#own = performance.now();
    const end = ["black", "white"].indexOf(name);
    if (end >= 0) {
      const window = [...this.#window];
      window[end] = end === 0 ? clamp(grey, Math.min(low, window[1] - least), window[1] - least) : clamp(grey, window[0] + least, Math.max(high, window[0] + least));
      this.#window = window;
      this.#soon("window", () => ({ do: "window", black: round(this.#window[0]), white: round(this.#window[1]) }));
    } else {
      const n = Number(name.split("-")[1]);
      const points = this.#points.map((point) => [...point]);
      const before = n > 0 ? points[n - 1][0] + least : Math.min(low, points[n][0]);
      const after = n + 1 < points.length ? points[n + 1][0] - least : Math.max(high, points[n][0]);
      points[n] = [clamp(grey, before, after), clamp(opacity, 0, 1)];
      this.#points = points;
      this.#curve();
    }
    this.#draw();
  }

  #curve() {
    const points = () => this.#points.map(([grey, opacity]) => [round(grey), round(opacity)]);
    this.#soon("transfer", () => ({ do: "transfer", preset: this.#preset.value || null, points: points() }));
    this.#draw();
  }

  // Sends the newest command of each name, at most once per `OFTEN`.
  #soon(name, message) {
    const last = this.#sent.get(name) ?? { at: -Infinity, timer: null };
    this.#sent.set(name, last);
    if (last.timer !== null) return;
    const send = () => {
      [last.at, last.timer] = [performance.now(), null];
      this.#send(message());
    };
    const wait = last.at + OFTEN - performance.now();
    if (wait <= 0) send();
    else last.timer = setTimeout(send, wait);
  }

  // Draws with the screen's next frame, once for any number of changes.
  #draw() {
    if (this.#drawing) return;
    this.#drawing = true;
    requestAnimationFrame(() => {
      this.#drawing = false;
      const { width, height } = this.#size();
      this.#svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
      const floor = this.#y(0);
      const parts = [svg("rect", { x: ROOM.left, y: ROOM.top, width: width - ROOM.left - ROOM.right, height: floor - ROOM.top, class: "levels-ground" })];
      parts.push(...this.#bars(floor), ...this.#ramp(height));
      if (this.#edits()) parts.push(...this.#line());
      this.#ground.replaceChildren(...parts);
      this.#grip();
    });
  }

  // The handle elements are kept, so that a focused handle keeps the focus.
  #grip() {
    const { height } = this.#size();
    const points = this.#edits() ? this.#points : [];
    const wanted = [
      ...["black", "white"].map((name, n) => {
        const [x, y] = [this.#x(clamp(this.#window[n], ...this.#levels)), height - ROOM.bottom];
        const shape = ["path", { d: `M${x} ${y}l6 -7h-12zM${x} ${y}v${ROOM.bottom - 2}`, class: "levels-end" }];
        return { name, label: `${name} from grey level`, grey: this.#window[n], text: `grey ${Math.round(this.#window[n])}`, shape };
      }),
      ...points.map(([grey, opacity], n) => {
        const shape = ["circle", { cx: this.#x(clamp(grey, ...this.#levels)), cy: this.#y(opacity), r: 7, class: "levels-point" }];
        return { name: `point-${n}`, label: `Opacity, point ${n + 1} of ${points.length}`, grey, text: `grey ${Math.round(grey)}, opacity ${opacity.toFixed(2)}`, shape };
      }),
    ];
    const [low, high] = this.#levels;
    for (const name of this.#grips.keys()) {
      if (wanted.some((one) => one.name === name)) continue;
      this.#grips.get(name).remove();
      this.#grips.delete(name);
    }
    for (const { name, label, grey, text, shape: [kind, shape] } of wanted) {
      let grip = this.#grips.get(name);
      if (!grip) {
        grip = svg("g", { "data-name": name, role: "slider" });
        grip.append(svg(kind, {}));
        this.#svg.append(grip);
        this.#grips.set(name, grip);
      }
      const told = { tabindex: this.#steers ? 0 : -1, "aria-label": label, "aria-valuemin": low, "aria-valuemax": high, "aria-valuenow": Math.round(grey), "aria-valuetext": text, "aria-disabled": String(!this.#steers) };
      set(grip, told);
      set(grip.firstChild, shape);
    }
  }

  #bars(floor) {
    const sum = [];
    for (const counts of this.#counts.values()) counts.forEach((count, n) => (sum[n] = (sum[n] ?? 0) + count));
    // The logarithm keeps rare grey values visible beside frequent ones.
    const most = Math.log1p(Math.max(1, ...sum));
    const [low, high] = this.#levels;
    const wide = (this.#x(high) - this.#x(low)) / Math.max(1, sum.length);
    return sum.map((count, n) => {
      const tall = (Math.log1p(count) / most) * (floor - ROOM.top);
      return svg("rect", { x: this.#x(low) + n * wide, y: floor - tall, width: Math.max(1, wide - 1), height: tall, class: "levels-bar" });
    });
  }

  #ramp(height) {
    const [black, white] = this.#window.map((grey) => clamp(this.#x(grey), this.#x(this.#levels[0]), this.#x(this.#levels[1])));
    const [top, tall] = [height - ROOM.bottom + 5, ROOM.bottom - 9];
    const gradient = svg("linearGradient", { id: "levels-greys-ramp" });
    gradient.append(svg("stop", { offset: 0, "stop-color": "#000" }), svg("stop", { offset: 1, "stop-color": "#fff" }));
    const [left, right] = this.#levels.map((grey) => this.#x(grey));
    return [
      gradient,
      svg("rect", { x: left, y: top, width: right - left, height: tall, fill: "#000", class: "levels-edge" }),
      svg("rect", { x: white, y: top, width: Math.max(0, right - white), height: tall, fill: "#fff" }),
      svg("rect", { x: black, y: top, width: Math.max(1, white - black), height: tall, fill: "url(#levels-greys-ramp)" }),
    ];
  }

  #line() {
    const points = this.#points;
    const all = [[this.#levels[0], points[0][1]], ...points, [this.#levels[1], points.at(-1)[1]]];
    const path = all.map(([grey, opacity]) => `${this.#x(clamp(grey, ...this.#levels))},${this.#y(opacity)}`).join(" ");
    return [svg("polyline", { points: path, class: "levels-curve-ground" }), svg("polyline", { points: path, class: "levels-curve" })];
  }

  #focus(name) {
    this.#grips.get(name)?.focus({ preventScroll: true });
  }
}

// Returns the position of a new point after point `n`.
function halfway(points, n, high) {
  const [grey, opacity] = points[n];
  const [next, then] = points[n + 1] ?? [high, opacity];
  return [(grey + next) / 2, (opacity + then) / 2];
}

const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
const round = (x) => Math.round(x * 1000) / 1000;

function svg(name, attributes) {
  const made = document.createElementNS(SVG, name);
  set(made, attributes);
  return made;
}

// Sets only attributes that have changed.
function set(element, attributes) {
  for (const [key, value] of Object.entries(attributes)) if (element.getAttribute(key) !== String(value)) element.setAttribute(key, value);
}
