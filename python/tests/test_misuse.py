"""Arguments that do not fit: documented exceptions, and nothing changed."""

from __future__ import annotations

import os
import random

import numpy as np
import pytest
from sonoweave import (
    FrameRefused,
    InputError,
    MemoryLimit,
    Reconstructor,
    Sequence,
    SonoweaveError,
    Volume,
)

#: Number of random sets of arguments.
CASES = int(os.environ.get("SONOWEAVE_PYTHON_CASES", "10000"))

FRAME, POSE = np.full((40, 30), 9, np.uint8), np.diag([0.5, 0.5, 0.5, 1.0])


def of(pose: np.ndarray, place: tuple[int, int], value: float) -> np.ndarray:
    changed = np.array(pose, float)
    changed[place] = value
    return changed


@pytest.mark.parametrize(
    ("frame", "pose", "raised", "text"),
    [
        (
            FRAME.astype(np.int8),
            POSE,
            TypeError,
            "frame: must be of type uint8, uint16, float32, not int8",
        ),
        (FRAME.astype(np.float64), POSE, TypeError, "not float64"),
        (FRAME.astype(bool), POSE, TypeError, "not of bool"),
        (FRAME.astype(complex), POSE, TypeError, "not of complex128"),
        (FRAME.astype(object), POSE, TypeError, "not of object"),
        ("frame", POSE, TypeError, "frame"),
        (None, POSE, TypeError, "not of object"),
        (FRAME[0], POSE, InputError, r"\(height, width\), not \(30,\)"),
        (FRAME[np.newaxis], POSE, InputError, r"not \(1, 40, 30\)"),
        (FRAME[:0], POSE, InputError, r"not \(0, 30\)"),
        (
            FRAME,
            POSE[:3],
            InputError,
            r"world_from_image: must have the shape \(4, 4\), not \(3, 4\)",
        ),
        (FRAME, POSE[np.newaxis], InputError, r"not \(1, 4, 4\)"),
        (FRAME, of(POSE, (0, 3), np.nan), InputError, r"must be finite, and is nan at \[0, 3\]"),
        (FRAME, of(POSE, (2, 2), np.inf), InputError, r"is inf at \[2, 2\]"),
        (FRAME, of(POSE, (3, 0), 1), InputError, "the last row must be 0 0 0 1"),
        (FRAME, POSE.astype(str), TypeError, "world_from_image"),
        (FRAME, of(POSE, (0, 0), 0), FrameRefused, "frame 5"),
        (np.full((40, 30), np.nan, np.float32), POSE, FrameRefused, r"pixel \(0, 0\) is NaN"),
        (FRAME[:20], POSE, FrameRefused, "30×20 pixels after frames of"),
    ],
)
def test_wrong_argument_is_named_and_changes_nothing(grown, frame, pose, raised, text) -> None:
    before, ledger = grown.snapshot().values(), grown.ledger
    with pytest.raises(raised, match=text) as error:
        grown.insert(frame, pose)
    assert np.array_equal(grown.snapshot().values(), before)
    if raised is FrameRefused:
        assert error.value.item == 5 and grown.ledger["frames"]["refused"] == {
            error.value.reason: 1
        }
    else:
        assert grown.ledger == ledger


def test_repeated_frame_is_refused(sweep) -> None:
    sequence = Sequence.open(sweep)
    reconstructor = Reconstructor(clip="none")
    reconstructor.insert(sequence[0], sequence.poses[0])
    with pytest.raises(FrameRefused) as error:
        reconstructor.insert(sequence[0], sequence.poses[0])
    assert (error.value.reason, error.value.item) == ("repeated", 1)


def test_one_buffer_may_hold_all_frames(sweep) -> None:
    """A camera's buffer that changes between calls is no repeated frame."""
    sequence = Sequence.open(sweep)
    reconstructor, buffer = Reconstructor(clip="none"), np.empty_like(sequence[0])
    for at in range(6):
        buffer[:] = sequence[at]
        reconstructor.insert(buffer, sequence.poses[0])
    assert reconstructor.ledger["frames"]["used"] == 6


@pytest.mark.parametrize(
    ("settings", "raised", "text"),
    [
        ({"spacing": 0}, InputError, "spacing"),
        ({"spacing": "a"}, InputError, "spacing"),
        ({"spacing": [1, 2]}, InputError, "spacing"),
        ({"spacing": object()}, TypeError, "spacing"),
        ({"spacing": True}, InputError, "spacing"),
        ({"spacing": [True, 1, 1]}, TypeError, "spacing"),
        ({"method": "magic"}, InputError, "method"),
        ({"compound": "mean", "decay_rate": 2}, InputError, "decay"),
        ({"threads": 0}, InputError, "threads"),
        ({"memory": "much"}, InputError, "memory"),
        ({"memory": -1}, InputError, "memory"),
        ({"unknown": 3}, InputError, "unknown"),
        ({"output": "v.mha"}, InputError, "output"),
        ({"help": "1"}, InputError, "help"),
        ({"frames": "x"}, InputError, "frames"),
        ({"spacing\n--clip": 3}, InputError, "spacing"),
    ],
)
def test_wrong_setting_is_named(settings, raised, text) -> None:
    with pytest.raises(raised, match=text) as error:
        Reconstructor(**settings)
    assert "Usage" not in str(error.value) and "\n" not in str(error.value)


def test_sigma_of_gaps_needs_all_poses() -> None:
    with pytest.raises(InputError, match="choose a σ"):
        Reconstructor(sigma="auto").insert(FRAME, POSE)


def test_memory_limit_keeps_frames_before() -> None:
    reconstructor = Reconstructor(spacing=0.1, clip="none", memory="40MiB")
    pose, used = POSE.copy(), 0
    with pytest.raises(MemoryLimit, match="MiB|GiB|MB|bytes"):
        for _ in range(1000):
            pose[2, 3] += 1.0
            reconstructor.insert(FRAME, pose)
            used += 1
    assert used > 0 and isinstance(MemoryLimit(""), MemoryError)
    frames = reconstructor.ledger["frames"]
    assert (
        frames["used"] == used
        and frames["refused"] == {"volume_full": 1}
        and frames["waiting"] == 0
    )
    assert reconstructor.snapshot().weights().any()


def test_empty_volume_is_named() -> None:
    with pytest.raises(InputError, match="empty"):
        Reconstructor().snapshot()


def test_files_that_cannot_be_read_are_os_errors(tmp_path, grown) -> None:
    for make in (Sequence.open, Volume.open):
        with pytest.raises(FileNotFoundError) as error:
            make(tmp_path / "none.mha")
        assert error.value.filename == str(tmp_path / "none.mha")
    with pytest.raises(FileNotFoundError) as error:
        grown.snapshot().write(tmp_path / "none" / "v.mha")
    assert error.value.filename == str(tmp_path / "none" / "v.mha")
    (tmp_path / "bad.mha").write_bytes(b"ObjectType = Image\nNDims = 3\n")
    with pytest.raises(InputError, match="bad.mha"):
        Sequence.open(tmp_path / "bad.mha")
    with pytest.raises(InputError, match="v.what"):
        grown.snapshot().write(tmp_path / "v.what")


def test_missing_calibration_names_frames(recordings) -> None:
    from sonoweave import CalibrationError

    with pytest.raises(CalibrationError) as error:
        Sequence.open(recordings / "freehand" / "SpinePhantomFreehand.igs.mha")
    assert error.value.missing[0] == "Image"


def junk(random: random.Random) -> object:
    """Return something, rarely of use."""
    shapes = [
        (),
        (0,),
        (4,),
        (4, 4),
        (3, 4),
        (40, 30),
        (1, 40, 30),
        (2, 40, 30),
        (2, 4, 4),
        (0, 0),
        (1, 1),
    ]
    kinds = [
        "u1",
        "u2",
        "u4",
        "u8",
        "i1",
        "i2",
        "i4",
        "i8",
        "f2",
        "f4",
        "f8",
        ">u2",
        ">f4",
        "c8",
        "?",
        "O",
        "S3",
        "U2",
        "M8[s]",
        "m8[s]",
    ]

    def array() -> object:
        return np.zeros(random.choice(shapes), random.choice(kinds))

    numbers = [
        0,
        1,
        -1,
        2**31,
        2**63,
        2**70,
        -(2**70),
        0.5,
        float("nan"),
        float("inf"),
        -0.0,
        1e308,
        5e-324,
    ]
    texts = [
        "",
        "auto",
        "none",
        "\0",
        "é" * 40,
        "--help",
        "0,0,0",
        "1..2",
        "nan",
        "\ud800",
        "/",
        ".",
        "/dev/null",
    ]
    choices = [
        array,
        array,
        lambda: (
            array() if random.random() < 0.5 else np.full((4, 4), random.choice(numbers), object)
        ),
        lambda: random.choice(numbers),
        lambda: random.choice(texts),
        lambda: [random.choice(numbers) for _ in range(random.randrange(18))],
        lambda: {random.choice(texts): random.choice(numbers)},
        lambda: random.choice(
            [None, True, b"", object(), print, slice(None, 3), slice(3, 1, -1), range(2), ...]
        ),
        lambda: FRAME,
        lambda: POSE,
        lambda: np.stack([FRAME, FRAME]),
        lambda: np.random.default_rng(1).random((40, 30), np.float32),
        lambda: of(
            POSE,
            (random.randrange(4), random.randrange(4)),
            random.choice([-1e300, 1e-300, 3.5, np.nan]),
        ),
    ]
    return random.choice(choices)()


def test_random_arguments_raise_documented_exceptions(grown, tmp_path, monkeypatch) -> None:
    """Only TypeError, IndexError, OSError and the package's; a refused call changes nothing."""
    monkeypatch.chdir(tmp_path)
    chance = random.Random(7)
    volume = grown.snapshot()
    before, bits = volume.values(), grown.snapshot().values()
    used = grown.ledger["frames"]["used"]
    names = [
        "spacing",
        "method",
        "sigma",
        "clip",
        "threads",
        "memory",
        "frames",
        "fan",
        "origin",
        "size",
        "x y",
        "",
    ]
    some = lambda: junk(chance)
    keywords = lambda: {chance.choice(names): junk(chance) for _ in range(chance.randrange(3))}
    sequence = Sequence.from_arrays(np.stack([FRAME, FRAME]), np.stack([POSE, POSE]))
    calls = [
        lambda: grown.insert(some(), some()),
        lambda: grown.insert(some(), some(), time=some()),
        lambda: grown.insert_all(some(), progress=some()),
        lambda: Reconstructor(**keywords()),
        lambda: Sequence.from_arrays(some(), some(), some(), name=some()),
        lambda: Sequence.open(
            some(), **{chance.choice(["config", "frames", "image_to_probe", "world"]): some()}
        ),
        lambda: sequence[some()],
        lambda: volume[some()],
        lambda: volume[some(), some()],
        lambda: volume.weights(some()),
        lambda: Volume.from_arrays(some(), some()),
        lambda: Volume.from_arrays(
            np.ones((2, 2, 2)), spacing=some(), origin=some(), direction=some()
        ),
        lambda: Volume.open(some(), weights=some(), memory=some()),
        lambda: volume.write(
            some(), **{chance.choice(["type", "window", "unseen", "fill", "size"]): some()}
        ),
    ]
    raised: dict[str, int] = {}
    for _ in range(CASES):
        call = chance.choice(calls)
        try:
            call()
        except (SonoweaveError, TypeError, IndexError, OSError) as error:
            raised[type(error).__name__] = raised.get(type(error).__name__, 0) + 1
        except UnicodeEncodeError:
            # Text that is no Unicode cannot be passed on.
            raised["UnicodeEncodeError"] = raised.get("UnicodeEncodeError", 0) + 1
        now = grown.ledger["frames"]["used"]
        if now == used:
            continue
        used, bits = now, grown.snapshot().values()
    assert np.array_equal(grown.snapshot().values(), bits) and np.array_equal(
        volume.values(), before
    )
    assert sum(raised.values()) > CASES // 2 and {"InputError", "TypeError", "FrameRefused"} <= set(
        raised
    ), raised
