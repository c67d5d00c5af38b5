"""Pictures of volumes."""

from __future__ import annotations

import os
from collections.abc import Sequence as SequenceOf
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _arguments as check
from ._sonoweave import picture
from ._volume import Volume
from .errors import InputError

__all__ = ["render", "section"]


def render(
    volume: Volume | str | os.PathLike[str],
    *,
    weights: str | os.PathLike[str] | None = None,
    mode: str | None = None,
    view: SequenceOf[float] | None = None,
    size: tuple[int, int] | None = None,
    window: tuple[float, float] | None = None,
    transfer: str | None = None,
    threads: int | None = None,
    **settings: Any,
) -> npt.NDArray[np.uint8]:
    """Render a volume, as the command ``sonoweave render`` does.

    All settings are those of the command, with its names, values and defaults.

    Parameters
    ----------
    volume : Volume or path
        The volume, or a file or OME-Zarr folder of one. Chunks of OME-Zarr are read when they are
        needed, so that the volume may exceed the memory; ``max_memory`` is the limit, GiB, and
        ``level`` the level of its pyramid.
    weights : path, optional
        File of the weights, if the volume is a file.
    mode : str, optional
        Rendering mode: ``shaded``, ``opacity``, ``mip``, ``average``, ``iso``.
    view : two or three floats, optional
        Azimuth, elevation and roll, degrees. By default oblique, with the probe on top.
    size : two ints, optional
        Width and height, pixels. By default 512×512.
    window : two floats, optional
        Grey values that are black and white. By default those of the scanner's frames.
    transfer : str, optional
        Opacity and colour of grey values: a preset (``tissue``, ``bone``, ``surface``, ``xray``,
        ``phantom``) or a file.
    threads : int, optional
        Threads; any number gives the same picture. By default one a core.
    **settings : Any
        Further flags of the command, with ``_`` for ``-``: ``perspective``, ``isovalue``,
        ``step``, ``background``, ``draw``, and the others.

    Returns
    -------
    array of uint8, shape (height, width, 4)
        Red, green, blue over the background, and opacity 255.

    Raises
    ------
    InputError
        A setting is unknown or does not fit.

    Examples
    --------
    >>> import numpy as np, sonoweave
    >>> z, y, x = np.mgrid[:20, :20, :20] - 9.5
    >>> ball = sonoweave.Volume.from_arrays(np.where(x**2 + y**2 + z**2 < 60, 200.0, 0.0))
    >>> picture = sonoweave.render(ball, mode="mip", view=(0, 0), size=(64, 48))
    >>> picture.shape, bool(picture[24, 32, 0] > picture[0, 0, 0])
    ((48, 64, 4), True)
    """
    given = {"mode": mode, "view": view, "window": window, "transfer": transfer, "threads": threads}
    return _picture(volume, weights, given | {"image_size": _size(size)} | settings)


def section(
    volume: Volume | str | os.PathLike[str],
    *,
    weights: str | os.PathLike[str] | None = None,
    at: SequenceOf[float] | None = None,
    plane: SequenceOf[float] | None = None,
    size: tuple[int, int] | None = None,
    window: tuple[float, float] | None = None,
    threads: int | None = None,
    **settings: Any,
) -> npt.NDArray[np.uint8]:
    """Draw planes through a volume, as ``sonoweave render --mode slice`` does.

    Parameters
    ----------
    volume : Volume or path
        The volume, or a file or OME-Zarr folder of one, of which the chunks are read that the
        planes meet.
    weights : path, optional
        File of the weights, if the volume is a file.
    at : three floats, optional
        Intersection of the three planes, world mm. By default the centre of the volume.
    plane : floats, optional
        One free plane instead of three: the numbers of the flag ``--plane``.
    size : two ints, optional
        Width and height, pixels. By default 512×512.
    window : two floats, optional
        Grey values that are black and white. By default those of the scanner's frames.
    threads : int, optional
        Threads; any number gives the same picture. By default one a core.
    **settings : Any
        Further flags of the command, with ``_`` for ``-``: ``overlay``, ``draw``, and the others.

    Returns
    -------
    array of uint8, shape (height, width, 4)
        Red, green, blue, and opacity 255; unseen places are blue.

    Raises
    ------
    InputError
        A setting does not fit, or the planes miss the volume.

    Examples
    --------
    >>> import numpy as np, sonoweave
    >>> volume = sonoweave.Volume.from_arrays(np.full((20, 20, 20), 50.0))
    >>> sonoweave.section(volume, at=(10, 10, 10), size=(256, 256)).shape
    (256, 256, 4)
    """
    given = {"mode": "slice", "at": at, "plane": plane, "window": window, "threads": threads}
    return _picture(volume, weights, given | {"image_size": _size(size)} | settings)


def _size(size: tuple[int, int] | None) -> str | None:
    if size is None:
        return None
    numbers = check.text("size", size).split(",")
    if len(numbers) != 2:
        raise InputError(f"size: must be width and height, not {size!r}")
    return "x".join(numbers)


def _picture(
    volume: Volume | str | os.PathLike[str],
    weights: str | os.PathLike[str] | None,
    settings: dict[str, Any],
) -> npt.NDArray[np.uint8]:
    keywords = check.keywords(settings)
    if isinstance(volume, (str, os.PathLike)):
        return picture(volume, weights, keywords)
    if not isinstance(volume, Volume):
        raise TypeError(f"volume: must be a Volume or a path, not {type(volume).__name__}")
    if weights is not None:
        raise InputError("weights: a Volume has its own; leave them out, or give paths")
    return volume._native.picture(keywords)
