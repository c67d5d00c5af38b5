// Bricks of the volume, 8³ voxels each: the messages in which they come, and the page's store of
// them.

export const EDGE = 8;
const VOXELS = EDGE ** 3;
// Bytes of a record before its voxels, and of a brick's voxels: two of each value and weight.
const RECORD = 10;
export const BYTES = 4 * VOXELS;

/// Returns the bricks of a message, without copying them: [{ at, low, high, voxels }]. `at` are a
/// brick's indices, `low` and `high` the high bytes of its smallest and largest value. Without any
/// seen voxel, `voxels` is null. `box` is [first, end] in bricks, the end exclusive. Throws a
/// sentence if a record is cut off or lies outside of the box: then none of the message counts.
export function parseBricks(bytes, count, [first, end]) {
  const of = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const bricks = [];
  let from = 0;
  for (let n = 0; n < count; n += 1) {
    if (from + RECORD > bytes.length) throw new Error(`bricks are cut off after ${n} of ${count}`);
    const at = [0, 2, 4].map((axis) => of.getInt16(from + axis, true));
    if (at.some((index, axis) => index < first[axis] || index >= end[axis])) throw new Error(`a brick at ${at}, outside of the volume`);
    const empty = bytes[from + 6];
    if (empty > 1) throw new Error(`a brick of kind ${empty}, which this page does not know`);
    const [low, high] = [bytes[from + 7], bytes[from + 8]];
    from += RECORD;
    if (empty === 0 && from + BYTES > bytes.length) throw new Error(`bricks are cut off after ${n} of ${count}`);
    bricks.push({ at, low, high, voxels: empty === 1 ? null : bytes.subarray(from, from + BYTES) });
    if (empty === 0) from += BYTES;
  }
  if (from !== bytes.length) throw new Error(`${bytes.length - from} bytes follow the last brick`);
  return bricks;
}

/// Returns a number for a brick's indices.
export const keyOf = ([x, y, z]) => ((x + 32768) * 65536 + y + 32768) * 65536 + z + 32768;

/// The bricks that the page has.
export class BrickStore {
  /// By key: { at, low, high, voxels }.
  bricks = new Map();
  // First and last brick so far; null without any.
  #bounds = null;
  #changed = new Map();

  /// Takes the bricks of a message.
  take(bricks) {
    for (const { at, low, high, voxels } of bricks) {
      const key = keyOf(at);
      this.#changed.set(key, at);
      if (voxels === null) {
        this.bricks.delete(key);
        continue;
      }
      // The message's memory is not kept.
      this.bricks.set(key, { at, low, high, voxels: voxels.slice() });
      this.#widen(at);
    }
  }

  /// Keeps only bricks in a box, as the session does.
  keep([first, end]) {
    this.#bounds = null;
    for (const [key, { at }] of this.bricks) {
      if (at.every((index, axis) => index >= first[axis] && index < end[axis])) {
        this.#widen(at);
      } else {
        this.bricks.delete(key);
        this.#changed.set(key, at);
      }
    }
  }

  #widen(at) {
    this.#bounds ??= [at.slice(), at.slice()];
    at.forEach((index, axis) => {
      this.#bounds[0][axis] = Math.min(this.#bounds[0][axis], index);
      this.#bounds[1][axis] = Math.max(this.#bounds[1][axis], index);
    });
  }

  clear() {
    this.bricks.clear();
    this.#changed.clear();
    this.#bounds = null;
  }

  /// Returns the box of its bricks and one more on each side, [first, end]; null without any.
  box() {
    return this.#bounds && [this.#bounds[0].map((index) => index - 1), this.#bounds[1].map((index) => index + 2)];
  }

  get(at) {
    return this.bricks.get(keyOf(at));
  }

  /// Whether any brick has changed since the last query.
  get isChanged() {
    return this.#changed.size > 0;
  }

  /// Returns the bricks that have changed since the last query; their indices.
  takeChanged() {
    const changed = [...this.#changed.values()];
    this.#changed.clear();
    return changed;
  }
}
