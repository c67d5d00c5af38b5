"""Sweeps, and the program that reconstructs them, for all tests."""

from __future__ import annotations

import json
import os
import pathlib
import subprocess
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import sonoweave

ROOT = pathlib.Path(__file__).parents[2]


@pytest.fixture(scope="session")
def program() -> str:
    """Path of the program, by SONOWEAVE_PROGRAM."""
    path = os.environ.get("SONOWEAVE_PROGRAM", str(ROOT / "target" / "debug" / "sonoweave"))
    assert os.access(path, os.X_OK), f"{path}: is no program; give it by SONOWEAVE_PROGRAM"
    return path


@pytest.fixture(scope="session")
def sweep(program: str, tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    """A freehand sweep of 60 frames, with noise."""
    path = tmp_path_factory.mktemp("sweep") / "sweep.igs.mha"
    flags = ["--frames", "60", "--trajectory", "freehand", "--noise", "4"]
    subprocess.run([program, "phantom", "-o", path, *flags], check=True, capture_output=True)
    return path


@pytest.fixture(scope="session")
def recordings() -> pathlib.Path:
    """Folder of recordings that are not part of the project, by SONOWEAVE_TEST_DATA."""
    folder = pathlib.Path(os.environ.get("SONOWEAVE_TEST_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        if os.environ.get("SONOWEAVE_REQUIRE_RECORDINGS") == "1":
            pytest.fail(f"{folder}: has no recordings")
        pytest.skip(f"{folder}: has no recordings")
    return folder


def sonoweave_does(program: str, *words: object, cwd: pathlib.Path | None = None) -> str:
    done = subprocess.run(
        [program, *map(str, words)], cwd=cwd, check=True, capture_output=True, text=True
    )
    return done.stdout


@pytest.fixture
def client() -> Iterator[Any]:
    """A client of a cluster of two processes."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


class Reconstructed:
    """A volume that the program has written, and its report."""

    def __init__(
        self, program: str, sweep: pathlib.Path, folder: pathlib.Path, *flags: str
    ) -> None:
        self.path = folder / "volume.mha"
        self.weights_path = folder / "weights.mha"
        outputs = [
            "-o",
            self.path,
            "--weights",
            self.weights_path,
            f"--json={folder / 'report.json'}",
        ]
        subprocess.run(
            [program, "reconstruct", sweep, *outputs, "--type", "f32", *flags],
            check=True,
            capture_output=True,
        )
        self.report = json.loads((folder / "report.json").read_text())

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Read values and weights without the package."""
        return mha(self.path), mha(self.weights_path)


def mha(path: pathlib.Path) -> np.ndarray:
    """Read an uncompressed MetaImage of float32."""
    data = path.read_bytes()
    at = data.index(b"ElementDataFile = LOCAL\n")
    header = dict(line.split(" = ", 1) for line in data[:at].decode().splitlines())
    assert header["ElementType"] == "MET_FLOAT" and header["BinaryDataByteOrderMSB"] == "False"
    size = [int(n) for n in header["DimSize"].split()]
    values = np.frombuffer(data, "<f4", offset=at + len(b"ElementDataFile = LOCAL\n"))
    return values.reshape(size[::-1])


@pytest.fixture
def grown(sweep: pathlib.Path) -> sonoweave.Reconstructor:
    """A reconstructor with the first frames of the sweep."""
    reconstructor = sonoweave.Reconstructor(spacing=1.0, clip="none", threads=1)
    sequence = sonoweave.Sequence.open(sweep)
    for frame, pose, time in zip(sequence, sequence.poses[:5], sequence.times):
        reconstructor.insert(frame, pose, time=time)
    return reconstructor
