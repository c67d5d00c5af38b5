"""Scans in the layout of the TUS-REC challenges, written from a sweep with known poses."""

from __future__ import annotations

import pathlib
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sonoweave
from sonoweave import InputError, Sequence

h5py = pytest.importorskip("h5py")
archive = pytest.importorskip("sonoweave.archive")

SCALE = np.diag([0.23, 0.22, 1.0, 1.0])


def rotation(axis: int, angle: float) -> np.ndarray:
    a, b = [n for n in range(3) if n != axis]
    turn = np.eye(4)
    turn[a, a] = turn[b, b] = np.cos(angle)
    turn[a, b], turn[b, a] = -np.sin(angle), np.sin(angle)
    return turn


def tool_from_mm() -> np.ndarray:
    matrix = rotation(0, 0.3) @ rotation(1, -1.1) @ rotation(2, 2.0)
    matrix[:3, 3] = [12.5, -3.25, 117.0]
    return matrix


def block(matrix: np.ndarray) -> str:
    return "".join(",".join(repr(float(x)) for x in row) + "\n" for row in matrix)


def table(scale: np.ndarray = SCALE, tool: np.ndarray | None = None) -> str:
    tool = tool_from_mm() if tool is None else tool
    return f"{archive.LABELS[0]},,,\n{block(scale)}{archive.LABELS[1]},,,\n{block(tool)}"


class Scan:
    """A scan's two files, made from a sweep."""

    def __init__(self, folder: pathlib.Path, sweep: pathlib.Path) -> None:
        self.h5, self.csv = folder / "RH_Per_L_DtP.h5", folder / "calib_matrix.csv"
        sequence = Sequence.open(sweep)
        self.frames = np.stack(list(sequence))
        self.world_from_image = sequence.poses
        inverse = np.linalg.inv(tool_from_mm() @ SCALE)
        # The sweep's pixels are isotropic: its poses become rigid by its own scale.
        pixel = np.linalg.norm(sequence.poses[0, :3, 0])
        rigid = sequence.poses @ np.diag([1 / pixel, 1 / pixel, 1, 1])
        rigid[:, :3, 2] = np.cross(rigid[:, :3, 0], rigid[:, :3, 1])
        self.tforms = rigid @ np.linalg.inv(tool_from_mm())
        self.truth = self.tforms @ np.linalg.inv(inverse)
        self.csv.write_text(table())
        self.write()

    def write(self, **data: Any) -> None:
        with h5py.File(self.h5, "w") as file:
            for name, values in ({"frames": self.frames, "tforms": self.tforms} | data).items():
                if values is not None:
                    file[name] = values

    def read(self, **options: Any) -> Sequence:
        return archive.read_tus_rec(self.h5, self.csv, **options)


@pytest.fixture
def scan(tmp_path: pathlib.Path, sweep: pathlib.Path) -> Scan:
    return Scan(tmp_path, sweep)


def test_poses_times_and_volume_are_those_of_the_scan(scan: Scan) -> None:
    sequence = scan.read()
    assert np.abs(sequence.poses - scan.truth).max() <= 1e-12 * np.abs(scan.truth).max()
    # The same product written out for one pixel.
    mm = SCALE @ [17, 23, 0, 1]
    assert np.allclose(
        sequence.poses[7] @ [17, 23, 0, 1], scan.tforms[7] @ (tool_from_mm() @ mm), atol=1e-12
    )
    assert np.array_equal(sequence.times, np.arange(60) / 20)
    assert all(np.array_equal(a, b) for a, b in zip(sequence, scan.frames, strict=True))
    volumes = []
    for one in (sequence, Sequence.from_arrays(scan.frames, sequence.poses, np.arange(60) / 20)):
        reconstructor = sonoweave.Reconstructor(spacing=0.5, clip="none")
        ledger = reconstructor.insert_all(one)
        volumes.append(reconstructor.snapshot().values())
        assert ledger["frames"]["used"] == 60
    assert np.array_equal(volumes[0], volumes[1]) and volumes[0].max() > 0


def test_rate_and_first_pixel_are_options(scan: Scan) -> None:
    sequence = scan.read(rate=50, first_pixel=1)
    assert np.array_equal(sequence.times, np.arange(60) / 50)
    expected = scan.truth @ [17, 23, 0, 1]
    assert np.allclose(sequence.poses @ [16, 22, 0, 1], expected, atol=1e-9)
    for options in ({"rate": 0}, {"rate": np.nan}, {"first_pixel": 2}):
        with pytest.raises(InputError, match=next(iter(options))):
            scan.read(**options)


def test_single_precision_is_read(scan: Scan) -> None:
    scan.write(tforms=scan.tforms.astype(np.float32))
    expected = scan.tforms.astype(np.float32).astype(np.float64) @ tool_from_mm() @ SCALE
    assert np.abs(scan.read().poses - expected).max() <= 1e-10


def poisoned(scan: Scan, change: Callable[[np.ndarray], None]) -> np.ndarray:
    tforms = scan.tforms.copy()
    change(tforms)
    return tforms


def set_at(place: Any, value: float) -> Callable[[np.ndarray], None]:
    def change(tforms: np.ndarray) -> None:
        tforms[place] = value

    return change


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (lambda s: {"frames": None}, "has no data set frames; it holds tforms"),
        (lambda s: {"tforms": None}, "has no data set tforms"),
        (lambda s: {"frames": s.frames.astype(np.float32)}, "not float32 of shape"),
        (lambda s: {"frames": s.frames[0]}, "must be uint8 of shape (N, height, width)"),
        (lambda s: {"frames": s.frames[:0]}, "must be uint8 of shape"),
        (lambda s: {"frames": s.frames[:-1]}, "as there are 59 frames"),
        (lambda s: {"tforms": s.tforms[:, :3]}, "not float64 of shape (60, 3, 4)"),
        (lambda s: {"tforms": s.tforms.astype(int)}, "not int64"),
        (lambda s: {"tforms": poisoned(s, set_at((3, 0, 0), np.nan))}, "matrix 3 is not finite"),
        (lambda s: {"tforms": poisoned(s, set_at((5, 3, 0), 1))}, "matrix 5 has another last row"),
        (lambda s: {"tforms": poisoned(s, set_at((9, 0), 0.5))}, "matrix 9 is no rotation"),
    ],
)
def test_other_scans_are_refused_with_a_sentence(
    scan: Scan, data: Callable[[Scan], dict[str, Any]], says: str
) -> None:
    scan.write(**data(scan))
    with pytest.raises(InputError, match=re.escape(says)):
        scan.read()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "must hold two matrices"),
        (block(SCALE) + block(np.eye(4)), "each below its label"),
        (table().replace("scaling", "scale"), "each below its label"),
        (table() + "1,2,3,4\n", "must hold two matrices"),
        (table().replace("0.23", "x"), "holds a cell that is no number"),
        (table().replace("0.23,", "0.23,1,"), "must have four numbers"),
        (table(np.diag([0.23, np.nan, 1, 1])), "is not finite"),
        (table(np.diag([0.23, -0.22, 1, 1])), "must scale each axis"),
        (table(tool=np.diag([2.0, 1, 1, 1])), "is no rotation"),
    ],
)
def test_other_calibrations_are_refused_with_a_sentence(scan: Scan, text: str, says: str) -> None:
    scan.csv.write_text(text)
    with pytest.raises(InputError, match=re.escape(says)):
        scan.read()


def test_files_that_are_missing_or_no_hdf5_are_named(scan: Scan) -> None:
    scan.h5.write_bytes(b"no HDF5")
    with pytest.raises(InputError, match="is no HDF5 file"):
        scan.read()
    scan.h5.unlink()
    with pytest.raises(FileNotFoundError) as missing:
        scan.read()
    assert missing.value.filename == str(scan.h5)
    scan.csv.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="is no table of text"):
        scan.read()
    scan.csv.unlink()
    with pytest.raises(FileNotFoundError):
        scan.read()
