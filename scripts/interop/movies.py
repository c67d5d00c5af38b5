"""Reads movies of sonoweave with other programs: Pillow, and FFmpeg by PyAV. They find the number
of pictures, their times and their pixels.

Usage: movies.py SONOWEAVE FOLDER. Writes into the empty folder, and ends with an error at the
first difference.
"""

import subprocess
import sys
from pathlib import Path

import av
import numpy as np
from PIL import Image

SONOWEAVE, FOLDER = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
TURNS = 12
RATE = 12.5
# Grey pictures, and coloured ones.
LOOKS = {"grey": "phantom", "colour": "colour.toml"}
COLOURS = """format = "sonoweave-transfer"
version = 1
[opacity]
curve = [[60.0, 0.0], [120.0, 0.3]]
[colour]
list = [[0.0, 0.1, 0.1, 0.3], [128.0, 0.8, 0.3, 0.2], [255.0, 1.0, 0.9, 0.7]]
"""
checks = 0


def sonoweave(*words):
    run = subprocess.run([str(SONOWEAVE), *map(str, words)], cwd=FOLDER, capture_output=True, text=True)
    if run.returncode:
        sys.exit(f"sonoweave {' '.join(map(str, words))}: {run.stderr}")


def check(is_right, what):
    global checks
    checks += 1
    if not is_right:
        sys.exit(f"movies: {what}")


def by_pillow(name):
    """Returns the pictures, and the time that each is shown, ms."""
    image = Image.open(FOLDER / name)
    pictures, times = [], []
    for number in range(image.n_frames):
        image.seek(number)
        pictures.append(np.asarray(image.convert("RGB")).astype(int))
        times.append(image.info["duration"])
    return pictures, times


def by_ffmpeg(name):
    """Returns the pictures, and the time at which each is shown, s."""
    with av.open(str(FOLDER / name)) as file:
        frames = list(file.decode(video=0))
        pictures = [frame.to_ndarray(format="rgb24").astype(int) for frame in frames]
        start = frames[0].time
        return pictures, [frame.time - start for frame in frames], file.streams.video[0]


def rms(a, b):
    return float(np.sqrt(np.mean((a - b) ** 2)))


(FOLDER / "colour.toml").write_text(COLOURS)
sonoweave("phantom", "-o", "s.mha", "--image-size", "96x80", "--pixel", "0.4", "--frames", 30, "--gap", "0.8")
sonoweave("reconstruct", "s.mha", "--clip", "none", "-o", "v.mha")
for look, transfer in LOOKS.items():
    flags = ["--turntable", TURNS, "--image-size", "96x80", "--transfer", transfer]
    sonoweave("render", "v.mha", "-o", f"{look}.png", *flags)
    truth = [np.asarray(Image.open(FOLDER / f"{look}-{n:03}.png").convert("RGB")).astype(int) for n in range(TURNS)]
    for kind in ("apng", "gif", "avi"):
        name = f"{look}.{kind}"
        sonoweave("render", "v.mha", "-o", name, "--movie-rate", RATE, *flags)
        pictures, times, stream = by_ffmpeg(name)
        check(len(pictures) == TURNS, f"FFmpeg finds {len(pictures)} pictures of {TURNS} in {name}")
        late = max(abs(time - n / RATE) for n, time in enumerate(times))
        check(late < 1e-6, f"FFmpeg shows a picture of {name} {late} s beside its time")
        worst = max(rms(a, b) for a, b in zip(pictures, truth))
        # Chroma of JPEG has a quarter of the pixels; a GIF's picture has 256 colours.
        most = {"apng": 0.0, "gif": 0.0 if look == "grey" else 4.0, "avi": 4.0}[kind]
        check(worst <= most, f"a picture of {name} is off by {worst:.2f} grey levels rms")
        if kind == "avi":
            check(stream.codec_context.name == "mjpeg", f"{name} is {stream.codec_context.name}")
            check(stream.average_rate == RATE and stream.frames == TURNS, f"{name} says {stream.average_rate}/s")
            continue
        pictures, times = by_pillow(name)
        check(len(pictures) == TURNS, f"Pillow finds {len(pictures)} pictures of {TURNS} in {name}")
        check(all(time == 1000 / RATE for time in times), f"Pillow shows pictures of {name} for {times} ms")
        worst = max(rms(a, b) for a, b in zip(pictures, truth))
        check(worst <= most, f"Pillow's picture of {name} is off by {worst:.2f} grey levels rms")

print(f"movies: {checks} checks with Pillow {Image.__version__} and PyAV {av.__version__} passed")
