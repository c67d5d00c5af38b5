// Draws pixels onto a canvas at the screen's pace. Buffers are reused while the picture's size
// stays the same.

import { COLOUR, GREY, JPEG } from "./header.js";

const OPAQUE = 0xff000000;

export class Picture {
  #canvas;
  #context;
  #settled;
  #image = null;
  #words = null;
  // The newest picture to be drawn: a header with pixels, or with a bitmap decoded by the
  // browser.
  #waiting = null;
  #scheduled = false;
  // Sequence number of the newest picture drawn.
  #drawn = 0;
  // Table from grey values to displayed ones, and the displayed picture, which is redrawn when
  // the table changes.
  #tone = null;
  #shown = null;
  #aside = null;
  // Counts the sessions: a picture decoded after its session ended is not drawn over the next
  // one's.
  #session = 0;

  /// `settled(header, drawn, decode_ms)` is called once for every picture. A picture is left
  /// out if a newer one has arrived, or if it is unreadable.
  constructor(canvas, settled) {
    this.#canvas = canvas;
    this.#context = canvas.getContext("2d", { alpha: false });
    this.#settled = settled;
  }

  /// Takes a picture, and draws it with the screen's next frame unless a newer one arrives.
  async offer(header, pixels) {
    if (header.encoding !== JPEG) {
      this.#wait({ header, pixels });
      return;
    }
    const [began, session] = [performance.now(), this.#session];
    const bitmap = await createImageBitmap(new Blob([pixels], { type: "image/jpeg" })).catch(() => null);
    const decode = performance.now() - began;
    if (session !== this.#session) bitmap?.close();
    else if (bitmap) this.#wait({ header, bitmap, decode });
    else this.#settled(header, false, decode);
  }

  /// Sets the displayed value of each of 256 grey values; null shows them unchanged.
  tone(table) {
    this.#tone = table;
    this.#soon();
  }

  /// Shows a picture that the page has drawn itself, until the session's next one.
  show(canvas) {
    this.forget();
    this.#shown?.bitmap?.close();
    this.#shown = null;
    this.#paint({ header: canvas, bitmap: canvas });
    this.#canvas.classList.remove("empty");
  }

  /// Discards the waiting picture: the page is not being viewed.
  forget() {
    if (this.#waiting) this.#leave(this.#waiting);
    this.#waiting = null;
  }

  /// A new session counts from the beginning, and receives no answers for pictures of the one
  /// before.
  restart() {
    this.#waiting?.bitmap?.close();
    this.#waiting = null;
    this.#drawn = 0;
    this.#session += 1;
  }

  #wait(next) {
    const { sequence } = next.header;
    if (sequence <= this.#drawn || (this.#waiting && this.#waiting.header.sequence > sequence)) {
      this.#leave(next);
      return;
    }
    if (this.#waiting) this.#leave(this.#waiting);
    this.#waiting = next;
    if (document.visibilityState !== "visible") {
      this.forget();
    } else {
      this.#soon();
    }
  }

  #soon() {
    if (this.#scheduled) return;
    this.#scheduled = true;
    requestAnimationFrame(() => this.#draw());
  }

  #leave({ header, bitmap, decode }) {
    bitmap?.close();
    this.#settled(header, false, decode ?? 0);
  }

  #draw() {
    this.#scheduled = false;
    const next = this.#waiting;
    this.#waiting = null;
    if (!next) {
      if (this.#shown) this.#paint(this.#shown);
      return;
    }
    const { header } = next;
    const began = performance.now();
    this.#shown?.bitmap?.close();
    this.#shown = next;
    this.#paint(next);
    this.#canvas.classList.remove("empty");
    // The lossless version of a picture counts as newer than its JPEG.
    this.#drawn = header.sequence - (header.encoding === JPEG ? 0.5 : 0);
    this.#settled(header, true, (next.decode ?? 0) + performance.now() - began);
  }

  #paint({ header, pixels, bitmap }) {
    const { width, height } = header;
    if (this.#canvas.width !== width || this.#canvas.height !== height) {
      this.#canvas.width = width;
      this.#canvas.height = height;
      this.#image = null;
    }
    if (!bitmap) this.#raw(header, pixels);
    else if (this.#tone) this.#toned(bitmap, width, height);
    else this.#context.drawImage(bitmap, 0, 0, width, height);
  }

  // A separate canvas, optimised for reading, gives the bitmap's grey values.
  #toned(bitmap, width, height) {
    if (this.#aside?.canvas.width !== width || this.#aside.canvas.height !== height) {
      this.#aside = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    }
    this.#aside.drawImage(bitmap, 0, 0, width, height);
    const image = this.#aside.getImageData(0, 0, width, height);
    const bytes = image.data;
    for (let n = 0; n < bytes.length; n += 4) bytes[n] = bytes[n + 1] = bytes[n + 2] = this.#tone[bytes[n]];
    this.#context.putImageData(image, 0, 0);
  }

  #raw({ encoding, width, height }, pixels) {
    if (!this.#image) {
      this.#image = this.#context.createImageData(width, height);
      this.#words = new Uint32Array(this.#image.data.buffer);
    }
    // A word is alpha, blue, green, red from its highest byte on: all platforms with browsers
    // are little-endian.
    const words = this.#words;
    if (encoding === GREY) {
      const tone = this.#tone;
      for (let n = 0; n < words.length; n += 1) words[n] = OPAQUE | ((tone ? tone[pixels[n]] : pixels[n]) * 0x010101);
    } else if (encoding === COLOUR) {
      for (let n = 0, from = 0; n < words.length; n += 1, from += 3) {
        words[n] = OPAQUE | (pixels[from + 2] << 16) | (pixels[from + 1] << 8) | pixels[from];
      }
    }
    this.#context.putImageData(this.#image, 0, 0);
  }
}
