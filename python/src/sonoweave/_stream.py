"""The stream of a session's console, for both forms of :mod:`sonoweave.live`."""

from __future__ import annotations

import dataclasses
import json
import ssl
import struct
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from .errors import InputError, SonoweaveError

if TYPE_CHECKING:
    from websockets.exceptions import InvalidStatus

__all__ = ["CommandRefused", "Picture", "Stream"]

#: Encodings of pictures in the stream.
_ENCODINGS = ("grey", "colour", "jpeg")
#: Header of a picture in the stream.
_HEADER = struct.Struct("<BBHIIIddQ")
#: Pause before a connection is made again, s.
PAUSE = 0.2


class CommandRefused(SonoweaveError):
    """The session has refused a command; nothing has changed there.

    Parameters
    ----------
    sentence : str
        The reason, with advice.
    code : int
        Code of the answer: 409 if the command is impossible now, 422 if it is none.

    Attributes
    ----------
    code : int
        Code of the answer: 409 if the command is impossible now, 422 if it is none.
    """

    def __init__(self, sentence: str, code: int = 409) -> None:
        super().__init__(sentence, code)
        self.code = code

    def __str__(self) -> str:
        """Return the sentence."""
        return str(self.args[0])


@dataclasses.dataclass(frozen=True)
class Picture:
    """A picture of the stream.

    Parameters
    ----------
    kind : int
        Kind: 1 is the scanner's frame, 2 the volume, 3 to 6 are planes.
    encoding : str
        ``grey`` and ``colour`` are bytes of pixels; ``jpeg`` comes over slow connections.
    size : tuple of int
        Width and height, pixels.
    sequence : int
        Number of the picture among those of its kind.
    captured : float
        Time of the newest frame in it, ms of the session's clock.
    frame : int
        Number of that frame.
    data : bytes
        The encoded picture.
    """

    kind: int
    encoding: str
    size: tuple[int, int]
    sequence: int
    captured: float
    frame: int
    data: bytes

    def pixels(self) -> npt.NDArray[np.uint8]:
        """Return the picture as an array.

        Returns
        -------
        array of uint8, shape (height, width) or (height, width, 3)
            Grey values, or red, green and blue.

        Raises
        ------
        InputError
            The picture is a JPEG, in ``data``.
        """
        width, height = self.size
        if self.encoding == "jpeg":
            raise InputError("the picture came as JPEG; decode its data, for example by Pillow")
        shape = (height, width) if self.encoding == "grey" else (height, width, 3)
        return np.frombuffer(self.data, np.uint8).reshape(shape)


class Stream:
    """A stream of pictures, whatever carries it.

    Parameters
    ----------
    address : str
        Address of the console.
    headers : dict of str
        Headers of its requests.
    context : ssl.SSLContext or None
        Certificates to trust; None for the system's.
    timeout : float
        Longest wait for the connection, s.
    show : dict of bool
        Kinds of pictures, and whether they come.
    reconnect : float
        Longest time to try to connect again, s.
    """

    def __init__(
        self,
        address: str,
        *,
        headers: dict[str, str],
        context: ssl.SSLContext | None,
        timeout: float,
        show: dict[str, bool],
        reconnect: float,
    ) -> None:
        self.address = address.replace("http", "ws", 1) + "/v1/stream"
        self.options: dict[str, Any] = {
            "additional_headers": headers,
            "ssl": context if self.address.startswith("wss") else None,
            "open_timeout": timeout,
            "max_size": None,
        }
        self._console = address
        self._show = show
        self._reconnect = reconnect
        self._lost: float | None = None

    def opened(self) -> str:
        """Return the message with which a connection begins."""
        self._lost = None
        return json.dumps({"do": "show", **self._show})

    def picture(self, message: str | bytes) -> Picture | None:
        """Return the picture of a message; None if it is none."""
        if isinstance(message, str):
            return None
        kind, encoding, _, width, height, sequence, captured, _, frame = _HEADER.unpack_from(
            message
        )
        data = message[_HEADER.size :]
        size = (width, height)
        return Picture(kind, _ENCODINGS[encoding], size, sequence, captured, frame, data)

    def taken(self, picture: Picture) -> str:
        """Return the message after which the next picture comes."""
        return json.dumps({"do": "shown", "kind": picture.kind, "sequence": picture.sequence})

    def refused(self, error: InvalidStatus) -> CommandRefused:
        """Return the error of a console that refuses the connection, for example the token."""
        status = error.response.status_code
        reason = (error.response.body or b"").decode(errors="replace").strip()
        return CommandRefused(f"/v1/stream: {reason or error}", status)

    def lost(self, error: Exception | None) -> None:
        """Note the end of a connection; raise if there was none for too long."""
        self._lost = self._lost or time.monotonic()
        if time.monotonic() - self._lost > self._reconnect:
            raise ConnectionError(f"{self._console}: the connection is lost: {error}") from error
