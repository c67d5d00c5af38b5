// The 40 bytes before each picture, little-endian: kind, encoding, flags, width, height,
// sequence, captured, sent, frame.

const LENGTH = 40;
// No scanner's frame is wider; a larger number is invalid.
const WIDEST = 8192;

export const SLICE = 1;
export const VIEW = 2;
// Planes through the volume are kinds 3 to 6.
const LAST = 6;
/// Bricks of the volume; instead of a size, the header has the number of bricks, and how many the
/// page never had and still waits for.
export const BRICKS = 7;
export const GREY = 0;
export const COLOUR = 1;
export const JPEG = 2;

const REFINING = 1;
const TIMELESS = 2;

/// Returns the header, and the pixels as bytes of the same buffer. Throws a sentence if it is
/// invalid.
export function parse(buffer) {
  if (buffer.byteLength < LENGTH) throw new Error(`a picture of ${buffer.byteLength} bytes has no header of ${LENGTH}`);
  const of = new DataView(buffer);
  const flags = of.getUint16(2, true);
  const header = {
    kind: of.getUint8(0),
    encoding: of.getUint8(1),
    refining: (flags & REFINING) !== 0,
    timed: (flags & TIMELESS) === 0,
    width: of.getUint32(4, true),
    height: of.getUint32(8, true),
    sequence: of.getUint32(12, true),
    captured: of.getFloat64(16, true),
    sent: of.getFloat64(24, true),
    frame: Number(of.getBigUint64(32, true)),
  };
  const { kind, encoding, width, height } = header;
  if (kind === BRICKS) return { header, pixels: new Uint8Array(buffer, LENGTH) };
  if (kind < SLICE || kind > LAST) throw new Error(`a picture of kind ${kind}, which this page does not know`);
  if (width < 1 || height < 1 || width > WIDEST || height > WIDEST) throw new Error(`a picture of ${width} × ${height} pixels`);
  const pixels = new Uint8Array(buffer, LENGTH);
  const each = { [GREY]: 1, [COLOUR]: 3 }[encoding];
  if (each === undefined && encoding !== JPEG) throw new Error(`a picture in encoding ${encoding}, which this page does not know`);
  if (each !== undefined && pixels.length !== width * height * each) {
    throw new Error(`a picture of ${width} × ${height} pixels with ${pixels.length} bytes instead of ${width * height * each}`);
  }
  return { header, pixels };
}
