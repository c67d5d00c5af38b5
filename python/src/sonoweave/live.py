"""A running session, over the routes of its console: pure Python, without the native module.

:func:`connect` gives the blocking form, and :func:`connect_async` the same for ``asyncio``.
"""

from __future__ import annotations

import asyncio
import functools
import json
import ssl
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Mapping
from typing import Any, Concatenate, ParamSpec, TypeVar

from ._stream import PAUSE, CommandRefused, Picture, Stream
from .errors import InputError

__all__ = [
    "AsyncSession",
    "CommandRefused",
    "Picture",
    "Session",
    "connect",
    "connect_async",
]

#: Names of the pictures: the scanner's frame, the volume, and planes through it.
PICTURES = ("slice", "view", "free", "across-x", "across-y", "across-z")
#: Time between two looks at the statistics, s.
_TURN = 0.05


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

    def do(self, command: str, /, **fields: Any) -> dict[str, Any]:
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

    def view(self) -> bytes | None:
        """Return the newest picture of the volume as PNG; None if there is none yet.

        Returns
        -------
        bytes or None
            The picture.
        """
        return self.picture("view")

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
        while not _has_used(status := self.status(), used, ends, seconds):
            time.sleep(_TURN)
        return status

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
        CommandRefused
            The console refuses the connection, for example its token.
        """
        from websockets.exceptions import ConnectionClosed, InvalidStatus
        from websockets.sync.client import connect as open_socket

        stream = self._stream(slice, view, reconnect)
        while True:
            ended: Exception | None = None
            try:
                with open_socket(stream.address, **stream.options) as socket:
                    socket.send(stream.opened())
                    for message in socket:
                        picture = stream.picture(message)
                        if picture is not None:
                            yield picture
                            socket.send(stream.taken(picture))
            except InvalidStatus as error:
                raise stream.refused(error) from None
            except (OSError, ConnectionClosed) as error:
                ended = error
            stream.lost(ended)
            time.sleep(PAUSE)

    def _stream(self, slice: bool, view: bool, reconnect: float) -> Stream:
        return Stream(
            self.address,
            headers=self._headers(),
            context=self._context,
            timeout=self._timeout,
            show={"slice": slice, "view": view},
            reconnect=reconnect,
        )

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


def _has_used(status: dict[str, Any], used: int, ends: float, seconds: float) -> bool:
    """Return whether so many frames are used; raise when the time is over."""
    count = int(status["frames"]["used"])
    if count < used and time.monotonic() > ends:
        raise TimeoutError(f"{count} of {used} frames were used within {seconds} s")
    return count >= used


async def connect_async(
    address: str,
    *,
    token: str | None = None,
    timeout: float = 10.0,
    context: ssl.SSLContext | None = None,
) -> AsyncSession:
    """Connect to a session's console, in a program with ``asyncio``.

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
    AsyncSession
        The session; it has answered.

    Raises
    ------
    InputError
        The address is none.
    OSError
        Nothing answers there.
    """
    session = Session(address, token=token, timeout=timeout, context=context)
    await asyncio.to_thread(session.about)
    return AsyncSession(session)


_P = ParamSpec("_P")
_R = TypeVar("_R")


def _awaited(
    method: Callable[Concatenate[Session, _P], _R],
) -> Callable[Concatenate[AsyncSession, _P], Coroutine[Any, Any, _R]]:
    """Make a method of the blocking form to be awaited; it waits in a thread of its own."""

    @functools.wraps(method)
    async def call(self: AsyncSession, /, *args: _P.args, **keywords: _P.kwargs) -> _R:
        return await asyncio.to_thread(method, self._session, *args, **keywords)

    return call


class AsyncSession:
    """A running session, for ``asyncio``. Made by :func:`connect_async`.

    Methods are those of :class:`Session`, to be awaited.

    Parameters
    ----------
    session : Session
        The blocking form.
    """

    def __init__(self, session: Session) -> None:
        self._session = session

    def __repr__(self) -> str:
        """Return a short description, without the token."""
        return f"<sonoweave.live.AsyncSession at {self._session.address}>"

    about = _awaited(Session.about)
    account = _awaited(Session.account)
    status = _awaited(Session.status)
    do = _awaited(Session.do)
    measure = _awaited(Session.measure)
    picture = _awaited(Session.picture)
    view = _awaited(Session.view)

    async def wait(self, seconds: float, *, used: int = 1) -> dict[str, Any]:
        ends = time.monotonic() + seconds
        while not _has_used(status := await self.status(), used, ends, seconds):
            await asyncio.sleep(_TURN)
        return status

    async def stream(
        self, *, slice: bool = True, view: bool = True, reconnect: float = 30.0
    ) -> AsyncIterator[Picture]:
        from websockets.asyncio.client import connect as open_socket
        from websockets.exceptions import ConnectionClosed, InvalidStatus

        stream = self._session._stream(slice, view, reconnect)
        while True:
            ended: Exception | None = None
            try:
                async with open_socket(stream.address, **stream.options) as socket:
                    await socket.send(stream.opened())
                    async for message in socket:
                        picture = stream.picture(message)
                        if picture is not None:
                            yield picture
                            await socket.send(stream.taken(picture))
            except InvalidStatus as error:
                raise stream.refused(error) from None
            except (OSError, ConnectionClosed) as error:
                ended = error
            stream.lost(ended)
            await asyncio.sleep(PAUSE)


for _method in ("stream", "wait"):
    getattr(AsyncSession, _method).__doc__ = getattr(Session, _method).__doc__
