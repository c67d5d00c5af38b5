"""Calibration of a probe: the result of the command line."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest
from sonoweave import Calibration, InputError, calibrate_probe


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


def test_impossible_calibrations_are_named(sweep, tmp_path) -> None:
    with pytest.raises(OSError):
        calibrate_probe(sweep, tmp_path / "none.toml")
    with pytest.raises(InputError, match="live"):
        calibrate_probe(sweep, tmp_path / "none.toml", live="bedside.toml")
    (tmp_path / "phantom.toml").write_text("format = 3")
    with pytest.raises(InputError, match="phantom.toml"):
        calibrate_probe(sweep, tmp_path / "phantom.toml")
