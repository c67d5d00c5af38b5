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
    } else if (!this.#scheduled) {
      this.#scheduled = true;
      requestAnimationFrame(() => this.#draw());
    }
  }

  #leave({ header, bitmap, decode }) {
    bitmap?.close();
    this.#settled(header, false, decode ?? 0);
  }

  #draw() {
    this.#scheduled = false;
    const next = this.#waiting;
    if (!next) return;
    this.#waiting = null;
    const { header, pixels, bitmap } = next;
    const began = performance.now();
    const { width, height } = header;
    if (this.#canvas.width !== width || this.#canvas.height !== height) {
      this.#canvas.width = width;
      this.#canvas.height = height;
      this.#image = null;
    }
    if (bitmap) {
      this.#context.drawImage(bitmap, 0, 0, width, height);
      bitmap.close();
    } else {
      this.#raw(header, pixels);
    }
    this.#canvas.classList.remove("empty");
    this.#drawn = header.sequence;
    this.#settled(header, true, (next.decode ?? 0) + performance.now() - began);
  }

  #raw({ encoding, width, height }, pixels) {
    if (!this.#image) {
      this.#image = this.#context.createImageData(width, height);
      this.#words = new Uint32Array(this.#image.data.buffer);
    }
    // A word is alpha, blue, green, red from its highest byte on: every machine with a browser is little-endian.
    const words = this.#words;
    if (encoding === GREY) {
      for (let n = 0; n < words.length; n += 1) words[n] = OPAQUE | (pixels[n] * 0x010101);
    } else if (encoding === COLOUR) {
      for (let n = 0, from = 0; n < words.length; n += 1, from += 3) {
        words[n] = OPAQUE | (pixels[from + 2] << 16) | (pixels[from + 1] << 8) | pixels[from];
      }
    }
    this.#context.putImageData(this.#image, 0, 0);
  }
}
