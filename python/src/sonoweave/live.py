"""A running session, over the routes of its console: pure Python, without the native module."""

from __future__ import annotations

import dataclasses
import json
import ssl
import struct
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import InputError, SonoweaveError

__all__ = ["CommandRefused", "Picture", "Session", "connect"]

#: Names of the pictures: the scanner's frame, the volume, and planes through it.
PICTURES = ("slice", "view", "free", "across-x", "across-y", "across-z")
#: Encodings of pictures in the stream.
_ENCODINGS = ("grey", "colour", "jpeg")
#: Header of a picture in the stream.
_HEADER = struct.Struct("<BBHIIIddQ")


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


def connect(
    address: str,
    *,
    token: str | None = None,
    timeout: float = 10.0,
    context: ssl.SSLContext | None = None,
) -> Session:
    """Connect to a session's console.

    Parameters
    ----------
    address : str
        Address, such as ``http://127.0.0.1:9110``.
    token : str, optional
        The console's token, if it has one.
    timeout : float, optional
        Longest wait for an answer, s.
    context : ssl.SSLContext, optional
        Certificates to trust. By default the system's.

    Returns
    -------
    Session
        The session; it has answered.

    Raises
    ------
    InputError
        The address is none.
    OSError
        Nothing answers there.
    """
    session = Session(address, token=token, timeout=timeout, context=context)
    session.about()
    return session


class Session:
    """A running session. Made by :func:`connect`.

    Parameters
    ----------
    address : str
        Address, such as ``http://127.0.0.1:9110``.
    token : str, optional
        The console's token, if it has one.
    timeout : float, optional
        Longest wait for an answer, s.
    context : ssl.SSLContext, optional
        Certificates to trust. By default the system's.
    """

    def __init__(
        self,
        address: str,
        *,
        token: str | None = None,
        timeout: float = 10.0,
        context: ssl.SSLContext | None = None,
    ) -> None:
        parts = urllib.parse.urlsplit(address)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise InputError(
                f"address: must be http://HOST:PORT or https://HOST:PORT, not {address!r}"
            )
        if token is not None and not token.isprintable():
            raise InputError("token: must be printable text")
        self.address = f"{parts.scheme}://{parts.netloc}"
        self._token = token
        self._timeout = timeout
        self._context = context

    def __repr__(self) -> str:
        """Return a short description, without the token."""
        return f"<sonoweave.live.Session at {self.address}>"

    def about(self) -> dict[str, Any]:
        """Return the session's description.

        Returns
        -------
        dict
            The answer of ``/v1/about``.
        """
        return self._json("/v1/about")

    def account(self) -> dict[str, Any]:
        """Return the session's present status.

        Returns
        -------
        dict
            The answer of ``/v1/account``.
        """
        return self._json("/v1/account")

    def status(self) -> dict[str, Any]:
        """Return all statistics.

        Returns
        -------
        dict
            The answer of ``/status``.
        """
        return self._json("/status")

    def do(self, command: str, **fields: Any) -> dict[str, Any]:
        """Execute a command, such as ``save``, ``freeze`` or ``clear``.

        Parameters
        ----------
        command : str
            Name of the command.
        **fields : Any
            Fields of the command, such as ``on=True``.

        Returns
        -------
        dict
            The answer. A long command is answered when it begins.

        Raises
        ------
        CommandRefused
            The command is impossible now, or is none.
        """
        return self._json("/v1/do", {"do": command, **fields})

    def measure(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """Measure between points of the world.

        Parameters
        ----------
        request : dict
            The request of ``/v1/measure``.

        Returns
        -------
        dict
            The measurement with its uncertainty.

        Raises
        ------
        CommandRefused
            The request is not possible.
        """
        return self._json("/v1/measure", dict(request))

    def picture(self, name: str = "view") -> bytes | None:
        """Return the newest picture as PNG; None if there is none yet.

        Parameters
        ----------
        name : str, optional
            ``slice`` for the scanner's frame, ``view`` for the volume, ``free``, ``across-x``,
            ``across-y`` or ``across-z`` for a plane.

        Returns
        -------
        bytes or None
            The picture.
        """
        if name not in PICTURES:
            raise InputError(f"name: must be one of {', '.join(PICTURES)}, not {name!r}")
        try:
            return self._request(f"/v1/pictures/{name}.png")
        except CommandRefused as refused:
            if refused.code == 404:
                return None
            raise

    def wait(self, seconds: float, *, used: int = 1) -> dict[str, Any]:
        """Wait until so many frames are used.

        Parameters
        ----------
        seconds : float
            Longest wait, s.
        used : int, optional
            Number of frames in the volume.

        Returns
        -------
        dict
            The statistics then, as of :meth:`status`.

        Raises
        ------
        TimeoutError
            The frames did not come in time.
        """
        ends = time.monotonic() + seconds
        while True:
            status = self.status()
            if int(status["frames"]["used"]) >= used:
                return status
            if time.monotonic() > ends:
                raise TimeoutError(
                    f"{status['frames']['used']} of {used} frames were used within {seconds} s"
                )
            time.sleep(0.05)

    def stream(
        self, *, slice: bool = True, view: bool = True, reconnect: float = 30.0
    ) -> Iterator[Picture]:
        """Iterate over pictures as they come; needs websockets.

        A picture that is not taken in time is skipped for a newer one. A lost connection is made
        again.

        Parameters
        ----------
        slice : bool, optional
            Whether frames of the scanner come.
        view : bool, optional
            Whether pictures of the volume come.
        reconnect : float, optional
            Longest time to try to connect again, s.

        Yields
        ------
        Picture
            The next picture.

        Raises
        ------
        OSError
            The session has ended, or the connection cannot be made again.
        """
        from websockets.exceptions import ConnectionClosed
        from websockets.sync.client import connect as open_socket

        address = self.address.replace("http", "ws", 1) + "/v1/stream"
        context = self._context if address.startswith("wss") else None
        show = json.dumps({"do": "show", "slice": slice, "view": view})
        lost: float | None = None
        while True:
            try:
                with open_socket(
                    address,
                    additional_headers=self._headers(),
                    ssl=context,
                    open_timeout=self._timeout,
                    max_size=None,
                ) as socket:
                    socket.send(show)
                    lost = None
                    for message in socket:
                        if isinstance(message, bytes):
                            picture = _picture(message)
                            yield picture
                            shown = {
                                "do": "shown",
                                "kind": picture.kind,
                                "sequence": picture.sequence,
                            }
                            socket.send(json.dumps(shown))
            except (OSError, ConnectionClosed) as error:
                lost = lost or time.monotonic()
                if time.monotonic() - lost > reconnect:
                    raise ConnectionError(
                        f"{self.address}: the connection is lost: {error}"
                    ) from error
            else:
                lost = lost or time.monotonic()
            time.sleep(0.2)

    def _headers(self) -> dict[str, str]:
        return {} if self._token is None else {"Authorization": f"Bearer {self._token}"}

    def _json(self, route: str, body: Mapping[str, Any] | None = None) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(self._request(route, body))
        return answer

    def _request(self, route: str, body: Mapping[str, Any] | None = None) -> bytes:
        headers, data = self._headers(), None
        if body is not None:
            headers["Content-Type"], data = "application/json", json.dumps(body).encode()
        request = urllib.request.Request(self.address + route, data, headers)
        try:
            with urllib.request.urlopen(
                request, timeout=self._timeout, context=self._context
            ) as answer:
                content: bytes = answer.read()
                return content
        except urllib.error.HTTPError as error:
            text = error.read().decode(errors="replace")
            try:
                sentence = str(json.loads(text)["refused"])
            except (ValueError, KeyError, TypeError):
                sentence = text.strip() or error.reason
            raise CommandRefused(f"{route}: {sentence}", error.code) from None


def _picture(message: bytes) -> Picture:
    """Split a message into its header and its picture."""
    kind, encoding, _, width, height, sequence, captured, _, frame = _HEADER.unpack_from(message)
    return Picture(
        kind,
        _ENCODINGS[encoding],
        (width, height),
        sequence,
        captured,
        frame,
        message[_HEADER.size :],
    )
