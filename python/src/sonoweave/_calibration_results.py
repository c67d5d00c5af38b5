"""Results of calibrations, each with the report of its command."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = [
    "ArmCalibration",
    "ArmCheck",
    "LandmarkCalibration",
    "LatencyCalibration",
    "PivotCalibration",
    "ProbeCalibration",
    "TrackerMap",
    "TrackerNoise",
]


@dataclasses.dataclass(frozen=True)
class ProbeCalibration:
    """Result of a probe's calibration.

    Parameters
    ----------
    probe_from_image : array of float64, shape (4, 4)
        Maps pixels (u, v, 0, 1) to mm at the sensor.
    error : float
        Mean error of the frames used, mm: of the middle wires by PLUS's definition, or the
        distance from the point, the stylus's tip or the plane.
    validation_error : float or None
        The same of frames that had no part in the calibration, mm.
    lag : float
        Time by which poses come later than frames, s.
    report : dict
        The report of the command ``sonoweave calibrate probe``.
    """

    probe_from_image: npt.NDArray[np.float64]
    error: float
    validation_error: float | None
    lag: float
    report: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class LatencyCalibration:
    """Result of a latency's calibration.

    Parameters
    ----------
    lag : float
        Time by which the tracker lags the video, s.
    lag_error : float
        Its standard error, s.
    video : float
        Latency of the video, s.
    tracker : float
        Latency of the tracker, s.
    method : str
        ``line`` or ``crossings``.
    report : dict
        The report of the command ``sonoweave calibrate latency``.
    """

    lag: float
    lag_error: float
    video: float
    tracker: float
    method: str
    report: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class PivotCalibration:
    """Result of a stylus's calibration.

    Parameters
    ----------
    stylus_from_tip : array of float64, shape (4, 4)
        Maps mm at the tip, with z along the shaft, to mm at the stylus's sensor.
    tip : array of float64, shape (3,)
        Position of the tip in the frame of the sensor, mm.
    covariance : array of float64, shape (3, 3)
        Covariance of that position, mm².
    error : float
        Mean distance of the tip from the pivot, mm.
    report : dict
        The report of the command ``sonoweave calibrate pivot``.
    """

    stylus_from_tip: npt.NDArray[np.float64]
    tip: npt.NDArray[np.float64]
    covariance: npt.NDArray[np.float64]
    error: float
    report: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class LandmarkCalibration:
    """Result of a phantom's registration.

    Parameters
    ----------
    reference_from_phantom : array of float64, shape (4, 4)
        Maps mm in the phantom to mm in the frame of the reference.
    covariance : array of float64, shape (6, 6)
        Covariance of a rotation about the reference's axes, rad, and of a shift, mm.
    error : float
        Mean distance of the touched landmarks from the phantom's, mm.
    touched : tuple of str
        Names of the touched landmarks.
    missed : tuple of str
        Names of the others.
    report : dict
        The report of the command ``sonoweave calibrate landmarks``.
    """

    reference_from_phantom: npt.NDArray[np.float64]
    covariance: npt.NDArray[np.float64]
    error: float
    touched: tuple[str, ...]
    missed: tuple[str, ...]
    report: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class TrackerNoise:
    """Noise of a resting sensor; standard deviations.

    Parameters
    ----------
    position : array of float64, shape (3,)
        Mean position, mm.
    position_sd : array of float64, shape (3,)
        Noise of the position along x, y, z, mm.
    rotation_sd : array of float64, shape (3,)
        Noise of the orientation about x, y, z, degrees.
    report : dict
        The report of the command ``sonoweave calibrate tracker``.
    """

    position: npt.NDArray[np.float64]
    position_sd: npt.NDArray[np.float64]
    rotation_sd: npt.NDArray[np.float64]
    report: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class TrackerMap:
    """Distortion of a tracker's field, in cells of the room.

    Parameters
    ----------
    cell : float
        Edge of a cell, mm.
    corners : array of float64, shape (N, 3)
        Lowest corner of each visited cell, mm in the tracker's frame.
    errors : array of float64, shape (N,)
        Deviation of the second sensor in each cell, mm (root mean square).
    distorted : array of bool, shape (N,)
        Whether the deviation exceeds the limit.
    report : dict
        The report of the command ``sonoweave calibrate tracker``.
    """

    cell: float
    corners: npt.NDArray[np.float64]
    errors: npt.NDArray[np.float64]
    distorted: npt.NDArray[np.bool_]
    report: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class CrossingsCheck:
    """Check of a probe's calibration by slices that cross, and a corrected calibration.

    Parameters
    ----------
    probe_from_image : array of float64, shape (4, 4)
        The calibration by which crossing slices agree best: pixels to mm at the probe's sensor.
    shift, shift_error : float
        Displacement of the image by it, root mean square, and its standard error, mm.
    lag, lag_error : float
        The tracker's lag beyond the one in use, and its standard error, s.
    slipped, late : bool
        Whether the calibration, or the latency, in use is off by more than chance explains.
    undecided : bool
        Whether the sweeps do not tell; the two above are then False.
    report : dict
        The report of the command ``sonoweave calibrate crossings``.
    """

    probe_from_image: npt.NDArray[np.float64]
    shift: float
    shift_error: float
    lag: float
    lag_error: float
    slipped: bool
    late: bool
    undecided: bool
    report: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class ArmCalibration:
    """Result of an arm's calibration.

    Parameters
    ----------
    joints : list of dict
        The joints, as a calibration file has them: lengths in mm, zeros in counts.
    error : float
        Distance of the touches from their divots, mm (root mean square).
    report : dict
        The report of the command ``sonoweave calibrate arm``.
    """

    joints: list[dict[str, Any]]
    error: float
    report: dict[str, Any]


@dataclasses.dataclass(frozen=True)
class ArmCheck:
    """Comparison of an arm with its calibration.

    Parameters
    ----------
    changed : bool
        Whether the arm no longer agrees with its calibration; the command then fails.
    error : float
        Distance of the touches from their divots, mm (root mean square).
    advice : str
        Advice, if it has changed.
    report : dict
        The report of the command ``sonoweave calibrate arm --check``.
    """

    changed: bool
    error: float
    advice: str
    report: dict[str, Any]
