"""A probe's calibration from scans of an N-wire phantom, and its use.

    python calibrate.py PHANTOM.toml SCAN.igs.mha SECOND.igs.mha [FOLDER]

The page on calibration says how `sonoweave phantom` makes such scans without hardware.
"""

from __future__ import annotations

import pathlib
import sys

import numpy as np
import sonoweave


def main(phantom: str, scan: str, second: str, folder: str = ".") -> None:
    """Calibrate, keep the result, and reconstruct the second scan with it."""
    out = pathlib.Path(folder)
    result = sonoweave.calibrate_probe(
        scan,
        phantom,
        validate=second,
        output=out / "probe.toml",
        report=out / "probe.html",
    )
    print(f"errors: {result.error:.2f} mm, validation {result.validation_error:.2f} mm")
    print(np.array_str(result.probe_from_image, precision=3, suppress_small=True))

    sequence = sonoweave.Sequence.open(second, config=out / "probe.toml")
    reconstructor = sonoweave.Reconstructor(clip=(80, 50, 160, 180))
    ledger = reconstructor.insert_all(sequence)
    volume = reconstructor.snapshot()
    volume.write(out / "wires.mha", weights=out / "wires-weights.mha")
    print(f"{volume}, {ledger['frames']['used']} frames used")


if __name__ == "__main__":
    main(*sys.argv[1:])
