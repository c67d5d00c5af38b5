"""Pictures of volumes larger than memory, rendered by the processes of a cluster.

A task renders one part of the volume: it reads the chunks of its part, and returns the blocks of
the rays there. It depends on the volume and the settings only, so that a task whose worker died
runs again, to the same bytes. The caller composites the parts.
"""

from __future__ import annotations

import os
import pathlib
from collections.abc import Sequence as SequenceOf
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _arguments as check
from ._render import _size
from ._sonoweave import composite, render_part
from .errors import InputError

__all__ = ["render"]


def render(
    path: str | os.PathLike[str],
    *,
    client: Any = None,
    parts: int = 8,
    fold: bool = False,
    mode: str | None = None,
    view: SequenceOf[float] | None = None,
    size: tuple[int, int] | None = None,
    window: tuple[float, float] | None = None,
    transfer: str | None = None,
    threads: int | None = 1,
    **settings: Any,
) -> npt.NDArray[np.uint8]:
    """Render an OME-Zarr volume, one part a task of Dask.

    The picture has the same bits as ``sonoweave.render(path)``, for any number of parts.

    Parameters
    ----------
    path : path
        OME-Zarr folder (.ome.zarr), which all workers have.
    client : distributed.Client, optional
        The cluster. By default that which Dask uses: the last client, or else threads of this
        process.
    parts : int
        Parts of the volume, cut across its z axis.
    fold : bool
        Whether each task composites the blocks of a ray, so that it returns fewer bytes. The
        picture then differs by at most a grey level. For 100 parts and more.
    mode : str, optional
        Rendering mode: ``shaded``, ``opacity``, ``mip``, ``average``, ``iso``.
    view : two or three floats, optional
        Azimuth, elevation and roll, degrees. By default oblique, with the probe on top.
    size : two ints, optional
        Width and height, pixels. By default 512×512.
    window : two floats, optional
        Grey values that are black and white. By default those of the scanner's frames. Give them
        for another program's volume of single precision, or each task reads all of it.
    transfer : str, optional
        Opacity and colour of grey values: a preset (``tissue``, ``bone``, ``surface``, ``xray``,
        ``phantom``) or a file, which all workers have.
    threads : int, optional
        Threads of a task; any number gives the same picture.
    **settings : Any
        Further flags of the command ``sonoweave render``, with ``_`` for ``-``: ``level``,
        ``max_memory`` (of a task, GiB), ``perspective``, ``background``, and the others.

    Returns
    -------
    array of uint8, shape (height, width, 4)
        Red, green, blue over the background, and opacity 255.

    Raises
    ------
    InputError
        A setting does not fit, or the volume cannot be read.

    Examples
    --------
    >>> import numpy as np, sonoweave, sonoweave.dask, tempfile
    >>> frames = np.full((5, 16, 16), 90, np.uint8)
    >>> poses = np.stack([np.eye(4)] * 5)
    >>> poses[:, 2, 3] = range(5)
    >>> sweep = sonoweave.Sequence.from_arrays(frames, poses)
    >>> reconstructor = sonoweave.Reconstructor(spacing=1.0, clip="none")
    >>> _ = reconstructor.insert_all(sweep)
    >>> path = tempfile.mkdtemp() + "/volume.ome.zarr"
    >>> _ = reconstructor.snapshot().write(path)
    >>> picture = sonoweave.dask.render(path, parts=2, mode="mip", size=(64, 48))
    >>> bool((picture == sonoweave.render(path, mode="mip", size=(64, 48))).all())
    True
    """
    from dask.base import compute
    from dask.delayed import delayed

    if parts < 1:
        raise InputError(f"parts: must be 1 or more, not {parts}")
    folder = os.fspath(pathlib.Path(path).resolve())
    given = {"mode": mode, "view": view, "window": window, "transfer": transfer}
    look = check.keywords(given | {"image_size": _size(size), "threads": threads} | settings)
    task = delayed(render_part, pure=False)
    tasks = [task(folder, part + 1, parts, fold, look) for part in range(parts)]
    if client is None:
        messages = compute(*tasks)
    else:
        messages = client.gather(client.compute(tasks))
    return composite(folder, list(messages), look)
