"""Calibrations: each is a command of ``sonoweave calibrate``, by its flags as keywords."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from ._arguments import keywords, path
from ._calibration_results import (
    ArmCalibration,
    ArmCheck,
    CrossingsCheck,
    LandmarkCalibration,
    LatencyCalibration,
    PivotCalibration,
    ProbeCalibration,
    TrackerMap,
    TrackerNoise,
)
from ._sonoweave import Calibration as _Native

__all__ = [
    "calibrate_arm",
    "calibrate_crossings",
    "calibrate_landmarks",
    "calibrate_latency",
    "calibrate_pivot",
    "calibrate_probe",
    "calibrate_tracker",
]

_Path = str | os.PathLike[str]


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


def calibrate_crossings(
    sequence: _Path, *, config: _Path | None = None, output: _Path | None = None, **settings: Any
) -> CrossingsCheck:
    """Check a probe's calibration by crossing slices, as ``sonoweave calibrate crossings`` does.

    Parameters
    ----------
    sequence : path
        Sweeps of a body at rest in three directions: a tracked sequence with images, or a session.
    config : path, optional
        Calibration to check: our TOML or a PLUS XML. By default the session's.
    output : path, optional
        Put the calibration found into this new calibration file.
    **settings : Any
        Further flags of the command, with ``_`` for ``-``.

    Returns
    -------
    CrossingsCheck
        The result. A calibration that has slipped is no error, though the command then fails.

    Raises
    ------
    InputError
        A setting does not fit, the sweeps cross too little, or the result is not certain enough
        for ``output``.
    OSError
        A file cannot be read or written.
    """
    given = {"sequence": path("sequence", sequence), "config": config, "output": output}
    content = _measured("crossings", given | settings)
    return CrossingsCheck(
        probe_from_image=_array(content["image_to_probe"], 4, 4),
        shift=content["shift_mm"],
        shift_error=content["shift_se_mm"],
        lag=content["lag_s"][0],
        lag_error=content["lag_s"][1],
        slipped=content["has_slipped"],
        late=content["is_late"],
        undecided=content["is_undecided"],
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
