"""Volumes and sequences as objects of other packages, which are imported when they are needed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._sequence import Sequence
from ._volume import Volume

if TYPE_CHECKING:
    import nibabel
    import SimpleITK
    import xarray

__all__ = ["sequence_to_xarray", "volume_to_nibabel", "volume_to_sitk", "volume_to_xarray"]

#: Edge of a chunk of a lazy volume, voxels.
CHUNK = 64


class _Weights:
    """The weights of a volume as an array that is read by boxes."""

    ndim = 3
    dtype = np.dtype(np.float32)

    def __init__(self, volume: Volume) -> None:
        self._volume = volume
        self.shape = volume.shape

    def __getitem__(self, key: Any) -> npt.NDArray[np.float32]:
        return self._volume.weights(key)


class _Frames:
    """The frames of a sequence as an array that is read frame by frame."""

    ndim = 3

    def __init__(self, sequence: Sequence) -> None:
        first = sequence[0]
        self._sequence = sequence
        self.dtype = first.dtype
        self.shape = (len(sequence), *first.shape)

    def __getitem__(self, key: Any) -> npt.NDArray[Any]:
        times, *rest = key if isinstance(key, tuple) else (key,)
        if not isinstance(times, slice):
            return np.asarray(self._sequence[times][tuple(rest)])
        frames = [self._sequence[at] for at in range(*times.indices(self.shape[0]))]
        stack = np.stack(frames) if frames else np.empty((0, *self.shape[1:]), self.dtype)
        return stack[(slice(None), *rest)]


def volume_to_xarray(volume: Volume) -> xarray.Dataset:
    """Return a volume as a lazy data set; needs xarray and dask.

    Parameters
    ----------
    volume : Volume
        The volume.

    Returns
    -------
    xarray.Dataset
        Variables ``value`` and ``weight`` with dimensions z, y, x; coordinates in mm along the
        axes, from the origin; ``attrs["affines"]["world"]`` maps indices (x, y, z, 1) to world mm.
    """
    import dask.array
    import xarray

    def lazy(array: Volume | _Weights) -> Any:
        # Without a name and a sample dask would read all voxels for them.
        sample = np.empty((0, 0, 0), array.dtype)
        return dask.array.from_array(array, chunks=CHUNK, asarray=False, name=False, meta=sample)

    coords: dict[str, Any] = {}
    for axis, count in zip("zyx", volume.shape, strict=True):
        place = "xyz".index(axis)
        mm = volume.origin[place] + volume.spacing[place] * np.arange(count)
        coords[axis] = (axis, mm, {"units": "mm"})
    variables = {
        "value": (("z", "y", "x"), lazy(volume)),
        "weight": (("z", "y", "x"), lazy(_Weights(volume))),
    }
    attributes = {"affines": {"world": volume.world_from_volume}, "direction": volume.direction}
    return xarray.Dataset(variables, coords, attributes)


def sequence_to_xarray(sequence: Sequence) -> xarray.Dataset:
    """Return a sequence as a lazy array; needs xarray and dask.

    Parameters
    ----------
    sequence : Sequence
        The sequence.

    Returns
    -------
    xarray.Dataset
        Lazy variable ``frames`` with dimensions time, y, x, a chunk a frame, and
        ``world_from_image``, shape (time, 4, 4); coordinates time in s, y and x in pixels.
    """
    import dask.array
    import xarray

    frames = _Frames(sequence)
    sample = np.empty((0, 0, 0), frames.dtype)
    chunks = (1, *frames.shape[1:])
    lazy = dask.array.from_array(frames, chunks=chunks, asarray=False, name=False, meta=sample)
    variables = {
        "frames": (("time", "y", "x"), lazy),
        "world_from_image": (("time", "to", "from"), sequence.poses),
    }
    coords = {
        "time": ("time", sequence.times, {"units": "s"}),
        "y": ("y", np.arange(frames.shape[1]), {"units": "pixel"}),
        "x": ("x", np.arange(frames.shape[2]), {"units": "pixel"}),
    }
    return xarray.Dataset(variables, coords)


def volume_to_sitk(volume: Volume) -> SimpleITK.Image:
    """Return a volume's values as an image of SimpleITK.

    Parameters
    ----------
    volume : Volume
        The volume.

    Returns
    -------
    SimpleITK.Image
        The image, with origin, spacing and direction.
    """
    import SimpleITK

    image = SimpleITK.GetImageFromArray(volume.values())
    image.SetOrigin(volume.origin)
    image.SetSpacing(volume.spacing)
    image.SetDirection(volume.direction.ravel().tolist())
    return image


def volume_to_nibabel(volume: Volume) -> nibabel.Nifti1Image:
    """Return a volume's values as an image of nibabel.

    NIfTI's world is right, anterior, superior: x and y of the world change their sign, as in our
    NIfTI files.

    Parameters
    ----------
    volume : Volume
        The volume.

    Returns
    -------
    nibabel.Nifti1Image
        The image, with axes x, y, z.
    """
    import nibabel

    affine = np.diag([-1.0, -1.0, 1.0, 1.0]) @ volume.world_from_volume
    return nibabel.Nifti1Image(volume.values().transpose(2, 1, 0), affine)
