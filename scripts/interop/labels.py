"""Reads label volumes of sonoweave with SimpleITK, pynrrd and nibabel: the same labels at the same
places, with the volume that sonoweave says.

Usage: labels.py SONOWEAVE FOLDER. Writes into the empty folder, and ends with an error at the
first difference.
"""

import json
import subprocess
import sys
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import SimpleITK as sitk

SONOWEAVE, FOLDER = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
SIZE, SPACING, ORIGIN = (48, 40, 36), (0.5, 0.6, 0.7), (-30.0, 12.0, 100.0)
CENTRE, RADIUS = (-18.0, 24.0, 112.0), 7.0
checks = 0


def check(is_right, what):
    global checks
    checks += 1
    if not is_right:
        sys.exit(f"labels: {what}")


def sonoweave(*words):
    run = subprocess.run([str(SONOWEAVE), *words], cwd=FOLDER, capture_output=True, text=True)
    check(run.returncode == 0, f"sonoweave {' '.join(words)}: {run.stderr}")


def write(name, values, direction=np.eye(3)):
    image = sitk.GetImageFromArray(values)
    image.SetSpacing(SPACING), image.SetOrigin(ORIGIN), image.SetDirection(direction.flatten())
    sitk.WriteImage(image, str(FOLDER / name))


def by_itk(path):
    image = sitk.ReadImage(str(path))
    direction = np.array(image.GetDirection()).reshape(3, 3)
    return sitk.GetArrayFromImage(image), direction * np.array(image.GetSpacing()), image.GetOrigin()


def by_pynrrd(path):
    data, header = nrrd.read(str(path))
    names = [header.get(f"Segment{n}_Name") for n in range(2)], [header.get(f"Segment{n}_LabelValue") for n in range(2)]
    check(names == (["region", "unseen"], ["1", "255"]), f"pynrrd finds the segments {names}")
    return data.T, np.array(header["space directions"]).T, header["space origin"]


def by_nibabel(path):
    image = nibabel.load(path)
    affine = np.diag([-1.0, -1.0, 1.0, 1.0]) @ image.affine
    return np.asanyarray(image.dataobj).T, affine[:3, :3], affine[:3, 3]


# A dark ball. Slices above it are unseen, although they have its value.
turn = np.linalg.qr(np.array([[9.0, 2, 1], [-2, 9, 3], [1, -3, 9]]))[0]
turn *= np.sign(np.diag(turn))
voxels = np.stack(np.meshgrid(*[np.arange(n) for n in SIZE], indexing="ij"), axis=-1)
places = (voxels * SPACING) @ turn.T + ORIGIN
centre = np.array([22.0, 20.0, 17.0]) * SPACING @ turn.T + ORIGIN
inside = (np.linalg.norm(places - centre, axis=-1) < RADIUS) | (voxels[..., 2] > 32)
weights = np.where(voxels[..., 2] > 32, 0.0, 1.0).astype("float32")
write("v.mha", np.where(inside, 50, 160).astype("uint8").T, turn)
write("w.mha", weights.T, turn)
seed = ",".join(str(x) for x in centre)
found = {}
for ending, readers in {"nrrd": (by_itk, by_pynrrd), "mha": (by_itk,), "nii.gz": (by_itk, by_nibabel)}.items():
    name = f"r.{ending}"
    sonoweave("region", "v.mha", "--weights", "w.mha", f"--seed={seed}", "--range", "0,105", "-o", name, "--json=r.json")
    said = json.loads((FOLDER / "r.json").read_text())
    for reader in readers:
        labels, axes, origin = reader(FOLDER / name)
        what = f"{reader.__name__} of {name}"
        check(labels.dtype == np.uint8 and set(np.unique(labels)) == {0, 1, 255}, f"{what}: {np.unique(labels)}")
        check(np.array_equal(labels.T == 255, weights == 0), f"{what}: other voxels are unseen")
        check((labels == 1).sum() == said["voxels"], f"{what}: {(labels == 1).sum()} voxels of the region")
        volume = (labels == 1).sum() * abs(np.linalg.det(axes))
        check(abs(volume / said["volume_mm3"] - 1) < 1e-5, f"{what}: {volume} mm³ for {said['volume_mm3']}")
        middle = axes @ np.argwhere(labels.T == 1).mean(axis=0) + origin
        check(np.allclose(middle, centre, atol=0.05), f"{what}: lies at {middle}, not {centre}")
        found[what] = labels
first = next(iter(found.values()))
check(all(np.array_equal(labels, first) for labels in found.values()), "the files have different labels")
ball = 4 / 3 * np.pi * RADIUS**3
check(abs(said["volume_mm3"] - ball) < said["border_error_mm3"], f"{said['volume_mm3']} mm³ for {ball}")

# The same ball by contours.
lines = ['format = "sonoweave-contours"', "version = 1"]
for height in np.linspace(-0.97, 0.97, 10) * RADIUS:
    angles = np.arange(16) * np.pi / 8
    points = np.sqrt(RADIUS**2 - height**2) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    plane = [centre + turn[:, 2] * height, turn[:, 0], turn[:, 1]]
    lines += ["[[contour]]", *(f"{key} = {list(map(float, v))}" for key, v in zip(("origin", "across", "along"), plane))]
    lines.append(f"points = {points.tolist()}")
(FOLDER / "c.toml").write_text("\n".join(lines) + "\n")
sonoweave("contours", "c.toml", "-o", "c.nrrd", "--spacing", "0.4", "--json=c.json")
said = json.loads((FOLDER / "c.json").read_text())
labels, axes, origin = by_itk(FOLDER / "c.nrrd")
middle = axes @ np.argwhere(labels.T == 1).mean(axis=0) + origin
check(np.allclose(middle, centre, atol=0.05), f"the body between contours lies at {middle}, not {centre}")
for volume in ((labels == 1).sum() * 0.4**3, said["mesh"]["volume_mm3"], said["planimetry_mm3"]):
    check(abs(volume / ball - 1) < 0.015, f"{volume} mm³ between contours, for {ball}")

names = f"SimpleITK {sitk.Version.VersionString()}, pynrrd {nrrd.__version__} and nibabel {nibabel.__version__}"
print(f"labels: {checks} checks with {names} passed")
