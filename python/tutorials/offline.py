"""A recorded sweep to a volume, its files, pictures and plots.

    python offline.py SWEEP.igs.mha [FOLDER] [CONFIG]

`sonoweave phantom -o sweep.igs.mha --trajectory freehand` makes a sweep without hardware.
"""

from __future__ import annotations

import pathlib
import sys

import matplotlib

matplotlib.use("agg")

import matplotlib.image
import numpy as np
import sonoweave
from sonoweave.plotting import plot


def main(sweep: str, folder: str = ".", config: str | None = None) -> None:
    """Reconstruct, write, render and plot."""
    out = pathlib.Path(folder)
    sequence = sonoweave.Sequence.open(sweep, config=config)
    print(f"{len(sequence)} frames in {sequence.world}, by {sequence.route}")

    reconstructor = sonoweave.Reconstructor(spacing=0.5)
    ledger = reconstructor.insert_all(
        sequence, progress=lambda done, total: print(f"{done} of {total}")
    )
    print(f"used {ledger['frames']['used']}, refused {ledger['frames']['refused']}")

    volume = reconstructor.snapshot()
    print(f"{volume}, mean of seen voxels {volume.values()[volume.weights() > 0].mean():.1f}")
    volume.write(out / "volume.mha", weights=out / "weights.mha")
    volume.write(out / "volume.ome.zarr")

    again = sonoweave.Volume.open(out / "volume.ome.zarr")
    low = np.rint((np.array(volume.origin) - again.origin) / volume.spacing).astype(int)[::-1]
    box = tuple(slice(at, at + n) for at, n in zip(low, volume.shape, strict=True))
    difference = np.abs(np.rint(volume.values()) - again[box]).max()
    print(f"largest difference of the 8-bit file to the rounded volume: {difference:.0f}")

    matplotlib.image.imsave(
        out / "view.png", sonoweave.render(volume, mode="shaded", size=(512, 512))
    )
    matplotlib.image.imsave(out / "planes.png", sonoweave.section(volume))
    plot(sequence, volume).savefig(out / "plot.png")


if __name__ == "__main__":
    main(*sys.argv[1:])
