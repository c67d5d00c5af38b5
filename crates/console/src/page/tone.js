// Grey value window of the B-mode image on this page: level and width. Only the pixels of the
// page's own canvas change.
//
// For tests and debugging, as `window.sonoweave.tone`: { level, width }, the middle of the
// range and its number of grey values.

const NEUTRAL = { level: 127.5, width: 255 };
const LEVELS = [0, 255];
const WIDTHS = [4, 510];
// Grey values per dragged CSS pixel, and per key press.
const DRAGGED = 0.6;
const PRESSED = 8;
// Directions as for dragging: right widens the range, up brightens.
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STILL = 4;

export class Tone {
  #changed;
  #speak;
  /// The object described above.
  open = { ...NEUTRAL };

  /// `changed(table, words)` receives the displayed value of each of 256 grey values, and a
  /// description, empty if the window is neutral. `speak(words)` announces words to screen
  /// readers.
  constructor(canvas, changed, speak) {
    this.#changed = changed;
    this.#speak = speak;
    let from = null;
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      from = { x: event.clientX, y: event.clientY, moved: false, ...this.open };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!from) return;
      const [x, y] = [event.clientX - from.x, event.clientY - from.y];
      from.moved ||= Math.hypot(x, y) > STILL;
      if (from.moved) this.#set({ level: from.level + y * DRAGGED, width: from.width + x * DRAGGED });
    });
    canvas.addEventListener("pointerup", () => {
      if (from?.moved) this.#say();
      from = null;
    });
    // The browser took the touch for scrolling.
    canvas.addEventListener("pointercancel", () => {
      if (from) this.#set(from);
      from = null;
    });
    canvas.addEventListener("dblclick", () => this.#reset());
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey || event.shiftKey) return;
      const key = KEYS[event.key];
      if (key) {
        const [width, level] = key;
        this.#set({ level: this.open.level + level * PRESSED, width: this.open.width + width * PRESSED });
        this.#say();
      } else if (event.key === "Home") {
        this.#reset();
      } else {
        return;
      }
      event.preventDefault();
    });
  }

  #reset() {
    this.#set(NEUTRAL);
    this.#say();
  }

  #set({ level, width }) {
    this.open.level = within(level, LEVELS);
    this.open.width = within(width, WIDTHS);
    this.#changed(table(this.open), words(this.open));
  }

  #say() {
    this.#speak(words(this.open) || "greys as the scanner shows them");
  }
}

/// Returns the displayed value of each grey value: the range's lower end black, its upper end
/// white.
export function table({ level, width }) {
  // Conversion to bytes rounds, and clamps to 0 and 255.
  return Uint8ClampedArray.from({ length: 256 }, (_, grey) => 255 * ((grey - level) / width + 0.5));
}

/// Returns the window's description; empty if it is neutral.
export function words({ level, width }) {
  const neutral = level === NEUTRAL.level && width === NEUTRAL.width;
  return neutral ? "" : `greys: level ${Math.round(level)}, width ${Math.round(width)}`;
}

const within = (value, [low, high]) => Math.min(high, Math.max(low, value));
