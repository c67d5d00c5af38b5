"""Calibrations."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _arguments as check
from ._sonoweave import Calibration as _Native
from .errors import CalibrationError

__all__ = ["Calibration"]


class Calibration:
    """A calibration file of ours, or a PLUS configuration. Made by :meth:`read`."""

    _path: str
    _name: str | None
    _native: _Native

    def __init__(self) -> None:
        raise TypeError("a Calibration is made by Calibration.read")

    @classmethod
    def _of(cls, path: str, name: str | None) -> Calibration:
        self = cls.__new__(cls)
        self._path, self._name, self._native = path, name, _Native(path, name)
        return self

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Calibration:
        """Read a file.

        Parameters
        ----------
        path : path
            Our TOML or a PLUS XML.

        Returns
        -------
        Calibration
            The calibration.

        Raises
        ------
        OSError
            The file cannot be read.
        InputError
            A key is unknown, missing or out of range.
        """
        return cls._of(check.path("path", path), None)

    def preset(self, name: str) -> Calibration:
        """Return the calibration at the depth of a preset.

        Parameters
        ----------
        name : str
            Name of the preset.

        Returns
        -------
        Calibration
            The calibration.

        Raises
        ------
        InputError
            There is no such preset.
        """
        return self._of(self._path, name)

    def __reduce__(self) -> tuple[Any, tuple[str, str | None]]:
        """Return what makes it again: path and preset."""
        return _make_calibration, (self._path, self._name)

    def __repr__(self) -> str:
        """Return a short description."""
        preset = "" if self._name is None else f", preset {self._name!r}"
        return f"<sonoweave.Calibration {self._path!r}{preset}>"

    @property
    def presets(self) -> list[str]:
        """Names of the presets."""
        return self._native.presets

    @property
    def transforms(self) -> dict[tuple[str, str], npt.NDArray[np.float64]]:
        """Constant transforms, (4, 4), by the names of source and target."""
        return dict(zip(self._native.names, self._native.matrices(), strict=True))

    @property
    def probe_from_image(self) -> npt.NDArray[np.float64]:
        """Calibration of the probe, (4, 4): mm at the sensor from pixels (u, v, 0, 1)."""
        names = (self._native.image, "Probe")
        transforms = self.transforms
        if names in transforms:
            return transforms[names]
        if names[::-1] in transforms:
            return np.asarray(np.linalg.inv(transforms[names[::-1]]), np.float64)
        raise CalibrationError(
            f"{self._path}: has no calibration of the probe; calibrate it, or choose a preset",
            names,
        )

    @property
    def latency(self) -> dict[str, float] | None:
        """Latencies of ``video`` and ``tracker``, s; None if the file has none."""
        latency = self._native.latency_ms
        return None if latency is None else {"video": latency[0] / 1e3, "tracker": latency[1] / 1e3}

    @property
    def spacing(self) -> tuple[float, float, float] | None:
        """Distance between voxels along x, y, z, mm; None if the file has none."""
        spacing = self._native.spacing_mm
        return None if spacing is None else (spacing[0], spacing[1], spacing[2])

    @property
    def provenance(self) -> str:
        """Origin of the numbers, for people."""
        return self._native.provenance


def _make_calibration(path: str, name: str | None) -> Calibration:
    return Calibration._of(path, name)
