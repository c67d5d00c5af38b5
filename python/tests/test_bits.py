"""The same bits as the command line's."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest
import sonoweave
from conftest import Reconstructed
from sonoweave import InputError, Reconstructor, Sequence, Volume

#: Recordings of PLUS and their configurations.
RECORDINGS = [
    (
        "freehand/SpinePhantomFreehand.igs.mha",
        "freehand/PlusDeviceSet_VolumeReconstructionOnly_SpinePhantom_NN_MEAN.xml",
    ),
    (
        "freehand/NwirePhantomFreehand.igs.mha",
        "freehand/PlusDeviceSet_VolumeReconstructionOnly_SonixRP_TRUS_D70mm_LN_MEAN.xml",
    ),
    (
        "freehand/NwirePhantomFreehand.igs.nrrd",
        "freehand/PlusDeviceSet_VolumeReconstructionOnly_SonixRP_TRUS_D70mm_LN_MEAN.xml",
    ),
]
SETTINGS = [
    {},
    {"spacing": (0.5, 0.6, 0.7), "method": "bspline3", "compound": "maximum", "threads": 1},
    {"sigma": "auto", "max_weight": 3, "clip": "auto", "simd": "portable", "threads": 2},
    {"path": "planar", "planar_tolerance": 1000, "clip": "none", "departure": "refuse"},
]


def same(volume: Volume, written: Reconstructed) -> None:
    values, weights = written.arrays()
    assert volume.shape == values.shape
    assert np.array_equal(volume.values().view(np.uint32), values.view(np.uint32))
    assert np.array_equal(volume.weights().view(np.uint32), weights.view(np.uint32))
    assert (values > 0).sum() > 1000


def flags(settings: dict[str, object]) -> list[str]:
    def text(value: object) -> str:
        return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)

    return [f"--{name.replace('_', '-')}={text(value)}" for name, value in settings.items()]


@pytest.mark.parametrize(
    "settings", SETTINGS, ids=lambda settings: "-".join(settings) or "defaults"
)
def test_insert_all_has_command_lines_bits(program, sweep, tmp_path, settings) -> None:
    written = Reconstructed(program, sweep, tmp_path, *flags(settings))
    reconstructor = Reconstructor(**settings)
    ledger = reconstructor.insert_all(Sequence.open(sweep))
    same(reconstructor.snapshot(), written)
    assert ledger == reconstructor.ledger
    assert ledger["frames"] == written.report["frames"]


def test_insert_all_of_arrays_has_command_lines_bits(program, sweep, tmp_path) -> None:
    written = Reconstructed(program, sweep, tmp_path)
    sequence = Sequence.open(sweep)
    again = Sequence.from_arrays(np.stack(list(sequence)), sequence.poses, sequence.times)
    reconstructor = Reconstructor()
    reconstructor.insert_all(again)
    same(reconstructor.snapshot(), written)


@pytest.mark.parametrize("clip", ["none", "auto"])
def test_insert_loop_has_command_lines_bits(program, sweep, tmp_path, clip) -> None:
    written = Reconstructed(program, sweep, tmp_path, f"--clip={clip}", "--path=general")
    sequence = Sequence.open(sweep)
    reconstructor = Reconstructor(clip=clip)
    touched = [
        reconstructor.insert(frame, pose, time=time)
        for frame, pose, time in zip(sequence, sequence.poses, sequence.times, strict=True)
    ]
    same(reconstructor.snapshot(), written)
    frames = reconstructor.ledger["frames"]
    assert frames["total"] == frames["used"] == len(sequence) and frames["waiting"] == 0
    assert all(bricks.shape[1] == 3 for bricks in touched)
    assert len(touched[-1]) > 0


@pytest.mark.parametrize(
    ("recording", "config"), RECORDINGS, ids=lambda path: pathlib.Path(path).stem
)
def test_recordings_have_command_lines_bits(
    program, recordings, tmp_path, recording, config
) -> None:
    recording, config = recordings / recording, recordings / config
    settings = {"spacing": 1.0}
    written = Reconstructed(program, recording, tmp_path, "--config", str(config), *flags(settings))
    sequence = Sequence.open(recording, config=config)
    reconstructor = Reconstructor(**settings)
    ledger = reconstructor.insert_all(sequence)
    same(reconstructor.snapshot(), written)
    assert ledger["frames"] == written.report["frames"]
    assert sequence.status.count("ok") == np.isfinite(sequence.poses[:, 0, 0]).sum()


def test_written_file_is_command_lines_byte_for_byte(program, sweep, tmp_path) -> None:
    written = Reconstructed(program, sweep, tmp_path)
    reconstructor = Reconstructor()
    reconstructor.insert_all(Sequence.open(sweep))
    report = reconstructor.snapshot().write(
        tmp_path / "again.mha", type="f32", weights=tmp_path / "again-weights.mha"
    )
    assert (tmp_path / "again.mha").read_bytes() == written.path.read_bytes()
    assert (tmp_path / "again-weights.mha").read_bytes() == written.weights_path.read_bytes()
    assert report is not None and report["frames"] == written.report["frames"]
    assert report["input_sha256"] == written.report["input_sha256"]


def test_errors_and_planes_are_the_command_lines(program, sweep, tmp_path) -> None:
    names = {"error": "e.mha", "planes": "p.png"}
    flags = [f"--{name}={tmp_path / file}" for name, file in names.items()]
    Reconstructed(program, sweep, tmp_path, "--first-moment", *flags)
    own = {name: str(tmp_path / f"own-{file}") for name, file in names.items()}
    reconstructor = Reconstructor(error=own["error"])
    reconstructor.insert_all(Sequence.open(sweep))
    report = reconstructor.snapshot().write(
        tmp_path / "own.mha", type="f32", first_moment=True, planes=own["planes"]
    )
    assert report is not None and report["standard_error"]["median"] > 0
    assert report["first_moment"]["change"] > 0
    for file in names.values():
        assert (tmp_path / f"own-{file}").read_bytes() == (tmp_path / file).read_bytes()
    plain = Reconstructor()
    plain.insert_all(Sequence.open(sweep))
    with pytest.raises(InputError, match="keeps no sums for standard errors"):
        plain.snapshot().write(tmp_path / "no.mha", error=str(tmp_path / "no-e.mha"))
    assert not (tmp_path / "no.mha").exists()


def test_frames_in_part_are_those_of_the_command_line(program, sweep, tmp_path) -> None:
    written = Reconstructed(program, sweep, tmp_path, "--frames=10..40")
    sequence = Sequence.open(sweep, frames=range(10, 40))
    assert len(sequence) == 30
    assert np.array_equal(sequence[0], Sequence.open(sweep)[10])
    assert np.array_equal(sequence.poses, Sequence.open(sweep).poses[10:40])
    reconstructor = Reconstructor()
    reconstructor.insert_all(sequence)
    same(reconstructor.snapshot(), written)


def test_two_sequences_are_one_after_the_other(sweep) -> None:
    parts, whole = (
        Reconstructor(clip="none", path="general"),
        Reconstructor(clip="none", path="general"),
    )
    for frames in (range(25), range(25, 60)):
        parts.insert_all(Sequence.open(sweep, frames=frames))
    whole.insert_all(Sequence.open(sweep))
    assert np.array_equal(parts.snapshot().values(), whole.snapshot().values())
    assert np.array_equal(parts.snapshot().weights(), whole.snapshot().weights())
    assert parts.ledger["frames"] == whole.ledger["frames"]


def test_snapshot_does_not_follow(sweep) -> None:
    reconstructor = Reconstructor(clip="none")
    reconstructor.insert_all(Sequence.open(sweep, frames=range(20)))
    snapshot = reconstructor.snapshot()
    before = snapshot.values()
    reconstructor.insert_all(Sequence.open(sweep, frames=range(20, 60)))
    assert np.array_equal(snapshot.values(), before)
    assert snapshot.ledger is not None and snapshot.ledger["frames"]["used"] == 20
    assert reconstructor.snapshot().weights().sum() > snapshot.weights().sum()


@pytest.mark.parametrize(
    "name", ["v.mha", "v.mhd", "v.nrrd", "v.nhdr", "v.nii", "v.nii.gz", "v.ome.zarr"]
)
def test_written_formats_read_back_to_same_values(grown, tmp_path, name) -> None:
    volume = grown.snapshot()
    weights = None if name.endswith("zarr") else tmp_path / name.replace("v.", "w.")
    volume.write(tmp_path / name, type="f32", weights=weights)
    again = Volume.open(tmp_path / name, weights=weights)
    # OME-Zarr has whole shards; both have the voxels in the same places.
    shift = np.rint((np.array(volume.origin) - again.origin) / volume.spacing).astype(int)[::-1]
    box = tuple(slice(at, at + n) for at, n in zip(shift, volume.shape, strict=True))
    assert name.endswith("zarr") or again.shape == volume.shape
    assert np.array_equal(again[box], volume.values())
    assert np.array_equal(again.weights(box), volume.weights())
    assert np.allclose(again.world_from_volume[:3, :3], volume.world_from_volume[:3, :3], atol=1e-6)


def test_dicom_is_written(grown, tmp_path) -> None:
    grown.snapshot().write(tmp_path / "v.dcm", type="u8", patient_id="P1", patient_name="Phantom")
    assert (tmp_path / "v.dcm").read_bytes()[128:132] == b"DICM"


def test_version_is_the_programs(program) -> None:
    import subprocess

    printed = subprocess.run(
        [program, "--version"], check=True, capture_output=True, text=True
    ).stdout
    assert sonoweave.__version__ in printed


def test_folder_with_one_recording_is_opened(sweep, tmp_path) -> None:
    with pytest.raises(sonoweave.InputError, match="holds no recording; give the file, one of .mha"):
        Sequence.open(tmp_path)
    (tmp_path / "sweep.igs.mha").write_bytes(sweep.read_bytes())
    (tmp_path / "calibration.toml").write_text("")
    opened, file = Sequence.open(tmp_path), Sequence.open(sweep)
    assert np.array_equal(opened[3], file[3]) and np.array_equal(opened.poses, file.poses)
    (tmp_path / "other.mcap").write_text("")
    with pytest.raises(sonoweave.InputError, match=r"2 recordings \(other.mcap, sweep.igs.mha\)"):
        Sequence.open(tmp_path)
