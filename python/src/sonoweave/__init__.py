"""Freehand 3D ultrasound: tracked frames to volumes, by the code of the command ``sonoweave``.

For research. Not a medical device. Not for diagnosis or treatment.
"""

from __future__ import annotations

from ._calibrate import (
    calibrate_arm,
    calibrate_crossings,
    calibrate_landmarks,
    calibrate_latency,
    calibrate_pivot,
    calibrate_probe,
    calibrate_tracker,
)
from ._calibration import Calibration
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
from ._reconstructor import Reconstructor
from ._render import render, section
from ._sequence import Sequence
from ._sonoweave import VERSION as __version__
from ._volume import Volume
from .errors import CalibrationError, FrameRefused, InputError, MemoryLimit, SonoweaveError

__all__ = [
    "ArmCalibration",
    "ArmCheck",
    "Calibration",
    "CalibrationError",
    "CrossingsCheck",
    "FrameRefused",
    "InputError",
    "LandmarkCalibration",
    "LatencyCalibration",
    "MemoryLimit",
    "PivotCalibration",
    "ProbeCalibration",
    "Reconstructor",
    "Sequence",
    "SonoweaveError",
    "TrackerMap",
    "TrackerNoise",
    "Volume",
    "__version__",
    "calibrate_arm",
    "calibrate_crossings",
    "calibrate_landmarks",
    "calibrate_latency",
    "calibrate_pivot",
    "calibrate_probe",
    "calibrate_tracker",
    "render",
    "section",
]
