"""Exchanges image files in both directions: SimpleITK, VTK, pynrrd and nibabel read files of sonoweave,
and sonoweave reads theirs. Both find the same voxels at the same physical place.

Usage: both_ways.py SONOWEAVE FOLDER. Writes into the empty folder, and ends with an error at the
first difference.
"""

import subprocess
import sys
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import SimpleITK as sitk
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkVersion
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOImage import (
    vtkMetaImageReader,
    vtkMetaImageWriter,
    vtkNIFTIImageReader,
    vtkNIFTIImageWriter,
    vtkNrrdReader,
)

SONOWEAVE, FOLDER = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
# VTK's NRRD reader takes any short first axis for channels.
SIZE = (20, 16, 12)
SPACING = (0.5, 0.75, 1.25)
ORIGIN = (-74.5, 165.625, 29.0)
# A rotation about all three axes, so that all its numbers differ.
ANGLES = (0.3, -0.5, 0.8)
TYPES = ["uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64"]
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])
checks = 0


def sonoweave(*words):
    run = subprocess.run([str(SONOWEAVE), *map(str, words)], cwd=FOLDER, capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"sonoweave {' '.join(map(str, words))}: {run.stderr}")
    return run.stdout


def rotation():
    (cx, cy, cz), (sx, sy, sz) = np.cos(ANGLES), np.sin(ANGLES)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def voxels(kind):
    """Returns voxels by z, y, x. All planes differ, and signed types have negative ones."""
    values = (np.arange(np.prod(SIZE)) * 7 % 101).reshape(SIZE[::-1])
    if np.dtype(kind).kind != "u":
        values = values - 20
    return (values * 1.5 if np.dtype(kind).kind == "f" else values).astype(kind)


def affine(direction, spacing, origin):
    """Returns the transform of voxel indices to LPS mm."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.asarray(direction) * np.asarray(spacing)
    matrix[:3, 3] = origin
    return matrix


PLACE = affine(rotation(), SPACING, ORIGIN)


def check(name, got, wanted, place=None, wanted_place=None, within=1e-9):
    global checks
    got, wanted = np.asarray(got), np.asarray(wanted)
    if got.shape != wanted.shape or not np.array_equal(got, wanted):
        sys.exit(f"{name}: the voxels are others: {got.shape} {got.dtype} instead of {wanted.shape} {wanted.dtype}")
    if place is not None and not np.allclose(place, wanted_place, rtol=0, atol=within):
        sys.exit(f"{name}: lies elsewhere:\n{place}\ninstead of\n{wanted_place}")
    checks += 1


def by_itk(path):
    image = sitk.ReadImage(str(path))
    direction = np.array(image.GetDirection()).reshape(image.GetDimension(), -1)
    if image.GetDimension() != 3:
        return sitk.GetArrayFromImage(image), None
    return sitk.GetArrayFromImage(image), affine(direction, image.GetSpacing(), image.GetOrigin())


def by_pynrrd(path):
    data, header = nrrd.read(str(path))
    directions = np.asarray(header["space directions"], dtype=float)
    directions = directions[~np.isnan(directions).any(axis=1)]
    matrix = np.eye(4)
    matrix[:3, :3] = directions.T
    matrix[:3, 3] = header["space origin"]
    if "right-anterior" in str(header.get("space")):
        matrix = LPS_FROM_RAS @ matrix
    return data.T, matrix


def by_nibabel(path):
    image = nibabel.load(path)
    return np.asanyarray(image.dataobj).T, LPS_FROM_RAS @ image.affine


def vtk_array(image):
    x, y, z = image.GetDimensions()
    return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(z, y, x, -1).squeeze(axis=-1)


def by_vtk(path):
    name = path.name
    reader = vtkNIFTIImageReader() if ".nii" in name else vtkNrrdReader() if name.endswith(("nrrd", "nhdr")) else vtkMetaImageReader()
    reader.SetFileName(str(path))
    reader.Update()
    array, image = vtk_array(reader.GetOutput()), reader.GetOutput()
    if not np.allclose(image.GetSpacing(), SPACING, atol=1e-6):
        sys.exit(f"{name}: VTK finds the spacing {image.GetSpacing()}")
    if ".nii" in name:
        matrix = reader.GetSFormMatrix()
        ras = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
        # The matrix expects indices scaled by the spacing.
        return array, LPS_FROM_RAS @ ras @ np.diag([*SPACING, 1.0]) if np.allclose(np.linalg.norm(ras[:3, :3], axis=0), 1, atol=1e-5) else LPS_FROM_RAS @ ras
    return array, None


def ours_to_others():
    for kind in TYPES:
        source = FOLDER / f"source-{kind}.mha"
        image = sitk.GetImageFromArray(voxels(kind))
        image.SetSpacing(SPACING), image.SetOrigin(ORIGIN), image.SetDirection(rotation().flatten())
        sitk.WriteImage(image, str(source))
        for extension in ["mha", "mhd", "nrrd", "nhdr", "nii", "nii.gz"]:
            for packed in [[], ["--compress"]]:
                path = FOLDER / f"ours-{kind}-{len(packed)}.{extension}"
                sonoweave("convert", source.name, "-o", path.name, *packed)
                within = 1e-4 if "nii" in extension else 1e-9
                readers = [by_itk]
                readers += [by_pynrrd] if extension in ["nrrd", "nhdr"] else []
                readers += [by_nibabel] if "nii" in extension else []
                # VTK's NRRD reader supports no separate gzip file, its MetaImage reader no int8.
                readers += [] if (extension == "nhdr" and packed) or kind == "int8" else [by_vtk]
                for reader in readers:
                    array, place = reader(path)
                    check(f"{path.name} by {reader.__name__}", array, voxels(kind), place, PLACE, within)
    colour = (np.arange(np.prod(SIZE) * 3) * 7 % 251).astype("uint8").reshape(*SIZE[::-1], 3)
    image = sitk.GetImageFromArray(colour, isVector=True)
    image.SetSpacing(SPACING), image.SetOrigin(ORIGIN), image.SetDirection(rotation().flatten())
    sitk.WriteImage(image, str(FOLDER / "colour.mha"))
    for extension in ["mha", "nrrd", "nii"]:
        sonoweave("convert", "colour.mha", "-o", f"ours-colour.{extension}")
        array, place = by_itk(FOLDER / f"ours-colour.{extension}")
        check(f"ours-colour.{extension}", array, colour, place, PLACE, 1e-4)


def back(path, name, wanted, place, within=1e-9):
    """Converts a file by sonoweave, and reads the simplest of its formats."""
    sonoweave("convert", path.name, "-o", "back.mha")
    array, got = by_itk(FOLDER / "back.mha")
    check(name, array, wanted, got, place, within)


def others_to_ours():
    for kind in TYPES:
        values = voxels(kind)
        image = sitk.GetImageFromArray(values)
        image.SetSpacing(SPACING), image.SetOrigin(ORIGIN), image.SetDirection(rotation().flatten())
        for extension in ["mha", "mhd", "nrrd", "nhdr", "nii", "nii.gz"]:
            for packed in [False, True]:
                path = FOLDER / f"itk-{kind}-{packed}.{extension}"
                sitk.WriteImage(image, str(path), packed)
                back(path, path.name, values, PLACE, 1e-4 if "nii" in extension else 1e-9)
        for space, sign in [("left-posterior-superior", np.eye(4)), ("right-anterior-superior", LPS_FROM_RAS)]:
            matrix = sign @ PLACE
            header = {
                "space": space,
                "space directions": matrix[:3, :3].T,
                "space origin": matrix[:3, 3],
                "kinds": ["domain"] * 3,
            }
            for encoding in ["raw", "gzip", "ascii"]:
                path = FOLDER / f"pynrrd-{kind}-{encoding}-{space}.nrrd"
                nrrd.write(str(path), values.T, {**header, "encoding": encoding})
                back(path, path.name, values, PLACE)
            path = FOLDER / f"pynrrd-{kind}-{space}.nhdr"
            nrrd.write(str(path), values.T, {**header, "encoding": "gzip"}, detached_header=True)
            back(path, path.name, values, PLACE)
        for extension in ["nii", "nii.gz"]:
            path = FOLDER / f"nibabel-{kind}.{extension}"
            image = nibabel.Nifti1Image(values.T, LPS_FROM_RAS @ PLACE)
            image.set_sform(image.affine, code="scanner")
            nibabel.save(image, path)
            back(path, path.name, values, PLACE, 1e-4)
            image.set_sform(None, code=0)
            image.set_qform(LPS_FROM_RAS @ PLACE, code="scanner")
            nibabel.save(image, path)
            back(path, f"{path.name} by its quaternion", values, PLACE, 1e-4)
    scaled = nibabel.Nifti1Image(voxels("float32").T, LPS_FROM_RAS @ PLACE)
    scaled.set_data_dtype("int16")
    nibabel.save(scaled, FOLDER / "scaled.nii")
    wanted = np.asanyarray(nibabel.load(FOLDER / "scaled.nii").dataobj).T
    sonoweave("convert", "scaled.nii", "-o", "back.mha")
    array, _ = by_itk(FOLDER / "back.mha")
    if not np.allclose(array, wanted, rtol=1e-6):
        sys.exit("scaled.nii: the scale is lost")
    image = vtkImageData()
    image.SetDimensions(*SIZE), image.SetSpacing(*SPACING), image.SetOrigin(*ORIGIN)
    image.GetPointData().SetScalars(numpy_to_vtk(voxels("int16").ravel(), deep=True))
    for writer, name in [(vtkMetaImageWriter(), "vtk.mha"), (vtkMetaImageWriter(), "vtk.mhd"), (vtkNIFTIImageWriter(), "vtk.nii")]:
        writer.SetFileName(str(FOLDER / name)), writer.SetInputData(image)
        writer.Write()
        # VTK's NIfTI writer ignores the origin; ITK reads the position that the file has.
        array, place = by_itk(FOLDER / name)
        back(FOLDER / name, name, voxels("int16"), place, 1e-4)


def sequences():
    sonoweave("phantom", "-o", "sweep.igs.mha", "--frames", 7, "--image-size", "20x16", "--pixel", 0.5)
    wanted, _ = by_itk(FOLDER / "sweep.igs.mha")
    text = (FOLDER / "sweep.igs.mha").read_bytes().split(b"ElementDataFile")[0].decode()
    fields = dict(line.split(" = ", 1) for line in text.splitlines())
    matrix = fields["Seq_Frame0003_ImageToReferenceTransform"]
    for packed in [[], ["--compress"]]:
        sonoweave("convert", "sweep.igs.mha", "-o", "ours.igs.mhd", *packed)
        check("ours.igs.mhd", by_itk(FOLDER / "ours.igs.mhd")[0], wanted)
        for name in ["ours.igs.nrrd", "ours.seq.nrrd", "ours.nhdr"]:
            sonoweave("convert", "sweep.igs.mha", "-o", name, *packed)
            data, header = nrrd.read(str(FOLDER / name))
            check(name, data.reshape(20, 16, 7).T, wanted)
            if header["Seq_Frame0003_ImageToReferenceTransform"] != matrix:
                sys.exit(f"{name}: the transform of frame 3 is {header['Seq_Frame0003_ImageToReferenceTransform']}")
            sonoweave("convert", name, "-o", "back.igs.mha")
            check(f"{name} and back", by_itk(FOLDER / "back.igs.mha")[0], wanted)
    header = nrrd.read_header(str(FOLDER / "ours.seq.nrrd"))
    times = [float(fields[f"Seq_Frame{n:04}_Timestamp"]) for n in range(7)]
    if [float(t) for t in header["axis 3 index values"].split()] != times:
        sys.exit(f"ours.seq.nrrd: the index is {header['axis 3 index values']}")
    # The order of 3D Slicer's older versions: the list first.
    listed = {
        "space": "left-posterior-superior",
        "kinds": ["list", "domain", "domain", "domain"],
        "space directions": np.vstack([[np.nan] * 3, np.eye(3)]),
        "space origin": [0, 0, 0],
        "labels": ["time", "", "", ""],
        "axis 0 index type": "numeric",
        "axis 0 index values": " ".join(str(t) for t in times),
    }
    for encoding in ["raw", "gzip"]:
        nrrd.write(str(FOLDER / "slicer.seq.nrrd"), wanted.reshape(7, 1, 16, 20).transpose(0, 3, 2, 1), {**listed, "encoding": encoding})
        sonoweave("convert", "slicer.seq.nrrd", "-o", "back.igs.mha")
        check(f"slicer.seq.nrrd {encoding}", by_itk(FOLDER / "back.igs.mha")[0], wanted)
        if f"Seq_Frame0006_Timestamp = {times[6]}\n".encode() not in (FOLDER / "back.igs.mha").read_bytes():
            sys.exit("slicer.seq.nrrd: the times are lost")
    # Samples of a tracker, without pictures: others can read only the header.
    eye = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
    (FOLDER / "tracker.mha").write_text(
        "NDims = 3\nDimSize = 0 0 2\nKinds = domain domain list\nElementType = MET_UCHAR\n"
        + "".join(f"Seq_Frame{n:04}_ProbeToTrackerTransform = {eye}\n" for n in range(2))
        + "ElementDataFile = LOCAL\n"
    )
    sonoweave("convert", "tracker.mha", "-o", "tracker.igs.nrrd")
    header = nrrd.read_header(str(FOLDER / "tracker.igs.nrrd"))
    if list(header["sizes"]) != [0, 0, 2] or header["Seq_Frame0001_ProbeToTrackerTransform"] != eye:
        sys.exit("tracker.igs.nrrd: the samples are lost")


ours_to_others()
others_to_ours()
sequences()
print(
    f"interop: {checks} files are the same by SimpleITK {sitk.Version.VersionString()}, VTK {vtkVersion.GetVTKVersion()}, "
    f"pynrrd {nrrd.__version__} and nibabel {nibabel.__version__}"
)
