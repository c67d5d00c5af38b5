"""A session at a virtual bedside, over its console."""

from __future__ import annotations

import itertools
import re
import subprocess
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


def test_wrong_address_is_named() -> None:
    with pytest.raises(InputError, match="address"):
        live.connect("localhost")
    with pytest.raises(OSError):
        live.connect("http://127.0.0.1:9", timeout=1)
