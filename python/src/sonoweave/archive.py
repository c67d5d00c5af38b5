"""Recordings of public archives as sequences."""

from __future__ import annotations

import csv
import os
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _arguments as check
from ._sequence import Sequence
from .errors import InputError

__all__ = ["read_tus_rec"]

#: Labels of the two matrices of a calibration file: pixels to mm, and mm to the tool.
LABELS = (
    "scaling_from_pixel_to_mm",
    "spatial_calibration_from_image_coordinate_system_to_tracking_tool_coordinate_system",
)
#: Largest deviation of the tool's poses from a rotation.
RIGID = 1e-3


def read_tus_rec(
    path_h5: str | os.PathLike[str],
    calib_csv: str | os.PathLike[str],
    *,
    rate: float = 20.0,
    first_pixel: int = 0,
) -> Sequence:
    """Read a scan in the layout of the TUS-REC challenges; needs h5py.

    The pose of a frame is its tool's pose, times the calibration, times the scale. The world is
    the tracking camera's. All frames of the scan are read into memory.

    Parameters
    ----------
    path_h5 : path
        Scan (HDF5) with the data sets ``frames``, uint8, shape (N, height, width), and ``tforms``,
        float, shape (N, 4, 4): from the tracked tool to the camera, mm.
    calib_csv : path
        Calibration with two labelled matrices of four rows each, from pixels to mm
        (``scaling_from_pixel_to_mm``) and from mm to the tool
        (``spatial_calibration_from_image_coordinate_system_to_tracking_tool_coordinate_system``).
    rate : float, optional
        Frames a second: a scan has no times.
    first_pixel : int, optional
        Number of the first row and column in the calibration's pixels, 0 or 1. The challenges'
        own evaluation counts from 1.

    Returns
    -------
    Sequence
        The scan, with times from 0.

    Raises
    ------
    OSError
        A file cannot be read.
    InputError
        A file has another layout, or values that are not finite.
    """
    h5 = _h5py()
    path, calibration = check.path("path_h5", path_h5), check.path("calib_csv", calib_csv)
    if not (isinstance(rate, (int, float)) and np.isfinite(rate) and rate > 0):
        raise InputError(f"rate: must be a positive number of frames a second, not {rate!r}")
    if first_pixel not in (0, 1):
        raise InputError(f"first_pixel: must be 0 or 1, not {first_pixel!r}")
    scale, tool_from_mm = _calibration(calibration)
    shift = np.eye(4)
    shift[:2, 3] = first_pixel
    tool_from_image = tool_from_mm @ scale @ shift
    # An absent file is an OSError that names it; other failures of HDF5 are damaged files.
    with open(path, "rb"):
        pass
    try:
        with h5.File(path, "r") as file:
            frames = _data_set(h5, file, path, "frames")
            tforms = _data_set(h5, file, path, "tforms")
    except OSError as error:
        raise InputError(f"{path}: is no HDF5 file, or a damaged one ({error})") from None
    if frames.ndim != 3 or frames.dtype != np.uint8 or 0 in frames.shape:
        raise InputError(
            f"{path}: frames must be uint8 of shape (N, height, width), "
            f"not {frames.dtype} of shape {frames.shape}"
        )
    if tforms.dtype not in (np.float32, np.float64) or tforms.shape != (len(frames), 4, 4):
        raise InputError(
            f"{path}: tforms must be float32 or float64 of shape ({len(frames)}, 4, 4), as there "
            f"are {len(frames)} frames, not {tforms.dtype} of shape {tforms.shape}"
        )
    camera_from_tool = tforms.astype(np.float64)
    _check_rigid(path, "tforms", camera_from_tool)
    name = os.path.basename(path)
    return Sequence.from_arrays(
        frames, camera_from_tool @ tool_from_image, np.arange(len(frames)) / rate, name=name
    )


def _h5py() -> Any:
    try:
        import h5py
    except ImportError as error:
        message = "sonoweave.archive needs h5py; install it by: pip install h5py"
        raise ImportError(message) from error
    return h5py


def _data_set(h5: Any, file: Any, path: str, name: str) -> npt.NDArray[Any]:
    """Return a data set's values; it is checked that there is one."""
    found = file.get(name)
    if not isinstance(found, h5.Dataset):
        there = ", ".join(sorted(file)) or "nothing"
        raise InputError(f"{path}: has no data set {name}; it holds {there}")
    return np.asarray(found[()])


def _calibration(path: str) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return the two matrices of a calibration file."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        try:
            rows = [[cell.strip() for cell in row] for row in csv.reader(file)]
        except (UnicodeDecodeError, csv.Error) as error:
            raise InputError(f"{path}: is no table of text (CSV): {error}") from None
    # Spreadsheets fill a label's row with empty cells, and may add empty rows.
    rows = [row for row in rows if any(row)]
    labels = [" ".join(cell for cell in row if cell) for row in rows[::5]]
    if len(rows) != 10 or labels != list(LABELS):
        raise InputError(
            f"{path}: must hold two matrices of four rows, each below its label: "
            f"{LABELS[0]}, then {LABELS[1]}"
        )
    matrices = []
    for at, label in enumerate(LABELS):
        try:
            block = [[float(cell) for cell in row] for row in rows[5 * at + 1 : 5 * at + 5]]
        except ValueError as error:
            raise InputError(f"{path}: {label}: holds a cell that is no number: {error}") from None
        if any(len(row) != 4 for row in block):
            raise InputError(f"{path}: {label}: must have four numbers in each of four rows")
        matrices.append(np.array(block, np.float64))
    scale, tool_from_mm = matrices
    _check_affine(path, LABELS[0], scale[None])
    _check_rigid(path, LABELS[1], tool_from_mm[None])
    if not (np.linalg.det(scale[:3, :3]) > 0):
        raise InputError(f"{path}: {LABELS[0]}: must scale each axis by a positive number")
    return scale, tool_from_mm


def _check_affine(path: str, name: str, matrices: npt.NDArray[np.float64]) -> None:
    finite = np.isfinite(matrices).all(axis=(1, 2))
    if not finite.all():
        raise InputError(f"{path}: {name}: matrix {int(np.argmin(finite))} is not finite")
    last = np.abs(matrices[:, 3] - [0, 0, 0, 1]).max(axis=1) > RIGID
    if last.any():
        raise InputError(
            f"{path}: {name}: matrix {int(np.argmax(last))} has another last row than 0 0 0 1"
        )


def _check_rigid(path: str, name: str, matrices: npt.NDArray[np.float64]) -> None:
    """Check that matrices are rotations with translations, which keep the hand."""
    _check_affine(path, name, matrices)
    turns = matrices[:, :3, :3]
    error = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    wrong = (error > RIGID) | (np.linalg.det(turns) < 0)
    if wrong.any():
        raise InputError(
            f"{path}: {name}: matrix {int(np.argmax(wrong))} is no rotation and translation in mm"
        )
