"""Calibration of probes."""

from __future__ import annotations

import dataclasses
import json
import os
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _arguments as check
from ._sonoweave import Calibration as _Native

__all__ = ["ProbeCalibration", "calibrate_probe"]


@dataclasses.dataclass(frozen=True)
class ProbeCalibration:
    """Result of a probe's calibration.

    Parameters
    ----------
    probe_from_image : array of float64, shape (4, 4)
        Maps pixels (u, v, 0, 1) to mm at the sensor.
    error : float
        Mean error of the middle wires of the frames used, mm, by PLUS's definition.
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


def calibrate_probe(
    sequence: str | os.PathLike[str],
    phantom: str | os.PathLike[str],
    *,
    validate: str | os.PathLike[str] | None = None,
    registration: str | os.PathLike[str] | None = None,
    output: str | os.PathLike[str] | None = None,
    report: str | os.PathLike[str] | None = None,
    **settings: Any,
) -> ProbeCalibration:
    """Calibrate a probe by an N-wire phantom, as ``sonoweave calibrate probe`` does.

    Parameters
    ----------
    sequence : path
        Recorded scan of the phantom: a tracked sequence with images.
    phantom : path
        Phantom with its wires: our TOML or a PLUS XML.
    validate : path, optional
        Second recording, which has no part in the result. By default the last third of the first
        validates a calibration from the others.
    registration : path, optional
        Calibration file with the phantom's pose. By default the phantom's file.
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
        "sequence": check.path("sequence", sequence),
        "phantom": check.path("phantom", phantom),
        "validate": validate,
        "registration": registration,
        "output": output,
        "report": report,
    }
    content: dict[str, Any] = json.loads(_Native.of_probe(check.keywords(given | settings)))
    validation = content["validation_error_mm"]
    return ProbeCalibration(
        probe_from_image=np.array(content["image_to_probe"], np.float64).reshape(4, 4),
        error=content["error_mm"]["mean"],
        validation_error=None if validation is None else validation["mean"],
        lag=content["lag_s"],
        report=content,
    )
