"""Writes a tracked sequence as numbers for peer and serve.py: size and rate, and for each frame the
upper rows of ProbeToTracker and ReferenceToTracker.

    python frames.py SEQUENCE.mha FOLDER HZ
"""

import sys
from pathlib import Path

sequence, folder, hz = Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3])
head, pixels = sequence.read_bytes().split(b"ElementDataFile = LOCAL\n", 1)
fields = dict(line.split(" = ", 1) for line in head.decode().splitlines())
width, height, frames = map(int, fields["DimSize"].split())
assert fields["CompressedData"] == "False" and len(pixels) == width * height * frames
lines = [f"{frames} {width} {height} {hz}"]
for n in range(frames):
    for name in ("ProbeToTracker", "ReferenceToTracker"):
        lines.append(" ".join(fields[f"Seq_Frame{n:04}_{name}Transform"].split()[:12]))
folder.joinpath("frames.txt").write_text("\n".join(lines) + "\n")
folder.joinpath("frames.raw").write_bytes(pixels)
