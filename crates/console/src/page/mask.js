// The mask: which part of the scanner's picture is data. Its outline lies on the live picture, and
// a card says what was found and how sure that is. The page with control confirms it, takes the
// whole frame, or moves its edges by handles.

import { write } from "./account.js";
import { apart, first, handles, kind, moved, outline } from "./mask_shape.js";

const SVG = "http://www.w3.org/2000/svg";
const ORIGINS = {
  configured: "by the settings",
  found: "found in the first frames; please confirm",
  confirmed: "confirmed",
  operator: "chosen by hand",
};
// Radius of a handle, CSS pixels.
const RADIUS = 10;
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class MaskCard {
  #of;
  #send;
  #mask = null;
  #steers = false;
  #runs = false;
  // The shape being changed; null if none is.
  #draft = null;
  #held = null;
  /// For tests.
  open = { mask: null, draft: null };

  /// `of(id)` returns the element of that id, `send(message)` sends a command to the session.
  constructor(of, send) {
    this.#of = of;
    this.#send = send;
    of("mask-confirm").addEventListener("click", () => this.#order("keep"));
    of("mask-whole").addEventListener("click", () => this.#order("whole"));
    of("mask-adjust").addEventListener("click", () => this.#change(this.#draft ? null : this.#begin()));
    of("mask-use").addEventListener("click", () => this.#order(this.#draft));
    of("mask-kind").addEventListener("change", ({ target }) => this.#change(first(target.value, this.#mask.size_px)));
    const svg = of("mask-outline");
    svg.addEventListener("pointerdown", (event) => this.#grasp(event));
    svg.addEventListener("pointermove", (event) => this.#drag(event));
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => (this.#held = null));
    svg.addEventListener("keydown", (event) => this.#step(event));
    const follows = new ResizeObserver(() => this.#draw());
    follows.observe(of("slice"));
    follows.observe(of("slice-room"));
  }

  /// Receives the session's mask and its controller's status; null while the connection is lost.
  update(mask, desk) {
    const changed = JSON.stringify(mask ?? null) !== JSON.stringify(this.#mask);
    const runs = desk?.phase === "running" && !desk.replayed;
    if (!changed && runs === this.#runs) return;
    this.#mask = mask ?? null;
    this.#runs = runs;
    this.open.mask = this.#mask;
    if (!this.#mask) this.#draft = null;
    this.#show();
  }

  /// Sets whether this page has control.
  control(steers) {
    this.#steers = steers === true;
    this.#show();
  }

  #begin() {
    return kind(this.#mask.shape) ? structuredClone({ [kind(this.#mask.shape)]: this.#mask.shape[kind(this.#mask.shape)] }) : first("rectangle", this.#mask.size_px);
  }

  #order(change) {
    this.#send({ do: "mask", as: change });
    this.#change(null);
  }

  #change(draft) {
    this.#draft = draft;
    this.open.draft = draft;
    this.#show();
  }

  #show() {
    const mask = this.#mask;
    const may = mask !== null && this.#steers && this.#runs;
    if (!may) this.#draft = null;
    this.#of("mask-card").hidden = mask === null;
    this.#of("mask-place").classList.toggle("adjusts", this.#draft !== null);
    this.#of("mask-outline").toggleAttribute("hidden", mask === null);
    if (mask === null) return this.#draw();
    write(this.#of("mask-vital"), `Mask: ${ORIGINS[mask.origin]}`);
    write(this.#of("mask-says"), mask.says);
    write(this.#of("mask-config"), mask.config ?? "");
    this.#of("mask-keys").hidden = mask.config === null;
    this.#of("mask-card").dataset.how = mask.origin === "found" ? "heed" : "well";
    for (const id of ["mask-confirm", "mask-whole", "mask-adjust"]) this.#of(id).disabled = !may;
    this.#of("mask-confirm").hidden = mask.origin !== "found" || this.#draft !== null;
    this.#of("mask-adjust").setAttribute("aria-pressed", String(this.#draft !== null));
    this.#of("mask-edit").hidden = this.#draft === null;
    if (this.#draft) this.#of("mask-kind").value = kind(this.#draft);
    this.#draw();
  }

  // The place of the picture on the page, and CSS pixels per pixel of the frame.
  #layout() {
    const canvas = this.#of("slice");
    const [width, height] = this.#mask.size_px;
    const scale = [canvas.offsetWidth / width, canvas.offsetHeight / height];
    return { left: canvas.offsetLeft, top: canvas.offsetTop, scale, size: [canvas.offsetWidth, canvas.offsetHeight] };
  }

  #draw() {
    const svg = this.#of("mask-outline");
    const focused = document.activeElement?.dataset?.handle;
    svg.replaceChildren();
    if (!this.#mask) return;
    const { left, top, scale, size } = this.#layout();
    Object.assign(svg.style, { left: `${left}px`, top: `${top}px`, width: `${size[0]}px`, height: `${size[1]}px` });
    svg.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
    const onPage = ([u, v]) => [(u + 0.5) * scale[0], (v + 0.5) * scale[1]];
    const points = outline(this.#draft ?? this.#mask.shape).map(onPage);
    if (points.length > 0) this.#element("polygon", { points: points.map((point) => point.map((x) => x.toFixed(1)).join(",")).join(" "), class: this.#draft ? "draft" : "" });
    const grips = this.#draft ? handles(this.#draft) : [];
    const places = apart(grips.map(({ at }) => onPage(at)), size, RADIUS);
    for (const [n, { name, label, value }] of grips.entries()) {
      const [x, y] = places[n];
      const circle = this.#element("circle", { cx: x.toFixed(1), cy: y.toFixed(1), r: RADIUS, tabindex: 0, role: "slider", "aria-label": label, "aria-valuenow": value, "data-handle": name });
      if (name === focused) circle.focus();
    }
  }

  #element(name, attributes) {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    this.#of("mask-outline").append(element);
    return element;
  }

  #grasp(event) {
    const name = event.target.dataset?.handle;
    if (!name || !this.#draft) return;
    event.preventDefault();
    event.target.focus();
    this.#of("mask-outline").setPointerCapture(event.pointerId);
    this.#held = { name, from: [event.clientX, event.clientY], shape: this.#draft };
  }

  #drag(event) {
    if (!this.#held || !this.#draft) return;
    const { name, from, shape } = this.#held;
    const { scale } = this.#layout();
    const by = [(event.clientX - from[0]) / scale[0], (event.clientY - from[1]) / scale[1]];
    this.#change(moved(shape, name, by, this.#mask.size_px));
  }

  #step(event) {
    const name = event.target.dataset?.handle;
    const step = STEPS[event.key];
    if (!name || !step || !this.#draft) return;
    event.preventDefault();
    const by = step.map((pixels) => pixels * (event.shiftKey ? 10 : 1));
    this.#change(moved(this.#draft, name, by, this.#mask.size_px));
  }
}
