"""Compares the messages that clients received with the file that the session saved: the same voxels
are at the same place, and slices show the volume where they lie.

    python check.py FOLDER…    each with saved/volume-001.mha and the files of peer or watch.py
"""

import sys
from pathlib import Path

import numpy as np
import SimpleITK as sitk


def of_text(path):
    """Reads an image of the reference library: its middle, unit directions and steps."""
    size, spacing, *rows = [np.array(line.split(), float) for line in path.read_text().splitlines()]
    place = np.eye(4)
    place[:3] = rows
    place[:3, :3] *= spacing
    place[:3, 3] -= place[:3, :3] @ (size - 1) / 2
    values = np.fromfile(path.with_suffix(".raw"), np.uint8).reshape(size.astype(int)[::-1])
    return place, values


def received(folder):
    if (folder / "pyigtl.npz").exists():
        kept = np.load(folder / "pyigtl.npz")
        return [(kept["place"], kept["values"])], list(zip(kept["slice_places"], kept["slice_values"], strict=True))
    every = lambda name: [of_text(path) for path in sorted(folder.glob(f"{name}-*.txt"))]
    return every("volume"), every("slice")


for folder in map(Path, sys.argv[1:]):
    volumes, slices = received(folder)
    saved = sitk.ReadImage(str(folder / "saved/volume-001.mha"))
    values = sitk.GetArrayFromImage(saved)
    corners = [[0, 0, 0], [n - 1 for n in saved.GetSize()], [saved.GetSize()[0] - 1, 0, 0]]
    same = [place for place, other in volumes if other.shape == values.shape and np.array_equal(other, values)]
    assert same, f"{folder}: none of {len(volumes)} volumes is the one that was saved"
    worst = 0.0
    for corner in corners:
        # Our world's coordinates equal ITK's.
        there = np.array(saved.TransformContinuousIndexToPhysicalPoint([float(x) for x in corner]))
        worst = max(worst, np.abs(same[-1] @ [*corner, 1.0] - [*there, 1.0]).max())
    assert worst < 1e-3, f"{folder}: the volume lies {worst} mm off"
    # A slice equals the volume at its place, and differs from it elsewhere.
    index_from_world = np.linalg.inv(same[-1])
    found = []
    for place, pixels in slices:
        v, u = np.mgrid[0 : pixels.shape[1] : 2, 0 : pixels.shape[2] : 2]
        picture = pixels[0][v, u].ravel().astype(float)

        def alike(by):
            world = place @ np.stack([u.ravel(), v.ravel(), np.zeros(u.size), np.ones(u.size)]) + np.array([*by, 0.0])[:, None]
            at = np.rint(index_from_world @ world)[:3].astype(int)
            within = ((at >= 0) & (at < np.array(values.shape[::-1])[:, None])).all(axis=0)
            there = values[at[2, within], at[1, within], at[0, within]].astype(float)
            keep = (there > 0) | (picture[within] > 0)
            return np.corrcoef(there[keep], picture[within][keep])[0, 1] if keep.sum() > 500 else np.nan

        own = alike([0.0] * 3)
        # Shifted within the slice's plane, where the volume was seen too.
        step = 6 * place[:3, 0] / np.linalg.norm(place[:3, 0])
        found.append((own, alike(step), alike(-step)))
    found = np.array([row for row in found if np.isfinite(row[0])])
    assert len(found) >= 3, f"{folder}: {len(found)} slices fell into the volume"
    own, aside = np.median(found[:, 0]), np.nanmedian(found[:, 1:])
    assert own > 0.6 and own > aside + 0.1, f"{folder}: slices look like the volume by {own:.3f} where they lie, by {aside:.3f} 6 mm aside"
    print(f"{folder}: {values.shape[::-1]} voxels are the same, {worst:.1e} mm apart at most; {len(found)} slices look like the volume by {own:.3f} "
          f"where they lie, by {aside:.3f} 6 mm aside")
