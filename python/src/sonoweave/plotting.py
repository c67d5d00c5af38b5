"""Plots by matplotlib, which is imported when it is needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ._render import section
from ._sequence import Sequence
from ._volume import Volume

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot", "residuals"]


def residuals(sequence: Sequence, volume: Volume, *, every: int = 1) -> npt.NDArray[np.float64]:
    """Return how far frames differ from the volume at their own place.

    Each frame is compared with the voxels nearest to its pixels, where they were seen.

    Parameters
    ----------
    sequence : Sequence
        The sequence.
    volume : Volume
        The volume.
    every : int, optional
        Compare one of so many frames, and one of eight pixels along each axis.

    Returns
    -------
    array of float64, shape (N,)
        Root mean square difference, grey levels; NaN for frames that are not compared or not seen.
    """
    values, weights = volume.values(), volume.weights()
    voxel_from_world = np.linalg.inv(volume.world_from_volume)
    result = np.full(len(sequence), np.nan)
    for at, pose in enumerate(sequence.poses):
        if at % every or not np.isfinite(pose).all():
            continue
        frame = sequence[at].astype(np.float64)
        v, u = np.mgrid[0 : frame.shape[0] : 8, 0 : frame.shape[1] : 8]
        pixels = np.stack([u.ravel(), v.ravel(), np.zeros(u.size), np.ones(u.size)])
        x, y, z = np.rint((voxel_from_world @ pose @ pixels)[:3]).astype(np.int64)
        nz, ny, nx = volume.shape
        inside = (x >= 0) & (x < nx) & (y >= 0) & (y < ny) & (z >= 0) & (z < nz)
        x, y, z = x[inside], y[inside], z[inside]
        grey = frame[v.ravel()[inside], u.ravel()[inside]]
        seen = weights[z, y, x] > 0
        if seen.any():
            result[at] = np.sqrt(np.mean((values[z, y, x][seen] - grey[seen]) ** 2))
    return result


def plot(sequence: Sequence, volume: Volume, *, every: int = 5) -> Figure:
    """Plot the path of the frames, planes through the volume, and the residuals.

    Parameters
    ----------
    sequence : Sequence
        The sequence.
    volume : Volume
        The volume.
    every : int, optional
        Outline and compare one of so many frames.

    Returns
    -------
    matplotlib.figure.Figure
        A figure with three axes: the path in space with outlines of frames, the three planes, and
        the root mean square difference of frames and volume.
    """
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(15, 5), layout="constrained")
    path = figure.add_subplot(1, 3, 1, projection="3d")
    poses, (rows, columns) = sequence.poses, sequence[0].shape
    corners = np.array(
        [[0, columns, columns, 0, 0], [0, 0, rows, rows, 0], [0] * 5, [1] * 5], float
    )
    middle = np.array([columns / 2, 0, 0, 1])
    path.plot(*(poses @ middle)[:, :3].T, color="tab:red", label="middle of the first row")
    for pose in poses[::every]:
        path.plot(*(pose @ corners)[:3], color="tab:blue", linewidth=0.5)
    path.legend()
    path.set(
        xlabel="x, mm",
        ylabel="y, mm",
        zlabel="z, mm",
        title=f"{len(sequence)} frames in {sequence.world}",
    )
    planes = figure.add_subplot(1, 3, 2)
    planes.imshow(section(volume))
    planes.set(title="planes through the volume")
    planes.set_axis_off()
    differences = figure.add_subplot(1, 3, 3)
    differences.plot(residuals(sequence, volume, every=every), ".")
    differences.set(
        xlabel="frame", ylabel="difference to the volume, grey levels (RMS)", title="residuals"
    )
    return figure
