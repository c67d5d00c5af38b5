// Pixels onto a canvas, at the screen's own pace. The buffers live as long as the picture's size does.

import { COLOUR, GREY, JPEG } from "./header.js";

const OPAQUE = 0xff000000;

export class Picture {
  #canvas;
  #context;
  #settled;
  #image = null;
  #words = null;
  // The newest that is to be drawn: a header with pixels, or with a bitmap that the browser has decoded.
  #waiting = null;
  #scheduled = false;
  // The newest that was drawn.
  #drawn = 0;
  // What each grey is shown as, and the picture that is shown: it is drawn again when that changes.
  #tone = null;
  #shown = null;
  #aside = null;
  // Counts the sessions: a picture that is decoded when its session is over is not drawn over the next one's.
  #session = 0;

  /// `settled(header, drawn, decode_ms)` is called once for every picture: drawn, or left out because a newer one was there, or because it could not be read.
  constructor(canvas, settled) {
    this.#canvas = canvas;
    this.#context = canvas.getContext("2d", { alpha: false });
    this.#settled = settled;
  }

  /// Takes a picture; it is drawn with the screen's next frame if none newer comes.
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

  /// What each of 256 greys is shown as from now on; null as it is.
  tone(table) {
    this.#tone = table;
    this.#soon();
  }

  /// Nobody looks: what waits is not drawn.
  forget() {
    if (this.#waiting) this.#leave(this.#waiting);
    this.#waiting = null;
  }

  /// A new session counts from the beginning, and is not told of the pictures of the one before.
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
    // One that comes once more without loss is newer than its JPEG.
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

  // A bitmap's greys are read from a canvas that is meant for it.
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
    // A word is alpha, blue, green, red from its highest byte on: every machine with a browser is little-endian.
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
