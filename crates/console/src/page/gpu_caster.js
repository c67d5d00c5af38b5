// The volume on the graphics processor: its voxels as they came, their light, and rays through it.
// Textures are dense; a box of bricks around those that hold anything.

import { BYTES, EDGE, keyOf } from "./bricks.js";
import { camera } from "./orbit.js";
import { add, dot, minus, times, unit } from "./space.js";

// Longest side, voxels, and largest memory of the textures, bytes.
const MOST_SIDE = 512;
const MOST_BYTES = 192 * 2 ** 20;
// Sides of a new texture, over those of the box: a growing volume seldom needs another one.
const GROWTH = 1.5;

// Modes of voxels, and of rays.
const LIT = 0;
const UNLIT = 1;
const VALUES = 2;
const MODES = { shaded: [LIT, 0], opacity: [UNLIT, 0], mip: [VALUES, 1], average: [VALUES, 2] };
const FACES = [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
const NEXT = [0, 1, 2, 3, 4, 5, 6, 7].map((n) => [n & 1, (n >> 1) & 1, n >> 2]);

/// Bytes of textures of so many bricks: voxels, their light, and a byte a brick.
const bytesOf = (bricks, grey) => bricks * (EDGE ** 3 * (4 + (grey ? 4 : 8)) + 1);

export class Caster {
  #gpu;
  #store;
  #drawing = null;
  // First brick of the textures, and their bricks along each axis; null without textures.
  #first = null;
  #size = null;
  #grey = true;
  // Number of visible high bytes up to each.
  #seen = null;
  #instances;
  // The light depends on this view; null if voxels are unlit yet.
  #litFor = null;
  /// Bricks lit, and pictures cast.
  work = { bricks: 0, pictures: 0, textures: 0 };

  constructor(gpu, store) {
    this.#gpu = gpu;
    this.#store = store;
    this.#instances = gpu.gl.createBuffer();
  }

  /// Receives the settings of the session's picture.
  settings(drawing) {
    const { opacities, colours, gradient } = drawing;
    this.#drawing = drawing;
    this.#gpu.row("table", colours.flatMap((colour, n) => [...colour, opacities[n]]), 4);
    this.#gpu.row("slopes", (gradient ?? [[0, 1]]).flat(), 2);
    const lit = MODES[drawing.mode][0] !== VALUES;
    let sum = 0;
    this.#seen = [0, ...opacities.map((opacity) => (sum += lit && opacity <= 0 ? 0 : 1))];
    this.#litFor = null;
  }

  /// Forgets the volume: the session begins to send it anew.
  reset() {
    this.#first = null;
  }

  /// Brings the textures up to the store's bricks. Throws a sentence if they are too large.
  update() {
    const store = this.#store;
    const box = store.box();
    if (!box || !this.#drawing) return;
    if (this.#fit(box)) {
      store.takeChanged();
      this.#upload([...store.bricks.values()].map(({ at }) => at));
      this.#litFor = null;
    } else if (store.isChanged) {
      const changed = store.takeChanged().filter((at) => this.#holds(at));
      this.#upload(changed);
      // A gradient reads the six voxels beside its own.
      if (this.#litFor) this.#light(this.#beside(changed, FACES), this.#litFor);
    }
  }

  /// Draws the picture of a view into the canvas. Returns its camera, or null without a volume.
  draw(view) {
    const { gl } = this.#gpu;
    const drawing = this.#drawing;
    const { size, background, stop, arity, window } = drawing;
    const of = camera(drawing, view);
    if (gl.canvas.width !== size[0] || gl.canvas.height !== size[1]) [gl.canvas.width, gl.canvas.height] = size;
    this.work.pictures += 1;
    if (!this.#first) {
      this.#gpu.into(null, 0, size);
      gl.clearColor(...background, 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
      return of;
    }
    this.#relight(view, of);
    const map = of.region_from_world;
    this.#gpu.into(null, 0, size);
    this.#gpu.use(this.#gpu.rays, {
      perspective: of.perspective,
      origin: add(of.origin, this.#offset()),
      right: of.right,
      down: of.down,
      ahead: of.ahead,
      region_from_world: map.slice(0, 9),
      near_mm: of.near_mm,
      step_mm: of.step_mm,
      samples: of.samples,
      arity,
      stop,
      top: (drawing.top - window[0]) / (window[1] - window[0]),
      mode: MODES[drawing.mode][1],
      grey: this.#grey,
      height: size[1],
      background,
    });
    gl.disableVertexAttribArray(0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    return of;
  }

  /// Waits until all is drawn.
  finish() {
    const { gl } = this.#gpu;
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  /// Returns the voxels of a brick as the texture has them, for tests.
  read(at) {
    const { gl } = this.#gpu;
    const bytes = new Uint8Array(4 * EDGE ** 2);
    const voxels = [];
    const from = times(minus(at, this.#first), EDGE);
    for (let layer = 0; layer < EDGE; layer += 1) {
      this.#gpu.into("voxels", from[2] + layer, [EDGE, EDGE]);
      gl.readPixels(from[0], from[1], EDGE, EDGE, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
      voxels.push(...bytes);
    }
    return voxels;
  }

  // Voxels from region coordinate 0 to the texture's first.
  #offset() {
    return minus(this.#drawing.first, times(this.#first, EDGE));
  }

  #holds(at) {
    return at.every((index, axis) => index >= this.#first[axis] && index < this.#first[axis] + this.#size[axis]);
  }

  // Returns the bricks at these places from some, each once.
  #beside(bricks, places) {
    const all = new Map();
    for (const at of bricks) for (const by of places) all.set(keyOf(add(at, by)), add(at, by));
    return [...all.values()].filter((at) => this.#holds(at));
  }

  // Makes textures that hold a box; returns whether they are new.
  #fit([first, end]) {
    const { gl } = this.#gpu;
    const { grey } = this.#drawing;
    const fits = this.#first && this.#grey === grey && this.#holds(first) && this.#holds(end.map((index) => index - 1));
    if (fits) return false;
    const side = Math.min(gl.getParameter(gl.MAX_3D_TEXTURE_SIZE), MOST_SIDE) / EDGE;
    const bricks = minus(end, first);
    const isPossible = (size) => size.every((n) => n <= side) && bytesOf(size.reduce((a, b) => a * b), grey) <= MOST_BYTES;
    if (!isPossible(bricks)) throw new Error("the volume is too large for this page");
    const grown = bricks.map((n) => Math.min(side, Math.ceil(n * GROWTH)));
    const size = isPossible(grown) ? grown : bricks;
    const half = minus(size, bricks).map((n) => Math.floor(n / 2));
    const voxels = times(size, EDGE);
    this.#gpu.volume("voxels", gl.RGBA8, voxels);
    this.#gpu.volume("lit", grey ? gl.RG16F : gl.RGBA16F, voxels, true);
    this.#gpu.volume("visible", gl.R8, size);
    this.work.textures += 1;
    if (gl.getError() === gl.OUT_OF_MEMORY) {
      this.#first = null;
      throw new Error("this page has no graphics memory for the volume");
    }
    [this.#first, this.#size, this.#grey] = [minus(first, half), size, grey];
    return true;
  }

  #upload(bricks) {
    const { gl } = this.#gpu;
    const empty = new Uint8Array(BYTES);
    for (const at of bricks) {
      const voxels = this.#store.get(at)?.voxels ?? empty;
      this.#gpu.write("voxels", times(minus(at, this.#first), EDGE), [EDGE, EDGE, EDGE], gl.RGBA, voxels);
    }
    this.#mark(bricks);
  }

  // Notes for changed bricks in which bricks a sample may be anything but transparent. Cells of the
  // seven bricks before one end in its first voxels.
  #mark(bricks) {
    const { gl } = this.#gpu;
    for (const at of this.#beside(bricks, NEXT.map((next) => times(next, -1)))) {
      const visible = NEXT.some((next) => this.#shows(add(at, next)));
      this.#gpu.write("visible", minus(at, this.#first), [1, 1, 1], gl.RED, Uint8Array.of(visible ? 255 : 0));
    }
  }

  // Returns whether a voxel of a brick may be visible.
  #shows(at) {
    const brick = this.#store.get(at);
    return brick !== undefined && this.#seen[Math.min(256, brick.high + 2)] > this.#seen[brick.low];
  }

  // Lights all bricks again if the light of the view is another.
  #relight(view, of) {
    const { light, mode } = this.#drawing;
    const { specular, diffuse } = light.parts;
    const turns = MODES[mode][0] === LIT && (specular > 0 || light.depth_cue || (diffuse > 0 && !light.towards));
    const before = this.#litFor;
    const isOther = !before || before.radius !== of.radius || (turns && before.forward.some((x, axis) => x !== of.forward[axis]));
    if (!isOther) return;
    const bricks = [...this.#store.bricks.values()].map(({ at }) => at);
    if (before) {
      this.#light(bricks.filter((at) => this.#shows(at)), of);
    } else {
      // Other settings: bricks may have become visible, or transparent.
      this.#mark(bricks);
      this.#light(bricks, of);
    }
    this.#litFor = of;
  }

  #light(bricks, of) {
    const { gl } = this.#gpu;
    const drawing = this.#drawing;
    const { light, window, world_from_region: map } = drawing;
    const { ambient, diffuse, specular, shininess } = light.parts;
    const columns = [0, 3, 6].map((at) => map.slice(at, at + 3));
    const pitch = columns.map((column) => Math.hypot(...column));
    const along = (direction) => columns.map((column, axis) => dot(column, direction) / pitch[axis]);
    const eye = times(of.forward, -1);
    const towards = light.towards ?? eye;
    const between = add(towards, eye);
    const halfway = !light.towards ? eye : Math.hypot(...between) > 0 ? unit(between) : [0, 0, 0];
    // Depth of a position: 0.5 in the middle of the region, 0 and 1 at its ends.
    const rise = columns.map((column) => (0.5 * dot(column, of.forward)) / of.radius);
    const start = 0.5 + (0.5 * dot(minus(map.slice(9, 12), of.middle), of.forward)) / of.radius;
    this.#gpu.use(this.#gpu.light, {
      mode: MODES[drawing.mode][0],
      grey: this.#grey,
      window,
      pitch,
      unit_mm: drawing.unit_mm,
      step_mm: of.step_mm,
      border_mm: drawing.border_mm,
      parts: [ambient, diffuse, specular, shininess],
      two_sided: light.two_sided,
      to_light: along(towards),
      halfway: along(halfway),
      depth: [...rise, start - dot(rise, this.#offset())],
      cue: light.depth_cue ? [light.depth_cue.near, light.depth_cue.far] : [0, 0],
      bricks: this.#size.slice(0, 2),
    });
    // Bricks by their layer of bricks.
    const layers = new Map();
    for (const at of bricks) {
      const [x, y, z] = minus(at, this.#first);
      if (!layers.has(z)) layers.set(z, []);
      layers.get(z).push(x, y);
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#instances);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribDivisor(0, 1);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    const layer = this.#gpu.light.uniforms.layer.place;
    for (const [z, places] of layers) {
      gl.bufferData(gl.ARRAY_BUFFER, Float32Array.from(places), gl.STREAM_DRAW);
      for (let n = z * EDGE; n < (z + 1) * EDGE; n += 1) {
        this.#gpu.into("lit", n, times(this.#size, EDGE));
        gl.uniform1i(layer, n);
        gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, places.length / 2);
      }
    }
    this.work.bricks += bricks.length;
  }
}
