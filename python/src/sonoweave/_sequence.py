"""Tracked sequences."""

from __future__ import annotations

import operator
import os
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _arguments as check
from ._sonoweave import Recording
from .errors import InputError

if TYPE_CHECKING:
    import xarray

__all__ = ["Sequence"]


#: Endings of the names of recordings.
_ENDINGS = (".mha", ".mhd", ".nrrd", ".nhdr", ".dcm", ".mcap")


def _file(path: str) -> str:
    """Return the path of a recording; of a folder, that of the only one in it."""
    if not os.path.isdir(path):
        return path
    found = sorted(name for name in os.listdir(path) if name.lower().endswith(_ENDINGS))
    if len(found) != 1:
        names = ", ".join(found[:5]) + (", …" if len(found) > 5 else "")
        held = f"holds {len(found)} recordings ({names})" if found else "holds no recording"
        raise InputError(f"{path}: {held}; give the file, one of {', '.join(_ENDINGS)}")
    return os.path.join(path, found[0])


class Sequence:
    """A recorded sweep: frames with their poses.

    Made by :meth:`open` or :meth:`from_arrays`. Frames of a file are read when they are asked for.

    Examples
    --------
    >>> import numpy as np, sonoweave
    >>> frames = np.zeros((5, 40, 30), np.uint8)
    >>> poses = np.tile(np.diag([0.5, 0.5, 0.5, 1.0]), (5, 1, 1))
    >>> poses[:, 2, 3] = np.arange(5) * 0.5
    >>> sequence = sonoweave.Sequence.from_arrays(frames, poses)
    >>> len(sequence), sequence[0].shape
    (5, (40, 30))
    """

    _native: Recording
    _made: tuple[str, tuple[Any, ...]]

    def __init__(self) -> None:
        raise TypeError("a Sequence is made by Sequence.open or Sequence.from_arrays")

    @classmethod
    def _of(cls, native: Recording, made: tuple[str, tuple[Any, ...]]) -> Sequence:
        self = cls.__new__(cls)
        self._native, self._made = native, made
        return self

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        *,
        config: str | os.PathLike[str] | None = None,
        preset: str | None = None,
        image_to_probe: npt.ArrayLike | None = None,
        world: str | None = None,
        frames: slice | range | str | None = None,
    ) -> Sequence:
        """Open a tracked sequence or a recorded session.

        Of a sequence only the header is read. A session (.mcap) has settings of its own, with
        which :meth:`Reconstructor.insert_all` gives the bits of ``sonoweave replay``; of the
        options it takes ``config`` alone. Its frames are paired with poses, as in its replay, when
        poses, times or status are asked for first.

        Parameters
        ----------
        path : path
            Tracked sequence (.mha, .mhd, .nrrd, .nhdr, .dcm) or session (.mcap), or a folder in
            which one file has such a name.
        config : path, optional
            Calibration: our TOML or a PLUS XML. For a session: another session configuration
            than the recorded one, our TOML.
        preset : str, optional
            Preset of the calibration file, for the scanner's depth during the recording.
        image_to_probe : array of float, shape (4, 4), optional
            Calibration of the probe: maps pixels (u, v, 0) to mm at the sensor.
        world : str, optional
            Frame of reference of the volume. By default Reference if the sequence has one, else
            Tracker.
        frames : slice or range, optional
            Frames to use. By default all.

        Returns
        -------
        Sequence
            The sequence.

        Raises
        ------
        OSError
            The file cannot be read.
        InputError
            The file is damaged, or a setting does not fit. A session has no configuration, or no
            frames. A folder has no such file, or several.
        CalibrationError
            No transforms lead from the image to the world.
        """
        if image_to_probe is not None:
            image_to_probe = check.poses("image_to_probe", image_to_probe, 2).ravel().tolist()
        given = {
            "config": config,
            "preset": preset,
            "image_to_probe": image_to_probe,
            "world": world,
            "frames": frames,
        }
        keywords = check.keywords(given)
        name = _file(check.path("path", path))
        return cls._of(Recording(name, keywords), ("_open", (name, keywords)))

    @classmethod
    def _open(cls, path: str, keywords: list[check.Keyword]) -> Sequence:
        return cls._of(Recording(path, keywords), ("_open", (path, keywords)))

    @classmethod
    def from_arrays(
        cls,
        frames: npt.ArrayLike,
        world_from_image: npt.ArrayLike,
        times: npt.ArrayLike | None = None,
        *,
        name: str = "frames in memory",
    ) -> Sequence:
        """Make a sequence of frames with poses; they are copied.

        Parameters
        ----------
        frames : array of uint8, uint16 or float32, shape (N, height, width)
            Frames: rows away from the probe, columns to the right.
        world_from_image : array of float, shape (N, 4, 4)
            Pose of each frame: maps pixels (u, v, 0, 1), from the first pixel's centre, to world
            mm.
        times : array of float, shape (N,), optional
            Time of each frame, s.
        name : str, optional
            Name for reports.

        Returns
        -------
        Sequence
            The sequence.

        Raises
        ------
        TypeError
            An array has another type.
        InputError
            An array has another shape, or values that are not finite.
        """
        pixels = check.frames("frames", frames, 3)
        poses = check.poses("world_from_image", world_from_image, 3)
        if len(poses) != len(pixels):
            raise InputError(
                f"world_from_image: must have {len(pixels)} poses as frames, not {len(poses)}"
            )
        seconds = check.times("times", times, len(pixels))
        if not isinstance(name, str):
            raise TypeError(f"name: must be text, not {type(name).__name__}")
        native = Recording.of_frames(name, pixels, poses, seconds)
        return cls._of(native, ("_of_frames", (name, pixels.copy(), poses.copy(), seconds)))

    @classmethod
    def _of_frames(
        cls, name: str, pixels: Any, poses: Any, seconds: list[float] | None
    ) -> Sequence:
        return cls._of(
            Recording.of_frames(name, pixels, poses, seconds),
            ("_of_frames", (name, pixels, poses, seconds)),
        )

    def __reduce__(self) -> tuple[Any, tuple[str, tuple[Any, ...]]]:
        """Return what makes it again: path and options, or the arrays."""
        return _make_sequence, self._made

    def __repr__(self) -> str:
        """Return a short description."""
        return f"<sonoweave.Sequence of {len(self)} frames in {self.world}>"

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._native)

    def __getitem__(self, index: int) -> npt.NDArray[Any]:
        """Return a frame, shape (height, width)."""
        try:
            number = operator.index(index)
        except TypeError:
            raise TypeError(
                f"a frame's number must be an integer, not {type(index).__name__}"
            ) from None
        count = len(self)
        if not -count <= number < count:
            raise IndexError(f"frame {number} is not among the {count} frames")
        return self._native.picture(number % count)

    def __iter__(self) -> Iterator[npt.NDArray[Any]]:
        """Iterate over the frames."""
        return (self[number] for number in range(len(self)))

    @property
    def poses(self) -> npt.NDArray[np.float64]:
        """Pose of each frame, world mm from pixels, (N, 4, 4); NaN for frames without a pose."""
        return self._native.poses()[0]

    @property
    def times(self) -> npt.NDArray[np.float64]:
        """Time of each frame, s, (N,); NaN for frames without a pose.

        Times of a session are those of its host's clock.
        """
        return self._native.poses()[1]

    @property
    def status(self) -> list[str]:
        """For each frame ``ok``, or the name of the reason why it has no pose.

        The latter is ``dropped`` for a session's frames that were dropped when it was live.
        """
        return self._native.poses()[2]

    @property
    def world(self) -> str:
        """Name of the frame of reference of the poses."""
        return self._native.world()[0]

    @property
    def route(self) -> str:
        """The transforms from the image to the world, in words."""
        return self._native.world()[1]

    def to_xarray(self) -> xarray.Dataset:
        """Return frames, times and poses as a lazy data set; needs xarray and dask.

        Returns
        -------
        xarray.Dataset
            Lazy variable ``frames`` with dimensions time, y, x, a chunk a frame, and
            ``world_from_image``, shape (time, 4, 4); coordinates time in s, y and x in pixels.
        """
        from .bridges import sequence_to_xarray

        return sequence_to_xarray(self)


def _make_sequence(method: str, arguments: tuple[Any, ...]) -> Sequence:
    made: Sequence = getattr(Sequence, method)(*arguments)
    return made
