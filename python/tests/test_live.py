"""A session at a virtual bedside, over its console."""

from __future__ import annotations

import asyncio
import http
import itertools
import re
import struct
import subprocess
import threading
from collections.abc import Iterator

import pytest
from sonoweave import InputError, live


@pytest.fixture(scope="module")
def session(program, tmp_path_factory) -> Iterator[live.Session]:
    folder = tmp_path_factory.mktemp("demo")
    command = [
        program,
        "demo",
        "--headless",
        "--console=127.0.0.1:0",
        "-o",
        folder,
        "--duration=60",
    ]
    child = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=folder
    )
    try:
        address = None
        for line in child.stdout:
            found = re.search(r"http://127\.0\.0\.1:\d+", line)
            if found:
                address = found[0]
                break
        assert address, f"no address; the program ended with {child.wait(5)}"
        yield live.connect(address)
    finally:
        child.terminate()
        child.wait(30)


def test_session_is_described(session) -> None:
    assert session.about()
    status = session.wait(30, used=10)
    frames = status["frames"]
    assert frames["total"] == frames["used"] + frames["waiting"] + sum(
        frames["refused"].values()
    ) + sum(frames.get("dropped", {}).values())


def test_pictures_are_png(session) -> None:
    session.wait(30, used=10)
    for name in ("slice", "view"):
        picture = session.picture(name)
        assert picture is None or picture.startswith(b"\x89PNG")
    assert session.picture("slice") is not None
    with pytest.raises(InputError, match="across-x"):
        session.picture("other")


def test_commands_are_executed_or_refused(session) -> None:
    session.wait(30, used=5)
    session.do("freeze", on=True)
    session.do("freeze", on=False)
    with pytest.raises(live.CommandRefused) as refused:
        session.do("dance")
    assert refused.value.code == 422


def test_stream_has_newer_and_newer_pictures(session) -> None:
    pytest.importorskip("websockets")
    pictures = list(itertools.islice(session.stream(view=False), 5))
    numbers = [picture.sequence for picture in pictures]
    assert numbers == sorted(set(numbers)) and all(picture.kind == 1 for picture in pictures)
    assert all(min(picture.size) > 10 for picture in pictures)
    assert all(picture.pixels().shape[:2] == picture.size[::-1] for picture in pictures)
    assert pictures[-1].pixels().max() > 50


async def taken(session: live.AsyncSession, count: int, **which: object) -> list[live.Picture]:
    """Return so many pictures of a stream."""
    pictures = []
    async for picture in session.stream(**which):
        pictures.append(picture)
        if len(pictures) == count:
            break
    return pictures


def test_async_form_has_answers_of_blocking_form(session) -> None:
    async def use() -> None:
        same = await live.connect_async(session.address)
        assert repr(session.address)[1:-1] in repr(same)
        assert await same.about() == session.about()
        status, account = await asyncio.gather(same.wait(30, used=10), same.account())
        assert status["frames"]["used"] >= 10 and set(account) == set(session.account())
        assert (await same.picture("slice") or b"").startswith(b"\x89PNG")
        view = await same.view()
        assert view is None or view.startswith(b"\x89PNG")
        for on in (True, False):
            await same.do("freeze", on=on)
            async with asyncio.timeout(30):
                while (await same.status())["frozen"] != on:
                    await asyncio.sleep(0.02)
        with pytest.raises(live.CommandRefused) as refused:
            await same.do("dance")
        assert refused.value.code == 422
        with pytest.raises(TimeoutError, match="10000000 frames"):
            await same.wait(0.1, used=10_000_000)

    asyncio.run(use())


def test_async_stream_has_newer_and_newer_pictures(session) -> None:
    pytest.importorskip("websockets")

    async def use() -> list[live.Picture]:
        return await taken(await live.connect_async(session.address), 5, view=False)

    pictures = asyncio.run(use())
    numbers = [picture.sequence for picture in pictures]
    assert numbers == sorted(set(numbers)) and all(picture.kind == 1 for picture in pictures)
    assert all(picture.pixels().shape[:2] == picture.size[::-1] for picture in pictures)


@pytest.fixture
def console() -> Iterator[str]:
    """Address of a console that wants a token, and ends each connection after two pictures."""
    server = pytest.importorskip("websockets.sync.server")
    number = itertools.count(1)

    def check(connection, request):
        if request.headers.get("Authorization") != "Bearer secret":
            return connection.respond(http.HTTPStatus.UNAUTHORIZED, "the token is wrong\n")
        return None

    def handle(connection) -> None:
        assert '"show"' in connection.recv()
        for _ in range(2):
            sequence = next(number)
            head = struct.pack("<BBHIIIddQ", 1, 0, 0, 2, 2, sequence, 0.0, 0.0, 7)
            connection.send(head + bytes([sequence] * 4))
            assert f'"sequence": {sequence}' in connection.recv()

    with server.serve(handle, "127.0.0.1", 0, process_request=check) as running:
        thread = threading.Thread(target=running.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{running.socket.getsockname()[1]}"
        running.shutdown()
        thread.join()


@pytest.mark.parametrize("is_async", [False, True])
def test_lost_stream_is_opened_again_with_token(console, is_async) -> None:
    session = live.Session(console, token="secret")
    if is_async:
        pictures = asyncio.run(taken(live.AsyncSession(session), 5))
    else:
        pictures = list(itertools.islice(session.stream(), 5))
    assert [picture.sequence for picture in pictures] == [1, 2, 3, 4, 5]
    assert pictures[2].pixels().tolist() == [[3, 3], [3, 3]]
    assert "secret" not in repr(session) + repr(live.AsyncSession(session))


@pytest.mark.parametrize("is_async", [False, True])
def test_wrong_token_is_refused_at_once(console, is_async) -> None:
    session = live.Session(console, token="guess")
    with pytest.raises(live.CommandRefused, match="the token is wrong") as refused:
        if is_async:
            asyncio.run(taken(live.AsyncSession(session), 1))
        else:
            next(session.stream())
    assert refused.value.code == 401


@pytest.mark.parametrize("is_async", [False, True])
def test_stream_without_console_ends(is_async) -> None:
    pytest.importorskip("websockets")
    session = live.Session("http://127.0.0.1:9", timeout=1)
    with pytest.raises(ConnectionError, match="127.0.0.1:9: the connection is lost"):
        if is_async:
            asyncio.run(taken(live.AsyncSession(session), 1, reconnect=0.3))
        else:
            next(session.stream(reconnect=0.3))


def test_wrong_address_is_named() -> None:
    with pytest.raises(InputError, match="address"):
        live.connect("localhost")
    with pytest.raises(OSError):
        live.connect("http://127.0.0.1:9", timeout=1)
