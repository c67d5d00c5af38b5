"""Calibrations: each is a command of ``sonoweave calibrate``, by its flags as keywords."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterable
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from ._arguments import keywords, path
from ._sonoweave import Calibration as _Native

__all__ = [
    "ArmCalibration",
    "ArmCheck",
    "LandmarkCalibration",
    "LatencyCalibration",
    "PivotCalibration",
    "ProbeCalibration",
    "TrackerMap",
    "TrackerNoise",
    "calibrate_arm",
    "calibrate_landmarks",
    "calibrate_latency",
    "calibrate_pivot",
    "calibrate_probe",
    "calibrate_tracker",
]

_Path = str | os.PathLike[str]


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


def calibrate_probe(
    sequence: _Path,
    phantom: _Path | None = None,
    *,
    method: str | None = None,
    validate: _Path | None = None,
    registration: _Path | None = None,
    stylus_tip: _Path | None = None,
    output: _Path | None = None,
    report: _Path | None = None,
    **settings: Any,
) -> ProbeCalibration:
    """Calibrate a probe, as ``sonoweave calibrate probe`` does.

    Parameters
    ----------
    sequence : path
        Recorded scan of the phantom or target: a tracked sequence with images, or a session.
    phantom : path, optional
        Phantom with its wires, for the method ``nwire``: our TOML or a PLUS XML.
    method : str, optional
        ``nwire``, ``point``, ``stylus`` or ``plane``. By default ``nwire``.
    validate : path, optional
        Second recording, which has no part in the result. By default the last third of the first
        validates a calibration from the others.
    registration : path, optional
        Calibration file with the phantom's pose. By default the phantom's file.
    stylus_tip : path, optional
        Calibration file with the stylus's tip, for the method ``stylus``.
    output : path, optional
        Put the result into this calibration file, with its quality and covariance.
    report : path, optional
        Write the report as a page for a browser (.html).
    **settings : Any
        Further flags of the command, with ``_`` for ``-``: ``clip``, ``limit``, ``preset``, and the
        others.

    Returns
    -------
    ProbeCalibration
        The result.

    Raises
    ------
    InputError
        A setting does not fit, or the recording does not determine the image plane.
    OSError
        A file cannot be read or written.
    """
    given = {
        "sequence": path("sequence", sequence),
        "phantom": phantom,
        "method": method,
        "validate": validate,
        "registration": registration,
        "stylus_tip": stylus_tip,
        "output": output,
        "report": report,
    }
    content = _measured("probe", given | settings)
    validation = content["validation_error_mm"]
    return ProbeCalibration(
        probe_from_image=_array(content["image_to_probe"], 4, 4),
        error=content["error_mm"]["mean"],
        validation_error=None if validation is None else validation["mean"],
        lag=content["lag_s"],
        report=content,
    )


def calibrate_latency(
    sequence: _Path | None = None,
    *,
    video: _Path | None = None,
    tracker: _Path | None = None,
    method: str | None = None,
    config: _Path | None = None,
    output: _Path | None = None,
    **settings: Any,
) -> LatencyCalibration:
    """Calibrate the tracker's latency, as ``sonoweave calibrate latency`` does.

    Parameters
    ----------
    sequence : path, optional
        Recording with frames and poses: a tracked sequence, or a session.
    video : path, optional
        Instead of it, a sequence with frames, whose poses are in ``tracker``.
    tracker : path, optional
        A tracked sequence with the poses.
    method : str, optional
        ``line`` or ``crossings``. By default the former, and the latter if no frame shows a floor.
    config : path, optional
        Calibration of the probe: our TOML or a PLUS XML. By default the session's.
    output : path, optional
        Put the latencies into this calibration file.
    **settings : Any
        Further flags of the command, with ``_`` for ``-``: ``video_latency_ms``, ``range_ms``.

    Returns
    -------
    LatencyCalibration
        The result.

    Raises
    ------
    InputError
        A setting does not fit, or the recording does not determine the lag.
    OSError
        A file cannot be read or written.
    """
    given = {
        "sequence": None if sequence is None else path("sequence", sequence),
        "video": video,
        "tracker": tracker,
        "method": method,
        "config": config,
        "output": output,
    }
    content = _measured("latency", given | settings)
    return LatencyCalibration(
        lag=content["lag_s"],
        lag_error=content["lag_se_s"],
        video=content["video_ms"] / 1e3,
        tracker=content["tracker_ms"] / 1e3,
        method=content["method"],
        report=content,
    )


def calibrate_pivot(
    sequence: _Path, *, output: _Path | None = None, **settings: Any
) -> PivotCalibration:
    """Find the tip of a stylus that was swung about it, as ``sonoweave calibrate pivot`` does.

    Parameters
    ----------
    sequence : path
        Recording of the stylus: a tracked sequence, or a session.
    output : path, optional
        Put the result into this calibration file.
    **settings : Any
        Further flags of the command, with ``_`` for ``-``: ``stylus``, ``reference``, ``limit``,
        and the others; ``from_`` and ``to`` in s.

    Returns
    -------
    PivotCalibration
        The result.

    Raises
    ------
    InputError
        A setting does not fit, or the recording does not determine the tip.
    OSError
        A file cannot be read or written.
    """
    given = {"sequence": path("sequence", sequence), "output": output}
    content = _measured("pivot", given | settings)
    return PivotCalibration(
        stylus_from_tip=_array(content["stylus_tip_to_stylus"], 4, 4),
        tip=_array(content["tip_mm"], 3),
        covariance=_array(content["tip_covariance_mm2"], 3, 3),
        error=content["residual_mm"],
        report=content,
    )


def calibrate_landmarks(
    sequence: _Path,
    phantom: _Path,
    *,
    stylus_tip: _Path | None = None,
    output: _Path | None = None,
    **settings: Any,
) -> LandmarkCalibration:
    """Find a phantom's pose by touched landmarks, as ``sonoweave calibrate landmarks`` does.

    Parameters
    ----------
    sequence : path
        Recording of the stylus: a tracked sequence, or a session.
    phantom : path
        Phantom with its landmarks: our TOML or a PLUS XML.
    stylus_tip : path, optional
        Calibration file with the stylus's tip. By default the phantom's file.
    output : path, optional
        Put the result into this calibration file.
    **settings : Any
        Further flags of the command, with ``_`` for ``-``: ``stylus``, ``reference``, ``tip_error``,
        ``limit``, and the others; ``from_`` and ``to`` in s.

    Returns
    -------
    LandmarkCalibration
        The result.

    Raises
    ------
    InputError
        A setting does not fit, or the recording does not determine the pose.
    OSError
        A file cannot be read or written.
    """
    given = {
        "sequence": path("sequence", sequence),
        "phantom": path("phantom", phantom),
        "stylus_tip": stylus_tip,
        "output": output,
    }
    content = _measured("landmarks", given | settings)
    return LandmarkCalibration(
        reference_from_phantom=_array(content["phantom_to_reference"], 4, 4),
        covariance=_array(content["covariance"], 6, 6),
        error=content["error_mm"]["mean"],
        touched=tuple(landmark["name"] for landmark in content["landmarks"]),
        missed=tuple(content["missed"]),
        report=content,
    )


@overload
def calibrate_tracker(
    sequence: _Path, *, other: None = None, output: _Path | None = None, **settings: Any
) -> TrackerNoise: ...
@overload
def calibrate_tracker(
    sequence: _Path, *, other: str, output: _Path | None = None, **settings: Any
) -> TrackerMap: ...
def calibrate_tracker(
    sequence: _Path, *, other: str | None = None, output: _Path | None = None, **settings: Any
) -> TrackerNoise | TrackerMap:
    """Measure a tracker's noise or distortion, as ``sonoweave calibrate tracker`` does.

    Parameters
    ----------
    sequence : path
        Recording of a resting sensor, or of two sensors on one rigid piece that is carried through
        the room: a tracked sequence, or a session.
    other : str, optional
        Name of the second sensor's frame, for a map of the room.
    output : path, optional
        Put the result into this calibration file.
    **settings : Any
        Further flags of the command, with ``_`` for ``-``: ``sensor``, ``tracker``, ``cell``,
        ``limit``; ``from_`` and ``to`` in s.

    Returns
    -------
    TrackerNoise or TrackerMap
        The noise; with a second sensor, the map.

    Raises
    ------
    InputError
        A setting does not fit, or the recording does not determine the result.
    OSError
        A file cannot be read or written.
    """
    given = {"sequence": path("sequence", sequence), "other": other, "output": output}
    content = _measured("tracker", given | settings)
    if other is None:
        return TrackerNoise(
            position=_array(content["position_mm"], 3),
            position_sd=_array(content["position_sd_mm"], 3),
            rotation_sd=_array(content["rotation_sd_deg"], 3),
            report=content,
        )
    cells = content["cells"]
    return TrackerMap(
        cell=content["cell_mm"],
        corners=_array([cell["low_mm"] for cell in cells], -1, 3),
        errors=_array([cell["rms_mm"] for cell in cells], -1),
        distorted=np.array([cell["warned_of"] for cell in cells], np.bool_),
        report=content,
    )


@overload
def calibrate_arm(
    session: _Path,
    *,
    plate: _Path | None = None,
    point: bool = False,
    distances: float | Iterable[float] | None = None,
    check: Literal[False] = False,
    output: _Path | None = None,
    **settings: Any,
) -> ArmCalibration: ...
@overload
def calibrate_arm(
    session: _Path,
    *,
    plate: _Path | None = None,
    point: bool = False,
    distances: float | Iterable[float] | None = None,
    check: Literal[True],
    output: None = None,
    **settings: Any,
) -> ArmCheck: ...
def calibrate_arm(
    session: _Path,
    *,
    plate: _Path | None = None,
    point: bool = False,
    distances: float | Iterable[float] | None = None,
    check: bool = False,
    output: _Path | None = None,
    **settings: Any,
) -> ArmCalibration | ArmCheck:
    """Calibrate an arm by touches, or compare it, as ``sonoweave calibrate arm`` does.

    Parameters
    ----------
    session : path
        Recorded session of the arm.
    plate : path, optional
        The touched plate, with its divots.
    point : bool, optional
        Whether all touches are of one place instead.
    distances : float or iterable of float, optional
        Or the distances between successive touches, mm.
    check : bool, optional
        Whether the arm is compared with its calibration, and not calibrated.
    output : path, optional
        Put the result into this calibration file.
    **settings : Any
        Further flags of the command, with ``_`` for ``-``: ``order``, ``skip``, ``rest``,
        ``limit``, and the others; ``from_`` and ``to`` in s.

    Returns
    -------
    ArmCalibration or ArmCheck
        The result, or the comparison.

    Raises
    ------
    InputError
        A setting does not fit, or the recording does not determine the arm.
    OSError
        A file cannot be read or written.
    """
    given = {
        "session": path("session", session),
        "plate": plate,
        "point": point,
        "distances": distances,
        "check": check,
        "output": output,
    }
    content = _measured("arm", given | settings)
    if check:
        return ArmCheck(content["changed"], content["rms_mm"], content["advice"], content)
    return ArmCalibration(content["joints"], content["rms_mm"], content)


def _measured(quantity: str, given: dict[str, Any]) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(_Native.measure(quantity, keywords(given)))
    return content


def _array(numbers: Any, *shape: int) -> npt.NDArray[np.float64]:
    return np.array(numbers, np.float64).reshape(shape)
