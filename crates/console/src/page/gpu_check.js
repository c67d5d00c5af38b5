// The check of the page's own drawing on the user's machine, by `?gpu-check` in the address: its
// times, and its difference from the session's picture of the same view.

// Interval of the check, ms.
const OFTEN = 3000;

/// Returns the difference of two pictures' colours, of 255: root mean square, the largest, and the
/// largest of all but a thousandth.
export function difference(a, b) {
  if (a.width !== b.width || a.height !== b.height) throw new Error(`pictures of ${a.width} × ${a.height} and ${b.width} × ${b.height} pixels`);
  const off = [];
  for (let n = 0; n < a.data.length; n += 1) if (n % 4 < 3) off.push(Math.abs(a.data[n] - b.data[n]));
  off.sort((x, y) => x - y);
  const rms = Math.sqrt(off.reduce((sum, x) => sum + x * x, 0) / off.length);
  return { rms, most: off.at(-1), usual: off[Math.ceil(0.999 * off.length) - 1] };
}

/// Returns the session's picture of the volume.
export async function sessionPixels() {
  const bitmap = await createImageBitmap(await (await fetch("/v1/pictures/view.png")).blob());
  const { width, height } = bitmap;
  const to = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  to.drawImage(bitmap, 0, 0);
  return { width, height, data: to.getImageData(0, 0, width, height).data };
}

/// Checks repeatedly, and writes the result into an element.
export function check(open, output) {
  output.hidden = false;
  const once = async () => {
    if (!open.here) {
      output.textContent = `drawn by the session: ${open.why}`;
      return;
    }
    const [still, turned] = [false, true].map((turns) => open.view.time(turns).toFixed(1));
    const { rms, usual, most } = difference(open.view.pixels(), await sessionPixels());
    const { bricks, work } = open;
    output.textContent = `a picture takes ${still} ms, a turned one ${turned} ms; ${bricks} bricks in ${work.textures} textures; difference from the session's picture, of 255: rms ${rms.toFixed(2)}, 99.9 % within ${usual}, largest ${most}`;
  };
  setInterval(() => once().catch((error) => (output.textContent = error.message)), OFTEN);
}
