// The view of the volume: what hand and keys wish goes to the session, at most once a frame of the screen, and what the session says of the view is shown on it.

import { fit, place } from "./fit.js";
import { hand } from "./hand.js";
import { keys } from "./keys.js";

export class View {
  #room;
  #canvas;
  #onlooker;
  #refined;
  #marks;
  #sight;
  #buttons;
  #send;
  #steers = false;
  #aspect = 1;
  #turn = { right: 0, up: 0, clockwise: 0 };
  #zoom = 0;
  #scheduled = false;
  /// Called with shares of the picture's width and height when somebody has clicked on it; whether that is what a click is for now.
  clicked = () => false;

  /// `send(wish)` brings it to the session.
  constructor({ panel, room, canvas, onlooker, control, refined, marks, sight }, send) {
    this.#room = room;
    this.#canvas = canvas;
    this.#onlooker = onlooker;
    this.#refined = refined;
    this.#marks = marks;
    this.#sight = sight;
    this.#send = send;
    new ResizeObserver(() => this.#lay()).observe(room);
    hand(canvas, this);
    keys(panel, this);
    this.#buttons = panel.querySelectorAll("[data-look], [data-zoom], [data-roll]");
    for (const button of this.#buttons) button.addEventListener("click", () => this.#pressed(button.dataset));
    this.control(null);
    control.addEventListener("click", () => {
      send({ do: "control" });
      canvas.focus();
    });
  }

  /// Whether this page steers: true, false, or null while that is not known.
  control(steers) {
    this.#steers = steers === true;
    this.#onlooker.hidden = steers !== false;
    this.#canvas.classList.toggle("steered", this.#steers);
    for (const button of this.#buttons) button.disabled = !this.#steers;
  }

  /// A picture was drawn.
  drawn({ width, height, refining }) {
    this.#sight.drawn({ width, height });
    this.#refined.hidden = !refining;
    if (this.#aspect === width / height) return;
    this.#aspect = width / height;
    this.#lay();
  }

  turn(right, up, clockwise) {
    this.#turn.right += right;
    this.#turn.up += up;
    this.#turn.clockwise += clockwise;
    this.#soon();
  }

  zoom(doublings) {
    this.#zoom += doublings;
    this.#soon();
  }

  /// A tap, or the second one of two.
  tap(x, y, twice) {
    const taken = twice ? this.#taken : this.clicked(x, y);
    if (twice && !taken) this.centre(x, y);
    this.#taken = taken;
  }

  #taken = false;

  centre(x, y) {
    this.#now({ do: "centre", at: [round(x), round(y)] });
  }

  look(from) {
    this.#now({ do: "look", from });
  }

  #pressed({ look, zoom, roll }) {
    if (look) this.look(look);
    if (zoom) this.zoom(Number(zoom));
    if (roll) this.turn(0, 0, Number(roll));
  }

  #lay() {
    const at = fit(this.#room, this.#aspect);
    place(this.#canvas, at);
    this.#marks.place(at);
    this.#sight.place(at);
  }

  #soon() {
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => this.#flush());
  }

  #flush() {
    this.#scheduled = false;
    const { right, up, clockwise } = this.#turn;
    const zoom = this.#zoom;
    this.#turn = { right: 0, up: 0, clockwise: 0 };
    this.#zoom = 0;
    if (!this.#steers) return;
    if (right !== 0 || up !== 0 || clockwise !== 0) {
      this.#send({ do: "turn", right: round(right), up: round(up), clockwise: round(clockwise) });
    }
    if (zoom !== 0) this.#send({ do: "zoom", by: round(zoom) });
  }

  // In the order in which it was wished.
  #now(wish) {
    this.#flush();
    if (this.#steers) this.#send(wish);
  }
}

// Finer than any hand.
function round(value) {
  return Math.round(value * 1e4) / 1e4;
}
