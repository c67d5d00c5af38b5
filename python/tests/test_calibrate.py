"""Calibrations: the results of the commands, to the last digit."""

from __future__ import annotations

import json
import pathlib
import subprocess
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from sonoweave import (
    ArmCalibration,
    ArmCheck,
    Calibration,
    InputError,
    TrackerMap,
    TrackerNoise,
    calibrate_arm,
    calibrate_crossings,
    calibrate_landmarks,
    calibrate_latency,
    calibrate_pivot,
    calibrate_probe,
    calibrate_tracker,
)

#: Recorded session of an arm, part of the project.
ARM = pathlib.Path(__file__).parents[2] / "tests" / "recordings" / "sessions" / "arm.mcap"
TIP = np.array([2.0, -5.0, 140.0])
LANDMARKS = np.array([[0, 0, 0], [80, 5, 0], [75, 50, 20], [-5, 45, 5], [10, 0, 40]], float)

Command = Callable[..., dict[str, Any]]


@pytest.fixture
def command(program, tmp_path) -> Command:
    """Runs a command of ``calibrate`` with its report; returns the latter."""

    def run(quantity: str, *flags: object, code: int = 0) -> dict[str, Any]:
        report = tmp_path / "command.json"
        words = [program, "calibrate", quantity, *map(str, flags), f"--json={report}"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        return json.loads(report.read_text())

    return run


def same(report: dict[str, Any], by_command: dict[str, Any]) -> None:
    """Compare reports, but for the times that the work took."""
    times = {"looked_s", "solved_s"}
    assert set(report) == set(by_command)
    for key in set(report) - times:
        assert report[key] == by_command[key], key


def turned(axis: np.ndarray) -> np.ndarray:
    """Return a rotation by its axis times the angle, rad; (3, 3)."""
    angle = np.linalg.norm(axis)
    x, y, z = axis / (angle or 1.0)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def posed(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Return a pose, (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def tracked(
    path: pathlib.Path,
    times: np.ndarray,
    sensors: dict[str, list[np.ndarray]],
    frames: np.ndarray | None = None,
) -> pathlib.Path:
    """Write a tracked sequence: poses in the tracker's frame, with or without frames."""
    count = len(times)
    size = "0 0" if frames is None else f"{frames.shape[2]} {frames.shape[1]}"
    head = [
        "ObjectType = Image",
        "NDims = 3",
        "BinaryData = True",
        "BinaryDataByteOrderMSB = False",
        "CompressedData = False",
        f"DimSize = {size} {count}",
        "Kinds = domain domain list",
        "ElementNumberOfChannels = 1",
        f"ElementType = {'MET_OTHER' if frames is None else 'MET_UCHAR'}",
        "UltrasoundImageOrientation = MFA",
        "UltrasoundImageType = BRIGHTNESS",
    ]
    for at, time in enumerate(times):
        for name, poses in sensors.items():
            rows = " ".join(repr(float(number)) for number in poses[at].ravel())
            head += [f"Seq_Frame{at:04}_{name}ToTrackerTransform = {rows}"]
            head += [f"Seq_Frame{at:04}_{name}ToTrackerTransformStatus = OK"]
        head += [f"Seq_Frame{at:04}_Timestamp = {float(time)!r}"]
        head += [f"Seq_Frame{at:04}_ImageStatus = {'INVALID' if frames is None else 'OK'}"]
    text = "\n".join(head) + "\nElementDataFile = LOCAL\n"
    path.write_bytes(text.encode() + (b"" if frames is None else frames.tobytes()))
    return path


def touched(path: pathlib.Path, tips: np.ndarray) -> pathlib.Path:
    """Write poses of a swinging stylus whose tip is there, 20 a second."""
    times = np.arange(len(tips)) / 20
    reference = [
        posed(turned(np.array([0, 0.5 + 0.02 * np.sin(t), 0])), np.array([200, -30, 100 + t]))
        for t in times
    ]
    stylus = []
    for t, tip, pose in zip(times, tips, reference, strict=True):
        swing = 0.5 * np.array([np.cos(2.3 * t), np.sin(2.3 * t), 0.4 * np.sin(t)])
        turn = turned(swing) @ turned(np.array([2.4, 0.3, -0.1]))
        stylus.append(pose @ posed(turn, tip - turn @ TIP))
    return tracked(path, 100 + times, {"Stylus": stylus, "Reference": reference})


def swung(path: pathlib.Path) -> pathlib.Path:
    return touched(path, np.tile([30.0, 10.0, -20.0], (240, 1)))


def test_recorded_scan_has_command_lines_result(program, recordings, tmp_path) -> None:
    folder = recordings / "nwire"
    files = {
        "sequence": folder / "fCal_Test_Calibration_3NWires.igs.mha",
        "phantom": folder / "PlusDeviceSet_fCal_Sim_SpatialCalibration_1.2.xml",
        "validate": folder / "fCal_Test_Validation_3NWires.igs.mha",
    }
    flags = [f"--{name}={path}" for name, path in files.items()]
    outputs = ["-o", tmp_path / "by-command.toml", f"--json={tmp_path / 'report.json'}"]
    command = [program, "calibrate", "probe", *flags, *outputs]
    subprocess.run(command, check=True, capture_output=True)
    report = json.loads((tmp_path / "report.json").read_text())
    result = calibrate_probe(**files, output=tmp_path / "calibration.toml")
    assert result.probe_from_image.ravel().tolist() == report["image_to_probe"]
    assert result.validation_error == report["validation_error_mm"]["mean"] < 2
    assert (tmp_path / "calibration.toml").read_text() == (tmp_path / "by-command.toml").read_text()
    written = Calibration.read(tmp_path / "calibration.toml").probe_from_image
    assert np.allclose(written, result.probe_from_image, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    ("method", "scene"), [("point", "cross-wire"), ("stylus", "cross-wire"), ("plane", "plane")]
)
def test_probe_by_each_target_is_commands(program, command, tmp_path, method, scene) -> None:
    sweep = tmp_path / "sweep.igs.mha"
    flags = ["--trajectory=about", "--frames=120", "--image-size=160x120", "--seed=3"]
    flags += ["--tracker-noise=0.05,0.05", f"--calibration={tmp_path / 'truth.toml'}"]
    words = [program, "phantom", "-o", sweep, f"--scene={scene}", *flags]
    subprocess.run(words, check=True, capture_output=True)
    settings: dict[str, Any] = {"method": method}
    if method == "stylus":
        point = calibrate_probe(sweep, method="point").report["target"]["point_mm"]
        rows = posed(np.eye(3), np.array(point)).ravel().tolist()
        (tmp_path / "tip.toml").write_text(
            'format = "sonoweave-calibration"\nversion = 1\n[[transform]]\nfrom = "StylusTip"\n'
            f'to = "Reference"\nmatrix = {rows}\n'
        )
        settings |= {"stylus_tip": tmp_path / "tip.toml", "stylus": "Reference"}
    result = calibrate_probe(sweep, **settings)
    said = [f"--{name.replace('_', '-')}={value}" for name, value in settings.items()]
    by_command = command("probe", f"--sequence={sweep}", *said)
    same(result.report, by_command)
    assert result.probe_from_image.ravel().tolist() == by_command["image_to_probe"]
    assert result.error == by_command["error_mm"]["mean"] < 1
    assert result.report["reproducibility_mm"] is not None


def test_tip_and_landmarks_are_commands_in_one_file(command, tmp_path) -> None:
    swing, file = swung(tmp_path / "swing.mha"), tmp_path / "cal.toml"
    tip = calibrate_pivot(swing, output=file, from_=1, to=11.5)
    same(tip.report, command("pivot", f"--sequence={swing}", "--from=1", "--to=11.5"))
    assert tip.tip.shape == (3,) and np.allclose(tip.tip, TIP, atol=1e-6)
    assert tip.covariance.shape == (3, 3) and tip.error < 1e-6
    assert np.allclose(tip.stylus_from_tip[:3, 3], tip.tip)

    held = posed(turned(np.array([0.2, -0.9, 0.4])), np.array([-12.0, 8.0, 33.0]))
    tips, at = [], np.array([-90.0, 0.0, 120.0])
    for landmark in LANDMARKS:
        to = held[:3, :3] @ landmark + held[:3, 3]
        tips += [at + (to - at) * i / 14 + [0, 0, i * (14 - i)] for i in range(1, 14)]
        tips += [to] * 40
        at = to
    sequence = touched(tmp_path / "touched.mha", np.array(tips))
    holes = [
        f'[[landmark]]\nname = "#{at}"\nposition_mm = {place.tolist()}\n'
        for at, place in enumerate(LANDMARKS)
    ]
    phantom = tmp_path / "phantom.toml"
    begin = 'format = "sonoweave-phantom"\nversion = 1\nname = "five holes"\n'
    phantom.write_text(begin + "".join(holes))
    found = calibrate_landmarks(sequence, phantom, stylus_tip=file, output=file)
    flags = [f"--sequence={sequence}", f"--phantom={phantom}", f"--stylus-tip={file}"]
    by_command = command("landmarks", *flags)
    # The file has changed since it was read.
    by_command["stylus_tip"]["sha256"] = found.report["stylus_tip"]["sha256"]
    same(found.report, by_command)
    assert np.allclose(found.reference_from_phantom, held, atol=1e-6) and found.error < 1e-6
    assert found.touched == ("#0", "#1", "#2", "#3", "#4") and found.missed == ()
    assert found.covariance.shape == (6, 6)
    written = Calibration.read(file).transforms
    assert np.allclose(written["StylusTip", "Stylus"], tip.stylus_from_tip)
    assert np.allclose(written["Phantom", "Reference"], found.reference_from_phantom)


def test_latency_by_floor_is_commands(command, tmp_path) -> None:
    def height(time: np.ndarray) -> np.ndarray:
        return 7 * np.sin(6.2832 * 0.9 * time + 1.4 * np.sin(0.8168 * time)) + np.cos(1.9478 * time)

    times = 100 + 0.07 * np.arange(200) + 0.004 * np.sin(2.3 * np.arange(200))
    v, u = np.mgrid[:140, :160].astype(float)
    frames = np.empty((200, 140, 160), np.uint8)
    for at, time in enumerate(times):
        row = 70 + height(time) / 0.2 + 0.1 * (u - 80)
        grain = 0.7 + 0.3 * np.sin(1.3 * u + 0.2 * at)
        frames[at] = 150 * grain * np.exp(-0.2 * (v - row) ** 2)
    video = tracked(tmp_path / "video.mha", times, {}, frames)
    times = 98 + 0.02 * np.arange(900)
    poses = [posed(np.eye(3), np.array([30, -20, 100 + height(t - 0.060)])) for t in times]
    tracker = tracked(tmp_path / "tracker.mha", times, {"Probe": poses})
    found = calibrate_latency(
        video=video, tracker=tracker, video_latency_ms=40, output=tmp_path / "cal.toml"
    )
    flags = [f"--video={video}", f"--tracker={tracker}", "--video-latency-ms=40"]
    same(found.report, command("latency", *flags))
    assert found.method == "line" and abs(found.lag - 0.060) < 0.003 > found.lag_error
    assert found.video == 0.040 and np.isclose(found.tracker, found.video + found.lag)
    assert Calibration.read(tmp_path / "cal.toml").latency == pytest.approx(
        {"video": found.video, "tracker": found.tracker}
    )


def test_crossings_are_commands(command, program, tmp_path) -> None:
    scan, used = tmp_path / "scan.mha", tmp_path / "probe.toml"
    flags = ["--trajectory", "three-directions", "--image-size", "160x150", "--pixel", "0.3"]
    flags += ["--frames", "120", "--gap", "0.9", "--seed", "5", "--calibration", used]
    subprocess.run([program, "phantom", "-o", scan, *flags], check=True, capture_output=True)
    right = calibrate_crossings(scan, config=used)
    same(right.report, command("crossings", f"--sequence={scan}", f"--config={used}"))
    assert not (right.slipped or right.late or right.undecided) and right.shift < 0.1

    before = Calibration.read(used).probe_from_image
    text = used.read_text()
    for number, shift in zip(before[:3, 3], [0.8, -0.5, 0.4], strict=True):
        moved = number + shift
        assert text.count(repr(float(number))) == 1
        text = text.replace(repr(float(number)), repr(float(moved)))
    slipped = tmp_path / "slipped.toml"
    slipped.write_text(text)
    found = calibrate_crossings(scan, config=slipped, output=tmp_path / "new.toml")
    assert found.slipped and abs(found.shift - 1.0) < 0.1 > found.shift_error
    assert abs(found.lag) < 0.005 and found.lag_error < 0.005
    assert np.allclose(found.probe_from_image[:3, 3], before[:3, 3], atol=0.1)
    written = Calibration.read(tmp_path / "new.toml").probe_from_image
    assert np.allclose(written, found.probe_from_image)
    with pytest.raises(InputError, match="exists already"):
        calibrate_crossings(scan, config=slipped, output=tmp_path / "new.toml")


def test_tracker_noise_and_map_are_commands(command, tmp_path) -> None:
    random, times = np.random.default_rng(4), np.arange(600) / 60
    rest = [
        posed(
            turned(random.normal(0, 5e-4, 3)), np.array([200, -40, 90]) + random.normal(0, 0.05, 3)
        )
        for _ in times
    ]
    lying = tracked(tmp_path / "lying.mha", 100 + times, {"Probe": rest})
    noise = calibrate_tracker(lying)
    same(noise.report, command("tracker", f"--sequence={lying}"))
    assert isinstance(noise, TrackerNoise)
    assert np.allclose(noise.position_sd, 0.05, rtol=0.2)
    assert np.allclose(noise.rotation_sd, np.degrees(5e-4), rtol=0.2)

    one = [
        posed(turned(np.array([0, 0, 4 * t])), np.array([100 + 400 * t, 20 * np.sin(9 * t), 150]))
        for t in times / 10
    ]
    other = [pose @ posed(np.eye(3), np.array([0, 0, 100.0])) for pose in one]
    for pose in other:
        pose[0, 3] += 4.0 * (pose[0, 3] > 350)
    carried = tracked(tmp_path / "carried.mha", 100 + times, {"Probe": one, "Reference": other})
    room = calibrate_tracker(carried, other="Reference", cell=40, output=tmp_path / "cal.toml")
    same(room.report, command("tracker", f"--sequence={carried}", "--other=Reference", "--cell=40"))
    assert isinstance(room, TrackerMap) and room.cell == 40
    count = len(room.report["cells"])
    assert room.corners.shape == (count, 3) and room.errors.shape == room.distorted.shape == (
        count,
    )
    assert room.distorted.any() and (room.corners[room.distorted, 0] >= 320).all()
    assert (room.errors[room.distorted] > 1).all() and (room.errors[~room.distorted] <= 1).all()


def test_arm_and_its_check_are_commands(command, tmp_path) -> None:
    """An arm that rests now and then, which is enough for two numbers."""
    which: dict[str, Any] = {"rest": 0.05, "still": 20, "skip": [5, 10, 11]}
    flags = [f"--session={ARM}", "--point", "--rest=0.05", "--still=20", "--skip=5,10,11"]
    fit: dict[str, Any] = {"keep": "zero3,length3,length2", "limit": 1000, "seat": 30}
    arm = calibrate_arm(ARM, point=True, output=tmp_path / "arm.toml", **which, **fit)
    said = ["--keep=zero3,length3,length2", "--limit=1000", "--seat=30"]
    same(arm.report, command("arm", *flags, *said))
    assert isinstance(arm, ArmCalibration) and len(arm.joints) == 3 and 0 < arm.error < 5
    for file, changed in [("arm.toml", False), ("other.toml", True)]:
        by = tmp_path / file
        if changed:
            zero = arm.joints[1]["zero_counts"]
            text = (tmp_path / "arm.toml").read_text()
            assert text.count(f"zero_counts = {zero!r}") == 1
            by.write_text(text.replace(f"{zero!r}", f"{zero + 9000!r}"))
        checked = calibrate_arm(ARM, point=True, check=True, arm=by, seat=1, **which)
        said = ["--check", f"--arm={by}", "--seat=1"]
        same(checked.report, command("arm", *flags, *said, code=int(changed)))
        assert isinstance(checked, ArmCheck) and checked.changed is changed


def test_session_is_recognised_as_sequence(command) -> None:
    with pytest.raises(InputError) as refused:
        calibrate_pivot(ARM)
    assert "Stylus" in str(refused.value) and "arm.mcap" in str(refused.value)
    with pytest.raises(InputError, match="session"):
        calibrate_pivot(ARM, session=ARM)


def test_impossible_calibrations_are_named(sweep, tmp_path) -> None:
    with pytest.raises(FileNotFoundError) as missing:
        calibrate_probe(sweep, tmp_path / "none.toml")
    assert missing.value.filename == str(tmp_path / "none.toml")
    with pytest.raises(InputError, match="live"):
        calibrate_probe(sweep, tmp_path / "none.toml", live="bedside.toml")
    (tmp_path / "phantom.toml").write_text("format = 3")
    with pytest.raises(InputError, match="phantom.toml"):
        calibrate_probe(sweep, tmp_path / "phantom.toml")
    with pytest.raises(InputError, match="give --phantom"):
        calibrate_probe(sweep)
    with pytest.raises(InputError, match="no effect with --method point"):
        calibrate_probe(sweep, tmp_path / "phantom.toml", method="point")
