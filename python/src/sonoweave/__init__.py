"""Freehand 3D ultrasound: tracked frames to volumes, by the code of the command ``sonoweave``.

For research. Not a medical device. Not for diagnosis or treatment.
"""

from __future__ import annotations

from ._calibrate import ProbeCalibration, calibrate_probe
from ._calibration import Calibration
from ._reconstructor import Reconstructor
from ._render import render, section
from ._sequence import Sequence
from ._sonoweave import VERSION as __version__
from ._volume import Volume
from .errors import CalibrationError, FrameRefused, InputError, MemoryLimit, SonoweaveError

__all__ = [
    "Calibration",
    "CalibrationError",
    "FrameRefused",
    "InputError",
    "MemoryLimit",
    "ProbeCalibration",
    "Reconstructor",
    "Sequence",
    "SonoweaveError",
    "Volume",
    "__version__",
    "calibrate_probe",
    "render",
    "section",
]
