"""Reconstruction."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from collections.abc import Sequence as SequenceOf
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _arguments as check
from ._sequence import Sequence
from ._sonoweave import Reconstruction
from ._volume import Volume
from .errors import FrameRefused, InputError

__all__ = ["Reconstructor"]


class Reconstructor:
    """Inserts tracked frames into a volume, as the command ``sonoweave reconstruct`` does.

    All settings are those of the command, with its names, values and defaults: an omitted or None
    setting is the command's default.

    Parameters
    ----------
    spacing : float or three floats, optional
        Distance between voxels, mm. By default the configuration's, else 0.5.
    method : str, optional
        Kernel: ``gaussian``, ``gaussian-truncated``, ``gaussian4``, ``bspline3``, ``linear``, ``nearest``.
    sigma : three floats or "auto", optional
        Kernel σ along u, v and the slice's normal, mm. ``auto``: σ across the plane from the gaps
        between slices, for :meth:`insert_all` alone.
    compound : str, optional
        Compounding: ``mean``, ``maximum``, ``latest``, ``decay``.
    path : str, optional
        Insertion path: ``auto``, ``general``, ``planar``.
    clip : four ints or str, optional
        Image data: a rectangle x, y, width, height in pixels, ``auto`` or ``none``. With ``auto``,
        the default, the first frames wait until the mask is found.
    threads : int, optional
        Threads; any number gives the same volume. By default one a core.
    memory : float or str, optional
        Memory limit for the volume, GiB, or text such as ``"512MiB"``. By default 8 GiB.
    config : path, optional
        Calibration and volume settings: our TOML or a PLUS XML.
    **settings : Any
        Further flags of the command, with ``_`` for ``-``: ``origin``, ``size``, ``fan``,
        ``support``, ``max_weight``, ``decay``, ``departure``, ``simd``, and the others.

    Raises
    ------
    InputError
        A setting is unknown or does not fit.

    Examples
    --------
    >>> import numpy as np, sonoweave
    >>> reconstructor = sonoweave.Reconstructor(spacing=0.5, clip="none", threads=1)
    >>> pose = np.diag([0.5, 0.5, 0.5, 1.0])
    >>> touched = reconstructor.insert(np.full((40, 30), 100, np.uint8), pose, time=0.0)
    >>> touched.shape[1], reconstructor.ledger["frames"]["used"]
    (3, 1)
    >>> round(float(reconstructor.snapshot().values().max()), 3)
    100.0
    """

    def __init__(
        self,
        *,
        spacing: float | SequenceOf[float] | None = None,
        method: str | None = None,
        sigma: SequenceOf[float] | str | None = None,
        compound: str | None = None,
        path: str | None = None,
        clip: SequenceOf[int] | str | None = None,
        threads: int | None = None,
        memory: float | str | None = None,
        config: str | os.PathLike[str] | None = None,
        **settings: Any,
    ) -> None:
        given = {
            "spacing": spacing,
            "method": method,
            "sigma": sigma,
            "compound": compound,
            "path": path,
            "clip": clip,
            "threads": threads,
            "max_memory": check.memory_gib(memory),
            "config": config,
        }
        others = {
            name: value
            for name, value in settings.items()
            if name != "max_memory" or memory is None
        }
        self._native = Reconstruction(check.keywords(given | others))

    def __reduce__(self) -> Any:
        """Refuse to be pickled."""
        raise TypeError(
            "a Reconstructor cannot be pickled, as it has threads; pickle its settings, or a snapshot()"
        )

    def insert(
        self, frame: npt.ArrayLike, world_from_image: npt.ArrayLike, *, time: float | None = None
    ) -> npt.NDArray[np.int32]:
        """Insert a frame.

        Parameters
        ----------
        frame : array of uint8, uint16 or float32, shape (height, width)
            The frame: rows away from the probe, columns to the right. It is copied.
        world_from_image : array of float, shape (4, 4)
            Its pose: maps pixels (u, v, 0, 1), from the first pixel's centre, to world mm.
        time : float, optional
            Its time, s.

        Returns
        -------
        array of int32, shape (n, 3)
            Bricks of 8³ voxels that changed, as lattice indices z, y, x divided by 8. It is empty
            while frames wait for the mask, and then holds the bricks of all of them.

        Raises
        ------
        FrameRefused
            The frame is refused, or, once the mask is found, an earlier one that waited for it.
        TypeError, InputError
            An argument does not fit; the frame is not counted.
        MemoryLimit
            The volume would exceed its memory limit.
        """
        pixels = check.frames("frame", frame, 2)
        pose = check.poses("world_from_image", world_from_image, 2)
        seconds = check.time("time", time)
        touched, refused, _ = self._native.insert(pixels[np.newaxis], pose[np.newaxis], seconds)
        if refused:
            item, reason, sentence = refused[-1]
            raise FrameRefused(sentence, reason, item)
        return touched

    def insert_all(
        self,
        sequence: Sequence,
        *,
        progress: Callable[[int, int], object] | Callable[..., Any] | None = None,
        refused: str = "count",
    ) -> dict[str, Any]:
        """Insert a sequence or a session: the same bits as the command makes of it.

        A session brings its own settings: of the reconstructor's, only ``threads``, ``memory`` and
        ``simd`` may be given, unless something was inserted before. The sessions that it continues
        are inserted before it, and frames are frozen, cleared or dropped as when it was live.

        Other threads of Python run meanwhile. An interrupt, or an exception in ``progress``, ends
        the run after the frames on their way, and is raised; the volume stays valid.

        Parameters
        ----------
        sequence : Sequence
            The sequence.
        progress : callable, optional
            Called with the numbers of finished frames and of all, at most ten times a second; or
            the class ``tqdm``, whose bar is made and closed.
        refused : {"count", "raise"}, optional
            Whether refused frames are counted, or raise after the run.

        Returns
        -------
        dict
            The account of the sequence's frames, as in the command's report.

        Raises
        ------
        InputError
            The settings do not fit the sequence, or no frame could be used.
        FrameRefused
            The first refused frame, with ``refused="raise"``.
        MemoryLimit
            The volume would exceed its memory limit; the frames before are in it.
        """
        if not isinstance(sequence, Sequence):
            raise TypeError(f"sequence: must be a Sequence, not {type(sequence).__name__}")
        if refused not in ("count", "raise"):
            raise InputError(f"refused: must be 'count' or 'raise', not {refused!r}")
        if progress is not None and not callable(progress):
            raise TypeError(f"progress: must be callable, not {type(progress).__name__}")
        bar = None
        call = progress
        if isinstance(progress, type) and hasattr(progress, "update"):
            bar = progress(total=len(sequence))

            def call(done: int, total: int) -> None:
                bar.update(done - bar.n)

        try:
            ledger: dict[str, Any] = json.loads(self._native.insert_all(sequence._native, call))
        finally:
            if bar is not None:
                bar.close()
        if refused == "raise" and ledger["first_refusals"]:
            first = min(ledger["first_refusals"].values(), key=lambda refusal: int(refusal["item"]))
            raise FrameRefused(
                f"frame {first['item']}: {first['detail']}", first["reason"], first["item"]
            )
        return ledger

    def snapshot(self) -> Volume:
        """Return a copy of the present volume, which later frames do not change.

        Frames that wait for the mask are inserted before, by the mask that the frames so far show.

        Returns
        -------
        Volume
            The volume.

        Raises
        ------
        InputError
            No frame was inserted.
        """
        native = self._native.snapshot()
        if native is None:
            raise InputError(
                "the volume is empty; insert frames before, and check the ledger for refused ones"
            )
        return Volume._of(native)

    @property
    def ledger(self) -> dict[str, Any]:
        """The account of all frames so far, as in the command's report."""
        ledger: dict[str, Any] = json.loads(self._native.ledger())
        return ledger
