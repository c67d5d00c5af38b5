"""Writes the DICOM files of scripts/interop/dicom.sh again as another program would: without our
private elements and in another transfer syntax, and one compressed.
"""

import sys
from pathlib import Path

import pydicom
from pydicom.uid import ImplicitVRLittleEndian, RLELossless


def main():
    folder, to = (Path(name) for name in sys.argv[1:])
    for name in ("volume", "turned", "sweep"):
        image = pydicom.dcmread(folder / f"{name}.dcm")
        image.remove_private_tags()
        image.file_meta.TransferSyntaxUID = ImplicitVRLittleEndian
        image.save_as(to / f"{name}.dcm", implicit_vr=True, little_endian=True)
    image = pydicom.dcmread(folder / "volume.dcm")
    image.compress(RLELossless)
    image.save_as(to / "packed.dcm")


main()
