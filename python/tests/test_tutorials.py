"""The tutorials, as their readers run them."""

from __future__ import annotations

import pathlib
import re
import shutil
import subprocess
import sys

import pytest
from sonoweave import Calibration, Volume

TUTORIALS = pathlib.Path(__file__).parents[1] / "tutorials"


def run(name: str, *arguments: object) -> str:
    command = [sys.executable, TUTORIALS / name, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_offline(sweep, tmp_path) -> None:
    pytest.importorskip("matplotlib")
    printed = run("offline.py", sweep, tmp_path)
    assert "used 60, refused {}" in printed and "to the rounded volume: 0" in printed
    for name in ("view.png", "planes.png", "plot.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_live(program, tmp_path) -> None:
    pytest.importorskip("websockets")
    command = [
        program,
        "demo",
        "--headless",
        "--console=127.0.0.1:0",
        "-o",
        tmp_path,
        "--duration=60",
    ]
    child = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=tmp_path
    )
    try:
        found = next(
            filter(None, (re.search(r"http://127\.0\.0\.1:\d+", line) for line in child.stdout))
        )
        printed = run("live.py", found[0])
    finally:
        child.terminate()
        child.wait(30)
    assert printed.count("pixels") == 3 and "frozen" in printed and "refused: /v1/do" in printed


def test_calibrate(program, tmp_path) -> None:
    scene = ["--scene=n-wire", "--image-size=320x240", "--tracker-noise=0.05,0.05"]
    truth = tmp_path / "truth.toml"
    scan = [program, "phantom", "-o", tmp_path / "wires.igs.mha", *scene, "--seed=1"]
    files = [f"--phantom={tmp_path / 'phantom.toml'}", f"--calibration={truth}"]
    subprocess.run([*scan, *files], check=True, capture_output=True)
    scan = [program, "phantom", "-o", tmp_path / "check.igs.mha", *scene, "--seed=2"]
    subprocess.run(
        [*scan, "--frames=60", f"--calibration={truth}"], check=True, capture_output=True
    )
    recorded = [tmp_path / name for name in ("phantom.toml", "wires.igs.mha", "check.igs.mha")]
    printed = run("calibrate.py", *recorded, tmp_path)
    assert "60 frames used" in printed and (tmp_path / "probe.html").stat().st_size > 1000
    error = float(re.search(r"validation ([0-9.]+) mm", printed)[1])
    assert error < 0.2
    found, true = (
        Calibration.read(tmp_path / f"{name}.toml").probe_from_image for name in ("probe", "truth")
    )
    assert abs(found[:3, [0, 1, 3]] - true[:3, [0, 1, 3]]).max() < 0.5


def test_cluster(sweep, tmp_path) -> None:
    pytest.importorskip("distributed")
    sweeps = [tmp_path / f"{name}.igs.mha" for name in "abc"]
    for one in sweeps:
        shutil.copy(sweep, one)
    printed = run("cluster.py", tmp_path, *sweeps)
    assert sorted(line.split(": ")[1] for line in printed.splitlines()) == ["60"] * 3
    volumes = [Volume.open(tmp_path / f"{name}.mha").values() for name in "abc"]
    assert (
        (volumes[0] == volumes[1]).all()
        and (volumes[0] == volumes[2]).all()
        and volumes[0].max() > 50
    )
    assert run("cluster.py", tmp_path, *sweeps).count("kept") == 3
