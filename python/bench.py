"""Times of the package: `make python-bench`, on a calm machine.

    python bench.py PROGRAM [ROUNDS]

Each round times everything once, so that a busy moment meets all. Medians of the rounds are
printed with their smallest and largest, and each result is compared with another way to it.
"""

from __future__ import annotations

import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from sonoweave import Reconstructor, Sequence, Volume

#: Frames of single inserts, and their size: height and width, pixels.
FRAMES, SIZE = 120, (616, 820)


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the time of some work, ms, and its result."""
    began = time.perf_counter()
    result = work()
    return (time.perf_counter() - began) * 1e3, result


def single(folder: pathlib.Path) -> dict[str, float]:
    """Time inserts of single frames, and what each costs beside the insertion itself."""
    frames = np.random.default_rng(1).integers(0, 255, (8, *SIZE), np.uint8)
    poses = np.tile(np.diag([0.1, 0.1, 0.1, 1.0]), (FRAMES, 1, 1))
    poses[:, 2, 3] = np.arange(FRAMES) * 0.5
    loop = Reconstructor(clip="none", path="general", threads=1)
    calls = []
    for at in range(FRAMES):
        frame = frames[at % 8]
        calls.append(timed(lambda: loop.insert(frame, poses[at], time=at / 30))[0])
    stack = frames[np.arange(FRAMES) % 8]
    whole = Reconstructor(clip="none", path="general", threads=1)
    whole.insert_all(Sequence.from_arrays(stack, poses, np.arange(FRAMES) / 30))
    volume = loop.snapshot()
    assert np.array_equal(volume.values(), whole.snapshot().values())
    report = volume.write(folder / "single.mha")
    assert report is not None
    call = statistics.median(calls)
    return {"insert, ms": call, "beside it, µs": (call - report["insert_ms"]["median"]) * 1e3}


def dense() -> dict[str, float]:
    """Time all values of 256³ voxels."""
    frames = np.random.default_rng(2).integers(1, 255, (250, 250, 250), np.uint8)
    poses = np.tile(np.diag([0.5, 0.5, 0.5, 1.0]), (250, 1, 1))
    poses[:, 2, 3] = np.arange(250) * 0.5
    reconstructor = Reconstructor(spacing=0.5, clip="none", path="general", size=(256, 256, 256))
    reconstructor.insert_all(Sequence.from_arrays(frames, poses))
    volume = reconstructor.snapshot()
    assert volume.shape == (256, 256, 256)
    ms, values = timed(volume.values)
    assert values.any() and np.array_equal(values[100:103], volume[100:103])
    return {"values of 256³, ms": ms}


def whole(program: str, sweep: pathlib.Path, folder: pathlib.Path) -> dict[str, float]:
    """Time a sweep to its file, by the command and by the package."""

    def by_package() -> None:
        reconstructor = Reconstructor()
        reconstructor.insert_all(Sequence.open(sweep))
        reconstructor.snapshot().write(folder / "package.mha")

    words = [program, "reconstruct", sweep, "-o", folder / "command.mha"]
    command, _ = timed(lambda: subprocess.run(words, check=True, capture_output=True))
    package, _ = timed(by_package)
    assert (folder / "package.mha").read_bytes() == (folder / "command.mha").read_bytes()
    return {"command, ms": command, "insert_all, ms": package, "ratio": package / command}


def main(program: str, rounds: str = "7") -> None:
    """Print the times."""
    measured: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        sweep = folder / "sweep.igs.mha"
        flags = ["--frames=240", "--trajectory=freehand", "--image-size=640x480", "--noise=4"]
        subprocess.run([program, "phantom", "-o", sweep, *flags], check=True, capture_output=True)
        for _ in range(int(rounds)):
            times = single(folder) | dense() | whole(program, sweep, folder)
            for what, number in times.items():
                measured.setdefault(what, []).append(number)
    for what, numbers in measured.items():
        low, high = min(numbers), max(numbers)
        print(f"{what:20} {statistics.median(numbers):9.3f}   {low:9.3f} to {high:9.3f}")
    print(json.dumps(measured))


if __name__ == "__main__":
    main(*sys.argv[1:])
