"""Volumes."""

from __future__ import annotations

import json
import operator
import os
from collections.abc import Sequence as SequenceOf
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _arguments as check
from ._sonoweave import Volume as _Native
from .errors import InputError

if TYPE_CHECKING:
    import nibabel
    import SimpleITK
    import xarray

__all__ = ["Volume"]

Floats = npt.NDArray[np.float32]


class Volume:
    """A volume in memory, which does not change. Arrays have the axes z, y, x.

    Made by :meth:`Reconstructor.snapshot`, :meth:`open` or :meth:`from_arrays`. Unseen voxels have
    value and weight 0. Boxes are copied when they are asked for: ``volume[z0:z1, y0:y1, x0:x1]``.

    Examples
    --------
    >>> import numpy as np, sonoweave
    >>> values = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    >>> volume = sonoweave.Volume.from_arrays(values, spacing=(0.5, 0.5, 1.0), origin=(1, 2, 3))
    >>> volume.shape, volume[1, 2, 1:3].tolist()
    ((2, 3, 4), [21.0, 22.0])
    >>> (volume.world_from_volume @ [1, 1, 1, 1]).tolist()
    [1.5, 2.5, 4.0, 1.0]
    """

    ndim = 3
    dtype = np.dtype(np.float32)

    _native: _Native
    _path: tuple[str, str | None] | None

    def __init__(self) -> None:
        raise TypeError("a Volume is made by Volume.open, Volume.from_arrays or a snapshot")

    @classmethod
    def _of(cls, native: _Native, path: tuple[str, str | None] | None = None) -> Volume:
        self = cls.__new__(cls)
        self._native, self._path = native, path
        return self

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        *,
        weights: str | os.PathLike[str] | None = None,
        memory: float | str | None = None,
    ) -> Volume:
        """Read a volume.

        Parameters
        ----------
        path : path
            File (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, .dcm) or OME-Zarr folder (.ome.zarr).
        weights : path, optional
            File of its weights; an OME-Zarr folder holds them itself.
        memory : float or str, optional
            Memory limit, GiB, or text such as ``"512MiB"``. By default 8 GiB.

        Returns
        -------
        Volume
            The volume.

        Raises
        ------
        OSError
            A file cannot be read.
        InputError
            A file is damaged, or the volume needs more memory.
        """
        beside = None if weights is None else check.path("weights", weights)
        keywords = check.keywords({"max_memory": check.memory_gib(memory)})
        name = check.path("path", path)
        return cls._of(_Native.open(name, beside, keywords), (name, beside))

    @classmethod
    def from_arrays(
        cls,
        values: npt.ArrayLike,
        weights: npt.ArrayLike | None = None,
        *,
        spacing: SequenceOf[float] = (1.0, 1.0, 1.0),
        origin: SequenceOf[float] = (0.0, 0.0, 0.0),
        direction: npt.ArrayLike | None = None,
    ) -> Volume:
        """Make a volume of arrays, which are copied.

        Parameters
        ----------
        values : array of float, shape (z, y, x)
            Grey values. NaN is unseen.
        weights : array of float, shape (z, y, x), optional
            Weights; 0 is unseen. By default 1.
        spacing : three floats, optional
            Distance between voxels along x, y, z, mm.
        origin : three floats, optional
            Position of the first voxel's centre, x, y, z, mm.
        direction : array of float, shape (3, 3), optional
            Columns are the directions of the axes x, y, z. By default the world's.

        Returns
        -------
        Volume
            The volume.

        Raises
        ------
        TypeError
            An array is not of numbers.
        InputError
            An array has another shape, or the grid spans no space.
        """
        return cls._of(_of_arrays(values, weights, spacing, origin, direction, []))

    def __reduce__(self) -> Any:
        """Return what makes it again: path, or values, weights and grid."""
        if self._path is not None:
            return _open, self._path
        values, weights = self.values(), self.weights()
        fields = self._native.fields
        return _make, (values, weights, self.spacing, self.origin, self.direction, fields)

    def __repr__(self) -> str:
        """Return a short description."""
        spacing = "×".join(f"{mm:g}" for mm in self.spacing)
        return f"<sonoweave.Volume (z, y, x) {self.shape}, voxels of {spacing} mm>"

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along z, y, x."""
        z, y, x = self._native.shape
        return z, y, x

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Distance between voxels along x, y, z, mm."""
        x, y, z = self._native.spacing
        return x, y, z

    @property
    def origin(self) -> tuple[float, float, float]:
        """Position of the first voxel's centre, x, y, z, mm."""
        x, y, z = self._native.origin
        return x, y, z

    @property
    def direction(self) -> npt.NDArray[np.float64]:
        """Directions of the axes x, y, z as columns, (3, 3), as in SimpleITK."""
        return np.array(self._native.axes).T

    @property
    def world_from_volume(self) -> npt.NDArray[np.float64]:
        """Maps voxel indices (x, y, z, 1) to world mm, (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.direction * np.array(self.spacing)
        matrix[:3, 3] = self.origin
        return matrix

    @property
    def range(self) -> tuple[float, float]:
        """Values of black and white in the scanner's frames."""
        black, white = self._native.range
        return black, white

    @property
    def ledger(self) -> dict[str, Any] | None:
        """The account of the frames in it; None for a file or arrays."""
        text = self._native.ledger()
        return None if text is None else json.loads(text)

    @property
    def notes(self) -> list[str]:
        """Notes for the user, as sentences."""
        return self._native.notes

    def values(self) -> Floats:
        """Return all values, (z, y, x); 0 for unseen voxels.

        Returns
        -------
        array of float32, shape (z, y, x)
            The values.
        """
        return self._read(self._all())

    def weights(self, box: tuple[slice, slice, slice] | None = None) -> Floats:
        """Return weights, (z, y, x); 0 for unseen voxels.

        Parameters
        ----------
        box : three slices, optional
            The box along z, y, x. By default all.

        Returns
        -------
        array of float32, shape (z, y, x)
            The weights.
        """
        if box is None:
            return self._read(self._all(), weights=True)
        ranges, steps, drop = self._box(box)
        weights: Floats = self._read(ranges, weights=True)[steps][drop]
        return weights

    def __getitem__(self, key: Any) -> Floats:
        """Return the values of a box along z, y, x; integers drop an axis."""
        ranges, steps, drop = self._box(key)
        values: Floats = self._read(ranges)[steps][drop]
        return values

    def __array__(
        self, dtype: npt.DTypeLike | None = None, copy: bool | None = None
    ) -> npt.NDArray[Any]:
        """Return all values; a volume has no view, so that ``copy=False`` is refused."""
        if copy is False:
            raise ValueError("a volume is stored in bricks, of which an array is always a copy")
        values = self.values()
        return values if dtype is None else values.astype(dtype, copy=False)

    def write(
        self,
        path: str | os.PathLike[str],
        *,
        weights: str | os.PathLike[str] | None = None,
        **settings: Any,
    ) -> dict[str, Any] | None:
        """Write the volume in the format of the name, as the command ``reconstruct`` does.

        Parameters
        ----------
        path : path
            File (.mha, .mhd, .nrrd, .nhdr, .nii, .nii.gz, .dcm), or OME-Zarr folder (.ome.zarr).
        weights : path, optional
            File of the weights.
        **settings : Any
            Flags of the command for its outputs, with ``_`` for ``-``: ``type``, ``window``,
            ``unseen``, ``first_moment``, ``fill``, ``fill_radius``, ``planes``, ``error``, and those
            of DICOM. The standard errors of ``error`` need the same keyword where the volume was
            reconstructed. A volume of a file has none.

        Returns
        -------
        dict or None
            The command's report; None for a volume of a file or arrays.

        Raises
        ------
        OSError
            A file cannot be written; an earlier one is unchanged.
        InputError
            A setting does not fit.
        """
        beside = None if weights is None else check.path("weights", weights)
        name = check.path("path", path)
        for target in (name, beside):
            folder = os.path.dirname(target or "")
            if folder and not os.path.isdir(folder):
                raise FileNotFoundError(
                    2, "the folder does not exist; make it, or give another name", target
                )
        report = self._native.write(name, check.keywords(settings), beside)
        return None if report is None else json.loads(report)

    def to_xarray(self) -> xarray.Dataset:
        """Return values and weights with coordinates in mm; needs xarray and dask.

        Returns
        -------
        xarray.Dataset
            Lazy variables ``value`` and ``weight`` with dimensions z, y, x; coordinates in mm along
            the axes; ``attrs["affines"]["world"]`` maps indices (x, y, z, 1) to world mm.
        """
        from .bridges import volume_to_xarray

        return volume_to_xarray(self)

    def to_sitk(self) -> SimpleITK.Image:
        """Return the values as an image of SimpleITK, with origin, spacing and direction.

        Returns
        -------
        SimpleITK.Image
            The image.
        """
        from .bridges import volume_to_sitk

        return volume_to_sitk(self)

    def to_nibabel(self) -> nibabel.Nifti1Image:
        """Return the values as an image of nibabel, with axes x, y, z.

        NIfTI's world is right, anterior, superior: x and y of the world change their sign, as in
        our NIfTI files.

        Returns
        -------
        nibabel.Nifti1Image
            The image.
        """
        from .bridges import volume_to_nibabel

        return volume_to_nibabel(self)

    def _all(self) -> list[list[int]]:
        return [[0, n] for n in self.shape]

    def _read(self, ranges: list[list[int]], *, weights: bool = False) -> Floats:
        return self._native.read(ranges, weights)

    def _box(self, key: Any) -> tuple[list[list[int]], tuple[slice, ...], tuple[Any, ...]]:
        """Return the ranges to read, the steps within them, and the axes to drop."""
        parts = key if isinstance(key, tuple) else (key,)
        dots = [at for at, part in enumerate(parts) if part is Ellipsis]
        if len(dots) > 1 or len(parts) - len(dots) > 3:
            raise IndexError(f"a volume has three axes (z, y, x), not those of {key!r}")
        for at in dots:
            parts = parts[:at] + (slice(None),) * (4 - len(parts)) + parts[at + 1 :]
        parts = parts + (slice(None),) * (3 - len(parts))
        ranges: list[list[int]] = []
        steps: list[slice] = []
        drop: list[Any] = []
        for part, count in zip(parts, self.shape, strict=True):
            if isinstance(part, slice):
                places = range(*part.indices(count))
                low, high = (min(places), max(places) + 1) if places else (0, 0)
                ranges.append([low, high])
                steps.append(slice(None, None, places.step))
                drop.append(slice(None))
                continue
            try:
                place = operator.index(part)
            except TypeError:
                raise IndexError(f"indices must be integers or slices, not {part!r}") from None
            if not -count <= place < count:
                raise IndexError(f"voxel {place} is not among {count}")
            ranges.append([place % count, place % count + 1])
            steps.append(slice(None))
            drop.append(0)
        return ranges, tuple(steps), tuple(drop)


def _of_arrays(
    values: Any,
    weights: Any,
    spacing: Any,
    origin: Any,
    direction: Any,
    fields: list[tuple[str, str]],
) -> _Native:
    grey = _voxels("values", values)
    heavy = None if weights is None else _voxels("weights", weights)
    if heavy is not None and heavy.shape != grey.shape:
        raise InputError(
            f"weights: must have the shape of the values, {grey.shape}, not {heavy.shape}"
        )
    axes = _numbers("direction", np.eye(3) if direction is None else direction, (3, 3)).T
    mm = _numbers("spacing", spacing, (3,))
    if not (mm > 0).all():
        raise InputError(f"spacing: must be positive, not {mm.tolist()}")
    at = _numbers("origin", origin, (3,))
    return _Native.of_arrays(grey, heavy, mm.tolist(), at.tolist(), axes.tolist(), fields)


def _voxels(name: str, value: Any) -> Floats:
    array = np.asarray(value)
    if array.dtype.hasobject or array.dtype.kind not in "uif":
        raise TypeError(f"{name}: must be an array of numbers, not of {array.dtype}")
    if array.ndim != 3 or 0 in array.shape:
        raise InputError(f"{name}: must have the shape (z, y, x), not {array.shape}")
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(array, dtype=np.float32)


def _numbers(name: str, value: Any, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    array = np.asarray(value)
    if array.dtype.hasobject or array.dtype.kind not in "uif":
        raise TypeError(f"{name}: must be numbers, not {array.dtype}")
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{name}: must be finite and of the shape {shape}, not {array.tolist()}")
    return array.astype(np.float64)


def _open(path: str, weights: str | None) -> Volume:
    return Volume.open(path, weights=weights)


def _make(
    values: Any, weights: Any, spacing: Any, origin: Any, direction: Any, fields: Any
) -> Volume:
    return Volume._of(_of_arrays(values, weights, spacing, origin, direction, fields))
