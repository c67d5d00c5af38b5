"""Runs pyigtl as a server for ours: frames from one port, transforms from another, version 3 with
metadata.

    python serve.py TRANSFORMS_PORT IMAGES_PORT FOLDER    with the files of frames.py in FOLDER
"""

import os
import sys
import time
from pathlib import Path

import numpy as np
import pyigtl


def main(transforms_port, images_port, folder):
    words = (folder / "frames.txt").read_text().split()
    frames, width, height = map(int, words[:3])
    hz = float(words[3])
    poses = np.array(words[4:], float).reshape(frames, 2, 3, 4)
    pixels = np.fromfile(folder / "frames.raw", np.uint8).reshape(frames, 1, height, width)
    transforms, images = pyigtl.OpenIGTLinkServer(port=transforms_port), pyigtl.OpenIGTLinkServer(port=images_port)
    until = time.time() + 20
    while not (transforms.is_connected() and images.is_connected()):
        assert time.time() < until, "nobody came"
        time.sleep(0.02)
    begun = time.time() + 0.5

    def put(server, message, at, **metadata):
        message.header_version, message.timestamp, message.metadata = 2, at, metadata
        # pyigtl's own queue would wait for answers first.
        server.send_message(message, wait=False)

    def place(n, at):
        for name, rows in zip(("ProbeToTracker", "ReferenceToTracker"), poses[n], strict=True):
            put(transforms, pyigtl.TransformMessage(np.vstack([rows, [0, 0, 0, 1]]), device_name=name), at, Status="OK")

    for n in range(-30, frames + 30):
        at = begun + n / hz
        time.sleep(max(0.0, at - time.time()))
        place(min(max(n, 0), frames - 1), at)
        if 0 <= n < frames:
            put(images, pyigtl.ImageMessage(pixels[n], device_name="Image_Reference"), at, FrameNumber=str(n), FrameStatus="OK")
    time.sleep(2)
    print(f"{frames} frames sent", flush=True)


main(int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
# pyigtl's threads wait for clients without end.
os._exit(0)
