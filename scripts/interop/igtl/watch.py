"""Runs pyigtl as a client of ours: version 3 with metadata, commands, and slices and the volume at
their places.

    python watch.py PORT FOLDER
"""

import struct
import sys
import time
from pathlib import Path

import numpy as np
import pyigtl
from pyigtl import messages


class Bare(messages.MessageBase):
    """A query: a message without content."""

    def __init__(self, kind, device):
        super().__init__(device_name=device)
        self._message_type, self._valid_message, self.header_version = kind, True, 2


class Command(messages.MessageBase):
    """COMMAND and RTS_COMMAND, which pyigtl lacks."""

    def __init__(self, name="", number=0):
        super().__init__(device_name="pyigtl")
        self._message_type, self._valid_message, self.header_version = "COMMAND", True, 2
        self.metadata = {"From": "pyigtl"}
        self.name, self.number, self.text = name, number, ""

    def _pack_content(self):
        return struct.pack("> I 128s H I", self.number, self.name.encode(), 3, 0)

    def _unpack_content(self, content):
        self.number, name, encoding, length = struct.unpack("> I 128s H I", content[:138])
        self.name = name.rstrip(b"\0").decode()
        self.text = self.decode_text(content[138:], encoding)
        assert length == len(content) - 138


class Capability(messages.MessageBase):
    def _unpack_content(self, content):
        self.types = [content[at : at + 12].rstrip(b"\0").decode() for at in range(0, len(content), 12)]


class Status(messages.MessageBase):
    def _unpack_content(self, content):
        self.code = struct.unpack("> H", content[:2])[0]
        self.text = content[30:].rstrip(b"\0").decode()


known = messages.message_type_to_class_constructor
known.update({"RTS_COMMAND": Command, "CAPABILITY": Capability, "STATUS": Status})


def main(port, folder):
    client = pyigtl.OpenIGTLinkClient("127.0.0.1", port)

    def wait(device, seconds=20, check=lambda message: True):
        until = time.time() + seconds
        while time.time() < until:
            message = client.wait_for_message(device, timeout=1)
            if message is not None and check(message):
                return message
        raise SystemExit(f"{device} was not heard")

    def order(name, number):
        client.send_message(Command(name, number))
        answer = wait("pyigtl", check=lambda message: message.message_type == "RTS_COMMAND" and message.number == number)
        assert answer.header_version == 2 and answer.metadata["Result"] in ("true", "false"), answer.metadata
        return answer

    assert order("start", 1).metadata["Result"] == "true"
    again = order("start", 2)
    assert again.metadata["Result"] == "false" and "runs already" in again.name, again.name
    client.send_message(Bare("GET_CAPABIL", "types"))
    assert "COMMAND" in wait("types").types
    # The server answers in version 3 from now on.
    image = wait("Image_Reference", check=lambda message: message.header_version == 2)
    assert image.metadata["Frame"] == "Reference (mm, not anatomical)", image.metadata
    assert abs(image.timestamp - time.time()) < 30, image.timestamp
    numbers = [int(image.metadata["FrameNumber"])]
    slices = []
    while len(slices) < 60:
        image = wait("Image_Reference")
        numbers.append(int(image.metadata["FrameNumber"]))
        slices.append((image.ijk_to_world_matrix, np.array(image.image)))
        assert image.world_coordinate_system == "ras" and image.image.dtype == np.uint8
    assert numbers == sorted(set(numbers)), "frames out of order, or twice"
    pose = wait("ProbeToTracker")
    assert pose.metadata["Status"] == "OK" and abs(np.linalg.det(pose.matrix[:3, :3]) - 1) < 1e-5
    assert wait("ImageToReference").matrix.shape == (4, 4)
    client.send_message(Bare("GET_IMAGE", "Volume_Reference"))
    volume = wait("Volume_Reference")
    print(f"volume of {volume.metadata['Slices']} slices, {volume.image.shape[::-1]} voxels")
    saved = order("save", 3)
    assert saved.metadata["Result"] == "true", saved.text
    # The saved volume is sent, too.
    volume = wait("Volume_Reference")
    np.savez(folder / "pyigtl.npz", place=volume.ijk_to_world_matrix, values=volume.image,
             slice_places=[place for place, _ in slices[::10]], slice_values=[values for _, values in slices[::10]])
    assert order("stop", 4).metadata["Result"] == "true"
    client.stop()
    print(f"{len(numbers)} slices, frames {numbers[0]} to {numbers[-1]}")


main(int(sys.argv[1]), Path(sys.argv[2]))
