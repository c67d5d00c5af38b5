"""Checks an OME-Zarr volume with other programs' readers.

Usage: zarr_readers.py VOLUME.ome.zarr CONVERTED.nrrd. Every group must be valid by ome-zarr-models.
zarr-python, tensorstore and ome-zarr must find the same bits, and pynrrd those of level 0 in the
volume that `convert` made of it. Each voxel of a coarser level must lie in the middle of its
children, and have their weighted mean. Ends with an error at the first difference.
"""

import json
import sys
from pathlib import Path

import nrrd
import numpy as np
import tensorstore
import zarr
from ome_zarr.io import parse_url
from ome_zarr.reader import Reader
from ome_zarr_models.v05.image import Image
from ome_zarr_models.v05.image_label import ImageLabel

VOLUME = Path(sys.argv[1]).resolve()
# mm
TOLERANCE = 1e-9


def check(condition, sentence):
    if not condition:
        sys.exit(f"{VOLUME.name}: {sentence}")


def valid_groups():
    """Returns the images of the volume by their folders, after validating each."""
    images = {"": Image.from_zarr(zarr.open_group(VOLUME, mode="r"))}
    images["weight"] = Image.from_zarr(zarr.open_group(VOLUME / "weight", mode="r"))
    if (VOLUME / "labels").exists():
        labels = zarr.open_group(VOLUME / "labels", mode="r").attrs["ome"]["labels"]
        for label in labels:
            group = zarr.open_group(VOLUME / "labels" / label, mode="r")
            images[f"labels/{label}"] = ImageLabel.from_zarr(group)
    return images


def levels(folder):
    """Returns the levels of an image, each as its array and its scale and translation."""
    group = zarr.open_group(VOLUME / folder, mode="r")
    (image,) = group.attrs["ome"]["multiscales"]
    check([axis["unit"] for axis in image["axes"]] == ["millimeter"] * 3, "other units")
    found = []
    for dataset in image["datasets"]:
        scale, translation = dataset["coordinateTransformations"]
        path = f"{folder}/{dataset['path']}".lstrip("/")
        found.append((read(path), np.array(scale["scale"]), np.array(translation["translation"])))
    return found


def read(path):
    """Reads an array by two programs."""
    by_zarr = zarr.open_array(VOLUME / path, mode="r")[...]
    spec = {"driver": "zarr3", "kvstore": {"driver": "file", "path": str(VOLUME / path)}}
    store = tensorstore.open(spec, open=True, read=True).result()
    check(store.domain.labels == ("z", "y", "x"), f"{path} has the axes {store.domain.labels}")
    by_tensorstore = store.read().result()
    check(by_zarr.tobytes() == by_tensorstore.tobytes(), f"{path} differs between the readers")
    check(by_zarr.dtype == by_tensorstore.dtype, f"{path} has two types")
    return by_zarr


def compare_readers(values):
    """Compares the values with those that ome-zarr reads, and pynrrd in the converted volume."""
    (node, *_) = list(Reader(parse_url(VOLUME))())
    check(len(node.data) == len(values), f"ome-zarr finds {len(node.data)} levels")
    for level, (array, *_) in enumerate(values):
        by_ome_zarr = np.asarray(node.data[level])
        check(by_ome_zarr.tobytes() == array.tobytes(), f"level {level} differs in ome-zarr")
    by_nrrd, _ = nrrd.read(sys.argv[2])
    check(by_nrrd.T.tobytes() == values[0][0].tobytes(), f"{sys.argv[2]} has other values")


def cells(array):
    """Returns the 2x2x2 children of each voxel of the next level, with zeros behind the ends."""
    shape = [(n + 1) // 2 * 2 for n in array.shape]
    padded = np.zeros(shape, np.float64)
    padded[tuple(slice(n) for n in array.shape)] = array
    z, y, x = (n // 2 for n in shape)
    children = padded.reshape(z, 2, y, 2, x, 2).transpose(0, 2, 4, 1, 3, 5)
    return children.reshape(z, y, x, 8)


def compare_levels(values, weights, unseen):
    for level in range(1, len(values)):
        finer, coarser = values[level - 1], values[level]
        child_weights = np.maximum(cells(weights[level - 1][0]), 0.0)
        total, mean = child_weights.sum(axis=3), np.zeros(coarser[0].shape)
        products = (child_weights * cells(finer[0])).sum(axis=3)
        np.divide(products, total, out=mean, where=total > 0)
        if coarser[0].dtype.kind == "u":
            mean = np.rint(mean)
        seen = weights[level][0] > 0
        check((seen == (total > 0)).all(), f"level {level}: other voxels are seen than children")
        wrong = np.abs(coarser[0] - mean)[seen].max(initial=0.0)
        most = 1e-6 * np.abs(mean).max(initial=1.0)
        # Sums in another order may round a half to the other side.
        if coarser[0].dtype.kind == "u":
            share = (coarser[0] != mean)[seen].mean() if seen.any() else 0.0
            check(wrong <= 1 and share < 1e-3, f"level {level}: means are off in {share} of voxels")
        else:
            check(wrong <= most, f"level {level}: means are off by {wrong}")
        check((coarser[0][~seen] == unseen).all(), f"level {level}: unseen voxels have values")
        eighth = np.abs(weights[level][0] - total / 8).max(initial=0.0)
        check(eighth <= 1e-6 * total.max(initial=1.0), f"level {level}: weights are off by {eighth}")


def compare_places(values):
    """Compares the world place of voxels at each level with that of their level 0 cells."""
    _, scale, translation = values[0]
    for level, (array, its_scale, its_translation) in enumerate(values):
        for voxel in [np.zeros(3), np.array([1.0, 2.0, 3.0]), np.array(array.shape) - 1.0]:
            middle = voxel * 2**level + (2**level - 1) / 2
            apart = (its_scale * voxel + its_translation) - (scale * middle + translation)
            check(np.abs(apart).max() < TOLERANCE, f"level {level}: {voxel} is off by {apart} mm")


def main():
    images = valid_groups()
    by_folder = {folder: levels(folder) for folder in images}
    values, weights = by_folder[""], by_folder["weight"]
    for folder, found in by_folder.items():
        for one, other in zip(values, found, strict=True):
            same = all((a == b).all() for a, b in zip(one[1:], other[1:], strict=True))
            check(one[0].shape == other[0].shape and same, f"{folder} has other places")
    compare_places(values)
    compare_readers(values)
    unseen = zarr.open_array(VOLUME / "0", mode="r").fill_value
    compare_levels(values, weights, unseen)
    if "labels/seen" in by_folder:
        for level, (seen, *_) in enumerate(by_folder["labels/seen"]):
            check(((weights[level][0] > 0) == (seen == 1)).all(), f"the label's level {level}")
    own = json.loads((VOLUME / "zarr.json").read_text())["attributes"]["sonoweave"]
    first = [own["lattice_index"][axis] for axis in "zyx"]
    print(
        f"{VOLUME.name}: {len(images)} valid images of {len(values)} levels, {values[0][0].dtype}",
        f"{values[0][0].shape}, first lattice index {first}, {int((weights[0][0] > 0).sum())} seen",
    )


main()
