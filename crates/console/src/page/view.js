// The view of the volume: sends pointer and key commands to the session, at most once per frame
// of the screen, and shows what the session reports about the view.

import { fit, place } from "./fit.js";
import { hand } from "./hand.js";
import { keys } from "./keys.js";

export class View {
  #room;
  #canvas;
  #onlooker;
  #refined;
  #marks;
  #figures;
  #buttons;
  #send;
  #steers = false;
  #aspect = 1;
  #turn = { right: 0, up: 0, clockwise: 0 };
  #zoom = 0;
  #scheduled = false;
  /// Called with fractions of the picture's width and height after a click. Returns whether it
  /// used the click.
  clicked = () => false;

  /// `send(message)` sends a command to the session.
  constructor({ panel, room, canvas, onlooker, control, refined, marks, figures }, send) {
    this.#room = room;
    this.#canvas = canvas;
    this.#onlooker = onlooker;
    this.#refined = refined;
    this.#marks = marks;
    this.#figures = figures;
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

  /// Sets whether this page has control: true, false, or null while unknown.
  control(steers) {
    this.#steers = steers === true;
    this.#onlooker.hidden = steers !== false;
    this.#canvas.classList.toggle("steered", this.#steers);
    for (const button of this.#buttons) button.disabled = !this.#steers;
  }

  /// Called after a picture was drawn.
  drawn({ width, height, refining }) {
    this.#figures.drawn({ width, height });
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

  /// Handles a tap, or the second one of a double tap.
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
    this.#figures.place(at);
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

  // Sends waiting turns first, to keep the order of commands.
  #now(message) {
    this.#flush();
    if (this.#steers) this.#send(message);
  }
}

// Rounds to a step finer than any user's movement.
function round(value) {
  return Math.round(value * 1e4) / 1e4;
}
