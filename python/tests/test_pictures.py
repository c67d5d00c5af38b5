"""Pictures: those of the command line."""

from __future__ import annotations

import struct
import subprocess
import zlib

import numpy as np
import pytest
import sonoweave
from sonoweave import InputError, Reconstructor, Sequence


def png(data: bytes) -> np.ndarray:
    """Read a PNG of three channels of 8 bits."""
    at, parts, header = 8, [], b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        if kind == b"IHDR":
            header = data[at + 8 : at + 8 + length]
        if kind == b"IDAT":
            parts.append(data[at + 8 : at + 8 + length])
        at += 12 + length
    width, height, bits, colour = struct.unpack(">IIBB", header[:10])
    assert (bits, colour) == (8, 2)
    lines = np.frombuffer(zlib.decompress(b"".join(parts)), np.uint8).reshape(height, 1 + 3 * width)
    picture, above = np.zeros((height, 3 * width), np.uint8), np.zeros(3 * width, np.int64)
    for row, line in enumerate(lines):
        kind, line = line[0], line[1:].astype(np.int64)
        now = line.copy()
        for x in range(3 * width):
            left = now[x - 3] if x >= 3 else 0
            corner = above[x - 3] if x >= 3 else 0
            match kind:
                case 1:
                    add = left
                case 2:
                    add = above[x]
                case 3:
                    add = (left + above[x]) // 2
                case 4:
                    guess = left + above[x] - corner
                    near = [abs(guess - left), abs(guess - above[x]), abs(guess - corner)]
                    add = (left, above[x], corner)[near.index(min(near))]
                case _:
                    add = 0
            now[x] = (line[x] + add) % 256
        picture[row], above = now, now
    return picture.reshape(height, width, 3)


@pytest.mark.parametrize(
    ("call", "settings", "flags"),
    [
        (sonoweave.render, {}, []),
        (
            sonoweave.render,
            {"mode": "mip", "view": (25, 35), "window": (0, 200), "perspective": 40},
            ["--mode=mip", "--view=25,35", "--window=0,200", "--perspective=40"],
        ),
        (sonoweave.section, {"at": (5.0, 20.0, 10.0)}, ["--mode=slice", "--at=5,20,10"]),
    ],
)
def test_picture_is_command_lines(program, sweep, tmp_path, call, settings, flags) -> None:
    reconstructor = Reconstructor(spacing=1.0)
    reconstructor.insert_all(Sequence.open(sweep))
    volume = reconstructor.snapshot()
    volume.write(tmp_path / "v.mha", type="f32", weights=tmp_path / "w.mha")
    drawn = [
        program,
        "render",
        tmp_path / "v.mha",
        "--weights",
        tmp_path / "w.mha",
        "-o",
        tmp_path / "p.png",
    ]
    subprocess.run([*drawn, "--image-size=160x140", *flags], check=True, capture_output=True)
    expected = png((tmp_path / "p.png").read_bytes())
    of_file = sonoweave.Volume.open(tmp_path / "v.mha", weights=tmp_path / "w.mha")
    for one in (volume, of_file):
        picture = call(one, size=(160, 140), threads=1, **settings)
        assert picture.shape == (140, 160, 4) and (picture[..., 3] == 255).all()
        assert np.array_equal(picture[..., :3], expected)
    assert expected.max() > 50


def test_wrong_setting_of_picture_is_named(grown) -> None:
    volume = grown.snapshot()
    for settings, text in (
        ({"mode": "magic"}, "mode"),
        ({"size": (1, 2, 3)}, "size"),
        ({"draw": "probe"}, "draw"),
    ):
        with pytest.raises(InputError, match=text):
            sonoweave.render(volume, **settings)
    with pytest.raises(InputError, match="at"):
        sonoweave.section(volume, at=(1e6, 0, 0))
    with pytest.raises(TypeError, match="volume"):
        sonoweave.render(np.zeros((3, 3, 3)))  # type: ignore[arg-type]
