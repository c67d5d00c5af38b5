// Which greys of the scanner's picture are black and white on this page: as wide a range as is wanted, about as bright a middle. No pixel changes but those of the page's own canvas.
//
// For tests and for whoever debugs, as `window.sonoweave.tone`: { level, width }, the middle of the range and how many grey levels it has.

const NEUTRAL = { level: 127.5, width: 255 };
const LEVELS = [0, 255];
const WIDTHS = [4, 510];
// Grey levels a CSS pixel that is dragged, and a key.
const DRAGGED = 0.6;
const PRESSED = 8;
// As they are dragged: to the right more greys, up brighter.
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const STILL = 4;

export class Tone {
  #changed;
  #speak;
  /// As described above.
  open = { ...NEUTRAL };

  /// `changed(table, words)`: what each of 256 greys is shown as, and that in words, which are empty where nothing is changed; `speak(words)` tells those who listen.
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
    // The finger scrolls the page.
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

/// What each grey is shown as: the range's lower end black, its upper end white.
export function table({ level, width }) {
  // Casts to bytes round and end at 0 and 255.
  return Uint8ClampedArray.from({ length: 256 }, (_, grey) => 255 * ((grey - level) / width + 0.5));
}

/// Empty where greys are as the scanner shows them.
export function words({ level, width }) {
  const neutral = level === NEUTRAL.level && width === NEUTRAL.width;
  return neutral ? "" : `greys: level ${Math.round(level)}, width ${Math.round(width)}`;
}

const within = (value, [low, high]) => Math.min(high, Math.max(low, value));
