"""Reads the DICOM files of scripts/interop/dicom.sh with pydicom, and compares voxels, pixels, places
and identifiers with the MetaImage files beside them.
"""

import sys
from pathlib import Path

import numpy
import pydicom

TYPES = {"MET_UCHAR": "u1", "MET_USHORT": "<u2"}


def metaimage(path):
    """Returns header fields and voxels (slices, rows, columns) of a raw MetaImage file."""
    data = path.read_bytes()
    at = data.index(b"ElementDataFile = LOCAL\n") + len(b"ElementDataFile = LOCAL\n")
    fields = dict(line.split(" = ", 1) for line in data[:at].decode().splitlines())
    size = [int(n) for n in fields["DimSize"].split()]
    return fields, numpy.frombuffer(data[at:], TYPES[fields["ElementType"]]).reshape(size[::-1])


def numbers(text):
    return numpy.array([float(x) for x in text.split()])


def volume(folder, name):
    image = pydicom.dcmread(folder / f"{name}.dcm")
    fields, voxels = metaimage(folder / f"{name}.mha")
    assert image.SOPClassUID == "1.2.840.10008.5.1.4.1.1.6.2", image.SOPClassUID
    assert numpy.array_equal(image.pixel_array, voxels), f"{name}: other voxels"
    assert voxels.max() > 0 and voxels.min() < voxels.max()
    spacing, origin = numbers(fields["ElementSpacing"]), numbers(fields["Offset"])
    axes = numbers(fields["TransformMatrix"]).reshape(3, 3)
    shared = image.SharedFunctionalGroupsSequence[0]
    along = numpy.array(shared.PlaneOrientationVolumeSequence[0].ImageOrientationVolume).reshape(2, 3)
    rows, columns = (float(mm) for mm in shared.PixelMeasuresSequence[0].PixelSpacing)
    # The place of any voxel by DICOM's rule and by ITK's.
    for x, y, z in [(0, 0, 0), (5, 3, 2), (1, 7, voxels.shape[0] - 1)]:
        frame = image.PerFrameFunctionalGroupsSequence[z]
        first = numpy.array(frame.PlanePositionVolumeSequence[0].ImagePositionVolume)
        ours = first + along[0] * columns * x + along[1] * rows * y
        theirs = origin + (numpy.array([x, y, z]) * spacing) @ axes
        assert numpy.abs(ours - theirs).max() < 1e-9, f"{name}: voxel {x, y, z} at {ours}, not {theirs}"
    print(f"{name}.dcm: {voxels.size} voxels of {voxels.dtype}, the same, in the same places")
    return image


def region(folder):
    image = pydicom.dcmread(folder / "region.dcm")
    fields, labels = metaimage(folder / "region.mha")
    assert image.SOPClassUID == "1.2.840.10008.5.1.4.1.1.66.4", image.SOPClassUID
    assert (image.Modality, image.SegmentationType, image.BitsAllocated) == ("SEG", "BINARY", 1)
    planes = [z for z in range(len(labels)) if (labels[z] == 1).any()]
    pixels = image.pixel_array.reshape(-1, image.Rows, image.Columns)
    assert set(numpy.unique(labels)) <= {0, 1, 255} and 0 < len(planes) == image.NumberOfFrames
    assert numpy.array_equal(pixels, labels[planes] == 1), "region: other voxels"
    spacing, origin = numbers(fields["ElementSpacing"]), numbers(fields["Offset"])
    axes = numbers(fields["TransformMatrix"]).reshape(3, 3)
    shared = image.SharedFunctionalGroupsSequence[0]
    along = numpy.array(shared.PlaneOrientationSequence[0].ImageOrientationPatient, float).reshape(2, 3)
    rows, columns = (float(mm) for mm in shared.PixelMeasuresSequence[0].PixelSpacing)
    for n, z in enumerate(planes):
        frame = image.PerFrameFunctionalGroupsSequence[n]
        corner = numpy.array(frame.PlanePositionSequence[0].ImagePositionPatient, float)
        ours, theirs = origin + numpy.array([5, 7, z]) * spacing @ axes, corner + along.T @ [5 * columns, 7 * rows]
        assert numpy.abs(ours - theirs).max() < 1e-6, f"region: plane {z} at {theirs}, not {ours}"
    print(f"region.dcm: {(pixels == 1).sum()} voxels in {len(planes)} planes, the same, in the same places")
    return image


def brightest(path):
    """Prints the place of the brightest voxel."""
    fields, voxels = metaimage(path)
    voxel = numpy.array(numpy.unravel_index(voxels.argmax(), voxels.shape))[::-1]
    axes = numbers(fields["TransformMatrix"]).reshape(3, 3)
    place = numbers(fields["Offset"]) + voxel * numbers(fields["ElementSpacing"]) @ axes
    print(",".join(map(str, place.tolist())))


def sweep(folder):
    image = pydicom.dcmread(folder / "sweep.dcm")
    fields, pixels = metaimage(folder / "sweep.mha")
    assert image.SOPClassUID == "1.2.840.10008.5.1.4.1.1.3.1", image.SOPClassUID
    assert numpy.array_equal(image.pixel_array, pixels), "sweep: other pixels"
    own = image.private_block(0x0009, "SONOWEAVE")
    poses = numpy.frombuffer(own[0x01].value, "<f8").reshape(-1, 4, 4)
    assert len(poses) == len(pixels) == image.NumberOfFrames
    for frame, pose in enumerate(poses):
        # The sequence's fields of the same frame.
        names = [f"Seq_Frame{frame:04}_{name}Transform" for name in ("ImageToReference", "ImageToWorld", "ImageToTracker")]
        given = next(numbers(fields[name]).reshape(4, 4) for name in names if name in fields)
        assert numpy.abs(pose[:, [0, 1, 3]] - given[:, [0, 1, 3]]).max() < 1e-6, (frame, pose, given)
    assert own[0x05].value.split("\n") == ["OK"] * len(poses)
    steps = numpy.array([float(ms) for ms in image.FrameTimeVector])
    times = numpy.array([float(fields[f"Seq_Frame{frame:04}_Timestamp"]) for frame in range(len(pixels))])
    assert numpy.abs(steps[1:] - 1e3 * numpy.diff(times)).max() < 1e-3 and steps[0] == 0
    assert numpy.array_equal(numpy.frombuffer(own[0x03].value, "<f8"), times), "sweep: other times"
    region = image.SequenceOfUltrasoundRegions[0]
    lengths = numpy.linalg.norm(poses[0][:3, :2], axis=0)
    assert numpy.abs(numpy.array([region.PhysicalDeltaX, region.PhysicalDeltaY]) - 0.1 * lengths).max() < 1e-9
    print(f"sweep.dcm: {len(pixels)} frames, the same, with their times, scale and poses")
    return image


def read_back(folder, name):
    """Compares a file that we have read back with the original, to the bit."""
    (first, pixels), (back, again) = (metaimage(folder / f"{name}{end}.mha") for end in ("", "-back"))
    assert numpy.array_equal(pixels, again), f"{name}: other pixels came back"
    for field in ("ElementSpacing", "Offset", "TransformMatrix", "SonoweaveUnseen", "SonoweaveRange"):
        if name != "sweep":
            assert back[field] == first[field], (name, field, back[field], first[field])
    for field in (field for field in first if field.endswith(("ImageToReferenceTransform", "Timestamp"))):
        assert back[field] == first[field], (name, field, back[field], first[field])
    print(f"{name}.dcm: read back by us, the same bits")


def main():
    folder = Path(sys.argv[1])
    for name in ("volume", "turned", "sweep"):
        read_back(folder, name)
    images = [volume(folder, "volume"), sweep(folder)]
    turned, seg = volume(folder, "turned"), region(folder)
    for name in ("StudyInstanceUID", "FrameOfReferenceUID"):
        assert seg[name].value == turned[name].value, f"{name} of the region and of its volume"
    for image in images:
        who = (str(image.PatientName), image.PatientID, image.StudyDescription)
        assert who == ("Müller^Jörg", "4711", "Phantom study"), who
    for name in ("StudyInstanceUID", "FrameOfReferenceUID"):
        assert images[0][name].value == images[1][name].value, f"{name} of the volume and of its sweep"
    nobody = pydicom.dcmread(folder / "nobody.dcm")
    given = [e.keyword for e in nobody if e.tag.group == 0x0010 and e.value not in ("", None)]
    assert not given, f"identifiers that nobody gave: {given}"
    print("identifiers are those that were given")


if sys.argv[1] == "--brightest":
    brightest(Path(sys.argv[2]))
else:
    main()
