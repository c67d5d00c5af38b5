"""Recorded sessions: the bits of their replay."""

from __future__ import annotations

import json
import pathlib
import pickle
import subprocess

import numpy as np
import pytest
from conftest import ROOT, mha
from sonoweave import InputError, Reconstructor, Sequence, Volume

#: Sessions that are part of the project: one with an arm, one with all commands, one of a demo.
SESSIONS = ROOT / "tests" / "recordings" / "sessions"

BEDSIDE = """format = "sonoweave-bedside"
version = 1
[tracker]
model = "fastrak"
port = "virtual"
reference_station = 2
[grabber]
device = "virtual"
size = "96x80"
latency_ms = 40.0
[volume]
spacing_mm = 1.0
[virtual]
frames = 60
[virtual.line]
dropout = 0.02
[virtual.grabber]
latency_ms = 40.0
dropout = 0.02
"""


class Replayed:
    """A volume that the program's replay of a session has written, and its report."""

    def __init__(self, program: str, session: pathlib.Path, folder: pathlib.Path, *flags) -> None:
        self.values, self.weights = folder / "replayed.mha", folder / "replayed-weights.mha"
        report = folder / "replayed.json"
        outputs = ["-o", self.values, "--weights", self.weights, f"--json={report}"]
        words = [program, "replay", session, *outputs, *flags]
        subprocess.run(words, check=True, capture_output=True)
        self.report = json.loads(report.read_text())

    def is_of(self, reconstructor: Reconstructor, folder: pathlib.Path) -> None:
        """Compare bits of values and weights, and the accounts."""
        volume = reconstructor.snapshot()
        volume.write(folder / "v.mha", weights=folder / "w.mha")
        assert data(folder / "v.mha") == data(self.values)
        again = mha(self.weights)
        assert np.array_equal(volume.weights().view(np.uint32), again.view(np.uint32))
        assert (again > 0).sum() > 1000
        assert volume.ledger is not None and volume.ledger["frames"] == self.report["frames"]


def data(path: pathlib.Path) -> bytes:
    """Return the voxels of a file."""
    return path.read_bytes().split(b"ElementDataFile = LOCAL\n", 1)[1]


@pytest.mark.parametrize("name", ["arm", "commands", "demo"])
def test_insert_all_has_replays_bits(program, tmp_path, name) -> None:
    session = SESSIONS / f"{name}.mcap"
    replayed = Replayed(program, session, tmp_path)
    sequence, reconstructor, calls = Sequence.open(session), Reconstructor(threads=1), []
    ledger = reconstructor.insert_all(sequence, progress=lambda *call: calls.append(call))
    replayed.is_of(reconstructor, tmp_path)
    assert {key: ledger[key] for key in ("frames", "readings")} == {
        key: replayed.report[key] for key in ("frames", "readings")
    }
    # The volume's values, too, are those that the session had when it was live.
    assert replayed.report["digest"] is not None
    assert [note for note in reconstructor.snapshot().notes if "differs" in note] == []
    assert calls[-1] == (len(sequence), len(sequence)) == (ledger["frames"]["total"],) * 2


@pytest.fixture(scope="module")
def recorded(program, tmp_path_factory) -> pathlib.Path:
    """A folder with a session, bedside.toml, and a session that continues the first."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "bedside.toml").write_text(BEDSIDE)
    live = [program, "live", "--config=bedside.toml", "--duration=2"]
    for record, more in [("first", []), ("second", None)]:
        if more is None:
            more = [f"--resume={next((folder / 'first').iterdir())}"]
        words = [*live, f"--record={record}", *more]
        subprocess.run(words, check=True, capture_output=True, cwd=folder)
    return folder


@pytest.mark.parametrize("name", ["arm", "commands", "demo"])
def test_frames_without_pose_have_reasons_of_ledger(name) -> None:
    sequence = Sequence.open(SESSIONS / f"{name}.mcap")
    posed = np.array(sequence.status) == "ok"
    assert sequence.poses.shape == (len(sequence), 4, 4) and posed.sum() > 10
    assert np.isfinite(sequence.poses[posed]).all() and np.isnan(sequence.poses[~posed]).all()
    assert np.isfinite(sequence.times[posed]).all() and np.isnan(sequence.times[~posed]).all()
    assert (np.diff(sequence.times[posed]) > 0).all()
    reasons = {reason: sequence.status.count(reason) for reason in set(sequence.status) - {"ok"}}
    frames = Reconstructor().insert_all(sequence)["frames"]
    assert reasons == frames["refused"] and posed.sum() == frames["used"]
    assert ("frozen" in reasons) == (name == "commands")


def test_loop_over_frames_has_bits_of_insert_all(program, recorded, tmp_path) -> None:
    """Frames, poses and times are those that the replay inserts."""
    session = next((recorded / "first").iterdir())
    sequence, whole = Sequence.open(session), Reconstructor()
    whole.insert_all(sequence)
    fan = Replayed(program, session, tmp_path).report["mask"]["shape"]["fan"]
    sector = [*fan["origin_px"], *fan["radii_px"], *fan["angles_deg"]]
    loop = Reconstructor(spacing=1, clip="none", fan=sector, path="general")
    for at in np.flatnonzero(np.array(sequence.status) == "ok"):
        loop.insert(sequence[at], sequence.poses[at], time=sequence.times[at])
    one, other = whole.snapshot(), loop.snapshot()
    assert np.array_equal(one.values(), other.values()) and one.origin == other.origin
    assert np.array_equal(one.weights(), other.weights()) and one.weights().any()
    assert np.array_equal(sequence[-1], sequence[len(sequence) - 1])
    assert sequence.world == "Reference" and sequence.route.startswith("Image")


def test_continued_session_has_slices_before(program, recorded, tmp_path) -> None:
    first, second = (next((recorded / name).iterdir()) for name in ("first", "second"))
    replayed = Replayed(program, second, tmp_path)
    reconstructor = Reconstructor()
    reconstructor.insert_all(Sequence.open(second))
    replayed.is_of(reconstructor, tmp_path)
    notes = reconstructor.snapshot().notes
    assert any("the session continues" in note and first.name in note for note in notes)
    own = sum(status == "ok" for status in Sequence.open(second).status)
    assert reconstructor.ledger["frames"]["used"] == own


def test_other_configuration_is_as_in_replay(program, recorded, tmp_path) -> None:
    session, other = next((recorded / "first").iterdir()), tmp_path / "other.toml"
    other.write_text(BEDSIDE.replace("spacing_mm = 1.0", "spacing_mm = 1.5"))
    replayed = Replayed(program, session, tmp_path, f"--config={other}")
    sequence, reconstructor = Sequence.open(session, config=other), Reconstructor()
    reconstructor.insert_all(sequence)
    replayed.is_of(reconstructor, tmp_path)
    assert reconstructor.snapshot().spacing == (1.5, 1.5, 1.5)
    assert len(pickle.loads(pickle.dumps(sequence))) == len(sequence)


def test_session_and_sequence_share_volume(sweep) -> None:
    """What follows a session is inserted into its volume."""
    session, reconstructor = Sequence.open(SESSIONS / "demo.mcap"), Reconstructor()
    used = reconstructor.insert_all(session)["frames"]["used"]
    before = reconstructor.snapshot().weights().sum()
    sequence = Sequence.open(sweep)
    frame = np.resize(sequence[0], session[0].shape)
    reconstructor.insert(frame, sequence.poses[0], time=1.0)
    assert reconstructor.ledger["frames"]["used"] == used + 1
    assert reconstructor.snapshot().weights().sum() > before
    # Its settings are those of the volume that is there.
    other = Reconstructor(spacing=2.0, clip="none")
    other.insert(frame, sequence.poses[0])
    other.insert_all(session)
    assert other.snapshot().spacing == (2.0, 2.0, 2.0)
    assert other.ledger["frames"]["used"] == used + 1


def test_settings_and_files_that_do_not_fit_are_named(tmp_path) -> None:
    session = SESSIONS / "demo.mcap"
    for keywords in ({"frames": range(3)}, {"world": "Tracker"}, {"image_to_probe": np.eye(4)}):
        with pytest.raises(InputError, match=f"{next(iter(keywords))}: a session has settings"):
            Sequence.open(session, **keywords)
    sequence, reconstructor = Sequence.open(session), Reconstructor(spacing=2)
    with pytest.raises(InputError, match="spacing: a session is reconstructed by settings"):
        reconstructor.insert_all(sequence)
    assert reconstructor.ledger["frames"]["total"] == 0
    with pytest.raises(InputError, match="reconstructor|empty"):
        reconstructor.snapshot()
    with pytest.raises(FileNotFoundError):
        Sequence.open(session, config=tmp_path / "none.toml")
    (tmp_path / "cut.mcap").write_bytes(session.read_bytes()[:100])
    with pytest.raises(InputError, match="cut.mcap"):
        Sequence.open(tmp_path / "cut.mcap")
    (tmp_path / "text.mcap").write_text("no session")
    with pytest.raises(InputError, match="text.mcap"):
        Sequence.open(tmp_path / "text.mcap")


def test_written_file_names_session(tmp_path) -> None:
    reconstructor = Reconstructor()
    reconstructor.insert_all(Sequence.open(SESSIONS / "demo.mcap"))
    volume = reconstructor.snapshot()
    report = volume.write(tmp_path / "v.mha")
    head = (tmp_path / "v.mha").read_bytes().split(b"ElementDataFile", 1)[0].decode()
    assert "SonoweaveInput = demo.mcap sha256 " in head
    assert "SonoweaveCalibration = in the configuration" in head
    assert report is not None and len(report["input_sha256"]) == 64
    assert np.array_equal(Volume.open(tmp_path / "v.mha").values(), np.rint(volume.values()))


def test_corrections_beside_session_are_applied(program, tmp_path) -> None:
    noisy = BEDSIDE.replace("[virtual]", "[virtual]\ntracker_noise_mm = 0.3\ntracker_noise_deg = 0.3")
    (tmp_path / "bedside.toml").write_text(noisy)
    words = [program, "live", "--config=bedside.toml", "--duration=3", "--record=sessions"]
    subprocess.run(words, check=True, capture_output=True, cwd=tmp_path)
    session = next((tmp_path / "sessions").iterdir())
    before = Sequence.open(session)
    poses = before.poses
    subprocess.run([program, "correct", "smoothing", session], check=True, capture_output=True)
    after = Sequence.open(session)
    posed = (np.array(before.status) == "ok") & (np.array(after.status) == "ok")
    moved = np.abs(after.poses[posed][:, :3, 3] - poses[posed][:, :3, 3])
    assert posed.sum() > 20 and 0.05 < moved.mean() < 2.0
    replayed = Replayed(program, session, tmp_path)
    reconstructor = Reconstructor()
    reconstructor.insert_all(after)
    replayed.is_of(reconstructor, tmp_path)
    # Undone, the poses have the bits from before.
    subprocess.run([program, "correct", "undo", session, "1"], check=True, capture_output=True)
    assert np.array_equal(Sequence.open(session).poses, poses, equal_nan=True)
