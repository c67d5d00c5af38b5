"""Checks and conversions of arguments."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import InputError

Keyword = tuple[str, str | None]

#: Types of pixels, by the letters of NumPy.
_PIXELS = {"B": "uint8", "H": "uint16", "f": "float32"}


def keywords(values: Mapping[str, Any]) -> list[Keyword]:
    """Return keywords in the notation of the command line.

    Those that are None or False are left out; True is a flag that takes no value. A name that is a
    word of Python ends in an underscore, such as ``from_``.
    """
    return [
        (name.removesuffix("_"), None if value is True else text(name, value))
        for name, value in values.items()
        if value is not None and value is not False
    ]


def text(name: str, value: Any) -> str:
    """Return a value in the notation of the command line."""
    if isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name}: must be a number or text, not {value!r}")
    if isinstance(value, (str, os.PathLike)):
        return os.fspath(value) if isinstance(value, os.PathLike) else value
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, slice):
        if value.step is not None:
            raise InputError(f"{name}: must have no step, not {value!r}")
        return f"{value.start or 0}..{'' if value.stop is None else value.stop}"
    if isinstance(value, range):
        if value.step != 1:
            raise InputError(f"{name}: must have a step of 1, not {value!r}")
        return f"{value.start}..{value.stop}"
    if isinstance(value, (Iterable,)) and not isinstance(value, (bytes, Mapping)):
        parts = [text(name, part) for part in value]
        return ("," if name != "image_to_probe" else " ").join(parts)
    raise TypeError(
        f"{name}: must be a number, text or several numbers, not {type(value).__name__}"
    )


def memory_gib(value: float | str | None) -> float | None:
    """Return a memory limit in GiB, from a number of GiB or a text such as 8GiB or 512MiB."""
    if not isinstance(value, str):
        return value
    for unit, factor in (("GiB", 1.0), ("MiB", 1.0 / 1024)):
        if value.endswith(unit):
            try:
                return float(value.removesuffix(unit)) * factor
            except ValueError:
                break
    raise InputError(
        f"memory: must be a number of GiB, or text such as '8GiB' or '512MiB', not {value!r}"
    )


def _array(name: str, value: Any) -> npt.NDArray[Any]:
    array = np.asarray(value)
    if array.dtype.kind not in "uif":
        raise TypeError(f"{name}: must be an array of numbers, not of {array.dtype}")
    return array


def frames(name: str, value: Any, dimensions: int) -> npt.NDArray[Any]:
    """Return frames as a C-contiguous array in native byte order.

    Floating-point frames of other sizes become float32, as the command line reads them.
    """
    array = _array(name, value)
    if array.ndim != dimensions or 0 in array.shape[-2:]:
        form = "(N, height, width)" if dimensions == 3 else "(height, width)"
        raise InputError(f"{name}: must have the shape {form}, not {array.shape}")
    native = array.dtype if array.dtype.isnative else array.dtype.newbyteorder("=")
    if native.char not in _PIXELS:
        types = ", ".join(_PIXELS.values())
        raise TypeError(f"{name}: must be of type {types}, not {array.dtype}; use astype")
    return np.ascontiguousarray(array, dtype=native)


def poses(name: str, value: Any, dimensions: int) -> npt.NDArray[np.float64]:
    """Return poses as a C-contiguous array of float64, each finite and affine."""
    array = _array(name, value)
    if array.ndim != dimensions or array.shape[-2:] != (4, 4):
        form = "(N, 4, 4)" if dimensions == 3 else "(4, 4)"
        raise InputError(f"{name}: must have the shape {form}, not {array.shape}")
    matrices = np.ascontiguousarray(array, dtype=np.float64)
    if dimensions == 2:
        # Sixteen numbers of Python cost less than four calls of NumPy.
        rows = matrices.ravel().tolist()
        if math.isfinite(sum(rows)) and rows[12:] == [0.0, 0.0, 0.0, 1.0]:
            return matrices
    if not np.isfinite(matrices).all():
        at = np.argwhere(~np.isfinite(matrices))[0].tolist()
        raise InputError(f"{name}: must be finite, and is {matrices[tuple(at)]} at {at}")
    if not (matrices[..., 3, :] == (0.0, 0.0, 0.0, 1.0)).all():
        raise InputError(f"{name}: the last row must be 0 0 0 1; column vectors are transformed")
    return matrices


def time(name: str, value: Any) -> float | None:
    """Return a time as a finite number, or None."""
    if type(value) is float and math.isfinite(value):
        return value
    seconds = None if value is None else times(name, np.atleast_1d(np.asarray(value)), 1)
    return None if seconds is None else seconds[0]


def times(name: str, value: Any, count: int) -> list[float] | None:
    """Return times as a list of finite numbers, or None."""
    if value is None:
        return None
    array = _array(name, value)
    if array.shape != (count,):
        raise InputError(f"{name}: must have the shape ({count},), not {array.shape}")
    seconds = array.astype(np.float64)
    if not np.isfinite(seconds).all():
        raise InputError(f"{name}: must be finite")
    return [float(second) for second in seconds]


def path(name: str, value: Any) -> str:
    """Return a path as text."""
    if not isinstance(value, (str, os.PathLike)):
        raise TypeError(f"{name}: must be a path, not {type(value).__name__}")
    text = os.fspath(value)
    if not isinstance(text, str) or not text or "\0" in text:
        raise InputError(f"{name}: must be a path of a file, not {text!r}")
    return text
