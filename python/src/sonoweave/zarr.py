"""OME-Zarr 0.5 images as data sets of xarray, level by level: pure Python.

``xarray.open_zarr`` refuses such a group, as the levels share the names of their dimensions.
"""

from __future__ import annotations

import dataclasses
import os
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _arguments as check
from .errors import InputError

if TYPE_CHECKING:
    import xarray

__all__ = ["open"]

#: Millimetres of the units of length; an image without units has pixels.
_MM = {
    "millimeter": 1.0,
    "micrometer": 1e-3,
    "nanometer": 1e-6,
    "centimeter": 10.0,
    "meter": 1e3,
    "inch": 25.4,
}
_AXES = ("z", "y", "x")


def open(path: str | os.PathLike[str], level: int = 0) -> xarray.Dataset:
    """Open a level of an OME-Zarr 0.5 image; needs zarr, xarray and dask.

    Volumes of ours have weights, and those of others may lack them. Nothing but the metadata is
    read.

    Parameters
    ----------
    path : path
        Folder of the image, such as ``volume.ome.zarr``.
    level : int, optional
        Level of the pyramid; 0 is the finest, and each has half the voxels of the one before along
        an axis.

    Returns
    -------
    xarray.Dataset
        Lazy variable ``value`` with dimensions z, y, x, a chunk a shard; with it ``weight``, 0 for
        unseen voxels, and the label ``seen``, where the image has them. Coordinates are the
        voxels' centres, mm along the axes from the origin. ``attrs["affines"]["world"]`` maps
        indices (x, y, z, 1) of this level to world mm; ``attrs["sonoweave"]`` has the provenance of
        a volume of ours.

    Raises
    ------
    OSError
        There is no such folder, or it cannot be read.
    InputError
        The folder is no OME-Zarr 0.5 image with three axes of space in mm, or has no such level.
    """
    name = check.path("path", path)
    if isinstance(level, bool) or not isinstance(level, (int, np.integer)):
        raise TypeError(f"level: must be an integer, not {type(level).__name__}")
    import xarray
    import zarr

    if not os.path.isdir(name):
        raise FileNotFoundError(2, "is no folder; give that of an OME-Zarr image", name)
    group: Any
    try:
        group = zarr.open_group(name, mode="r", zarr_format=3)
    except (FileNotFoundError, ValueError, KeyError) as error:
        raise InputError(f"{name}: is no group of Zarr 3: {error}") from None
    image = _Image(name, dict(group.attrs))
    at = image.level(int(level))
    values = _array(name, group, at.path)
    if values.ndim != len(_AXES):
        raise InputError(f"{name}: {at.path} must have three axes, not {values.ndim}")
    variables = {"value": (_AXES, _lazy(values))}
    for kind, folder in (("weight", "weight"), ("seen", "labels/seen")):
        other = group.get(f"{folder}/{at.path}")
        if other is not None:
            if other.shape != values.shape:
                raise InputError(
                    f"{name}: {folder}/{at.path} has the shape {other.shape}, not {values.shape}"
                )
            variables[kind] = (_AXES, _lazy(other))
    coords = {
        axis: (axis, at.origin[a] + at.spacing[a] * np.arange(values.shape[a]), {"units": "mm"})
        for a, axis in enumerate(_AXES)
    }
    attributes: dict[str, Any] = {"affines": {"world": image.world(at)}}
    if image.own:
        attributes["sonoweave"] = image.own
    return xarray.Dataset(variables, coords, attributes)


@dataclasses.dataclass(frozen=True)
class _Level:
    """A level: the path of its array, and the place of its voxels along z, y, x, mm."""

    path: str
    spacing: npt.NDArray[np.float64]
    origin: npt.NDArray[np.float64]


class _Image:
    """The metadata of an image."""

    def __init__(self, name: str, attributes: dict[str, Any]) -> None:
        self._name = name
        ome = attributes.get("ome")
        ome = ome if isinstance(ome, dict) else {}
        version = ome.get("version")
        if version != "0.5":
            found = "has no attributes of OME" if version is None else f"has version {version}"
            raise InputError(f"{name}: must be an image of OME-Zarr 0.5, and {found}")
        self.own: dict[str, Any] = attributes.get("sonoweave") or {}
        try:
            scales = ome["multiscales"][0]
            units = self._units(scales["axes"])
            steps = scales.get("coordinateTransformations", [])
            self._levels = [
                self._level(data["path"], [*data["coordinateTransformations"], *steps], units)
                for data in scales["datasets"]
            ]
        except (KeyError, IndexError, TypeError) as error:
            raise InputError(
                f"{name}: its metadata lack {error}; write it as OME-Zarr 0.5"
            ) from None

    def _units(self, axes: list[dict[str, Any]]) -> npt.NDArray[np.float64]:
        """Check the axes; return their units, mm."""
        names = tuple(axis["name"] for axis in axes)
        if names != _AXES or any(axis.get("type") != "space" for axis in axes):
            raise InputError(
                f"{self._name}: must have the axes z, y, x of space, not {', '.join(names)}; write "
                "one time and one channel as an image"
            )
        units = [str(axis.get("unit")) for axis in axes]
        if any(unit not in _MM for unit in units):
            raise InputError(
                f"{self._name}: its axes must have a unit of length, such as millimeter, not {units}"
            )
        return np.array([_MM[unit] for unit in units])

    def _level(
        self, path: str, steps: list[dict[str, Any]], units: npt.NDArray[np.float64]
    ) -> _Level:
        spacing, origin = units.copy(), np.zeros(3)
        for step in steps:
            kind = step.get("type")
            numbers = np.array(step.get(str(kind), []), np.float64)
            if kind not in ("scale", "translation") or numbers.shape != (3,):
                raise InputError(
                    f"{self._name}: {path} has a transform {kind!r}; it must be a scale or a "
                    "translation by three numbers"
                )
            if kind == "scale":
                spacing, origin = spacing * numbers, origin * numbers
            else:
                origin = origin + numbers * units
        return _Level(path, spacing, origin)

    def level(self, number: int) -> _Level:
        """Return a level by its number."""
        count = len(self._levels)
        if not 0 <= number < count:
            raise InputError(
                f"{self._name}: has the levels 0 to {count - 1}, and no level {number}"
            )
        return self._levels[number]

    def world(self, level: _Level) -> npt.NDArray[np.float64]:
        """Return the matrix from indices (x, y, z, 1) of a level to world mm."""
        matrix = np.eye(4)
        matrix[:3, :3] = np.diag(level.spacing[::-1])
        matrix[:3, 3] = level.origin[::-1]
        turned = self.own.get("world_from_volume")
        if turned is None:
            return matrix
        # It is that of level 0; the scales of other levels stretch its axes.
        factor = (level.spacing / self.level(0).spacing)[::-1]
        rows = np.array(turned, np.float64)[:3]
        matrix[:3, :3] = rows[:, :3] * factor
        matrix[:3, 3] = rows @ [*(factor - 1) / 2, 1.0]
        return matrix


def _array(name: str, group: Any, path: str) -> Any:
    array = group.get(path)
    if array is None or not hasattr(array, "chunks"):
        raise InputError(f"{name}: has no array {path}, which its metadata name")
    return array


def _lazy(array: Any) -> Any:
    """Return an array of dask with a chunk for each file."""
    import dask.array

    # A shard is one file of many chunks; without shards each chunk is one.
    chunks = getattr(array, "shards", None) or array.chunks
    # Without a sample dask would read for it.
    sample = np.empty((0,) * array.ndim, array.dtype)
    return dask.array.from_array(array, chunks=chunks, meta=sample)
