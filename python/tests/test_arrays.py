"""Arrays of sequences and volumes."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from sonoweave import Calibration, CalibrationError, InputError, Reconstructor, Sequence, Volume

TOML = """format = "sonoweave-calibration"
version = 1

[image_to_probe]
matrix = [0.1, 0, 0, -10, 0, 0.1, 0, 5, 0, 0, 0.1, 0, 0, 0, 0, 1]

[volume]
spacing_mm = [0.7, 0.7, 0.7]

[latency]
video_ms = 40
tracker_ms = 10

[[preset]]
name = "deep"
image_to_probe = [0.2, 0, 0, -20, 0, 0.2, 0, 5, 0, 0, 0.2, 0, 0, 0, 0, 1]
"""


@pytest.fixture
def volume() -> Volume:
    values = np.random.default_rng(5).random((7, 9, 11), np.float32)
    return Volume.from_arrays(values, spacing=(0.5, 0.6, 0.7), origin=(1, 2, 3))


@pytest.mark.parametrize(
    "key",
    [
        np.s_[:, :, :],
        np.s_[2:5, 1:9:2, ::-1],
        np.s_[-3, ..., 4],
        np.s_[..., 2:2],
        np.s_[3],
        np.s_[1, 2, 3],
        np.s_[::3, 8:1:-2, -1],
    ],
    ids=str,
)
def test_box_is_numpys(volume, key) -> None:
    assert np.array_equal(volume[key], volume.values()[key])


def test_box_of_snapshot_is_part_of_all(grown) -> None:
    volume = grown.snapshot()
    box = np.s_[3:10, 5:30:3, 2:9]
    assert np.array_equal(volume[box], volume.values()[box])
    assert np.array_equal(volume.weights(box), volume.weights()[box])
    assert np.array_equal(np.asarray(volume), volume.values())
    assert np.asarray(volume, np.float64).dtype == np.float64


@pytest.mark.parametrize("key", [(0, 0, 0, 0), 7, -8, "x", 1.0, (..., ...), None])
def test_wrong_box_is_index_error(volume, key) -> None:
    with pytest.raises(IndexError):
        volume[key]


def test_array_without_copy_is_refused(volume) -> None:
    with pytest.raises(ValueError, match="copy"):
        volume.__array__(copy=False)


def test_place_is_that_of_the_arrays(volume) -> None:
    assert volume.origin == (1, 2, 3) and volume.spacing == (0.5, 0.6, 0.7)
    assert np.allclose(
        volume.world_from_volume @ [2, 3, 4, 1], [1 + 2 * 0.5, 2 + 3 * 0.6, 3 + 4 * 0.7, 1]
    )
    turned = Volume.from_arrays(np.ones((2, 2, 2)), direction=[[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert np.allclose(turned.world_from_volume @ [1, 0, 0, 1], [0, 1, 0, 1])


def test_unseen_is_zero_with_weight_zero() -> None:
    values = np.array([[[1, np.nan, 3]]], np.float32)
    volume = Volume.from_arrays(values)
    assert volume.values().tolist() == [[[1, 0, 3]]] and volume.weights().tolist() == [[[1, 0, 1]]]
    volume = Volume.from_arrays([[[1.0, 2, 3]]], [[[0.0, 2, 0.5]]])
    assert volume.values().tolist() == [[[0, 2, 3]]] and volume.weights().tolist() == [
        [[0, 2, 0.5]]
    ]


def test_volume_of_arrays_is_written_and_read(volume, tmp_path) -> None:
    assert volume.write(tmp_path / "v.nrrd", weights=tmp_path / "w.mha") is None
    again = Volume.open(tmp_path / "v.nrrd", weights=tmp_path / "w.mha")
    assert np.array_equal(again.values(), volume.values())
    assert np.array_equal(again.weights(), volume.weights())
    assert volume.write(tmp_path / "v.ome.zarr") is None
    again = Volume.open(tmp_path / "v.ome.zarr")
    assert np.array_equal(again.values(), volume.values())
    assert np.array_equal(again.weights(), volume.weights())
    with pytest.raises(InputError, match="holds its weights itself"):
        volume.write(tmp_path / "w.ome.zarr", weights=tmp_path / "w.mha")
    with pytest.raises(InputError, match="reconstruction"):
        volume.write(tmp_path / "v.dcm")


def test_frames_of_any_layout_are_copied() -> None:
    frames = np.random.default_rng(1).integers(0, 255, (4, 30, 20), np.uint16)
    poses = np.tile(np.diag([0.5, 0.5, 0.5, 1]), (4, 1, 1))
    poses[:, 2, 3] = range(4)
    for layout in (
        frames,
        frames.astype(">u2"),
        np.asfortranarray(frames),
        frames[:, ::-1][:, ::-1],
    ):
        sequence = Sequence.from_arrays(layout, poses, [0, 0.1, 0.2, 0.3])
        assert all(
            np.array_equal(a, b) and a.dtype == np.uint16
            for a, b in zip(sequence, frames, strict=True)
        )
    frames_before, frames[:] = frames.copy(), 0
    assert np.array_equal(sequence[2], frames_before[2])
    assert np.array_equal(sequence.poses, poses) and sequence.times.tolist() == [0, 0.1, 0.2, 0.3]
    assert sequence.status == ["ok"] * 4 and sequence.world == "World"


def test_bad_poses_have_their_reason(sweep) -> None:
    sequence = Sequence.open(sweep)
    poses = sequence.poses
    poses[3, :3, :2] = 0
    again = Sequence.from_arrays(np.stack(list(sequence)), poses)
    assert again.status[3] == "pose_singular" and again.status.count("ok") == len(sequence) - 1
    assert np.isnan(again.poses[3]).all() and np.isfinite(again.poses[4]).all()


def test_pickled_objects_are_equal(sweep, tmp_path, grown) -> None:
    sequence = Sequence.open(sweep, frames=slice(5, 20))
    again = pickle.loads(pickle.dumps(sequence))
    assert np.array_equal(again.poses, sequence.poses) and np.array_equal(again[3], sequence[3])
    arrays = Sequence.from_arrays(
        np.stack([sequence[0], sequence[1]]), sequence.poses[:2], [1.5, 2.5]
    )
    again = pickle.loads(pickle.dumps(arrays))
    assert np.array_equal(again[1], arrays[1]) and again.times.tolist() == [1.5, 2.5]
    (tmp_path / "calibration.toml").write_text(TOML)
    calibration = Calibration.read(tmp_path / "calibration.toml")
    assert np.array_equal(
        pickle.loads(pickle.dumps(calibration)).probe_from_image, calibration.probe_from_image
    )
    for volume in (grown.snapshot(), Volume.from_arrays(np.ones((2, 3, 4)), spacing=(1, 2, 3))):
        again = pickle.loads(pickle.dumps(volume))
        assert np.array_equal(again.values(), volume.values())
        assert np.array_equal(again.weights(), volume.weights())
        assert np.array_equal(again.world_from_volume, volume.world_from_volume)
    with pytest.raises(TypeError, match="pickled"):
        pickle.dumps(Reconstructor())


def test_calibration_has_the_files_numbers(tmp_path) -> None:
    path = tmp_path / "calibration.toml"
    path.write_text(TOML)
    calibration = Calibration.read(path)
    expected = [[0.1, 0, 0, -10], [0, 0.1, 0, 5], [0, 0, 0.1, 0], [0, 0, 0, 1]]
    assert calibration.probe_from_image.tolist() == expected
    assert calibration.latency == {"video": 0.04, "tracker": 0.01}
    assert calibration.spacing == (0.7, 0.7, 0.7) and calibration.presets == ["deep"]
    assert calibration.preset("deep").probe_from_image[0].tolist() == [0.2, 0, 0, -20]
    with pytest.raises(InputError, match="shallow"):
        calibration.preset("shallow")
    path.write_text('format = "sonoweave-calibration"\nversion = 1\n')
    with pytest.raises(CalibrationError) as raised:
        Calibration.read(path).probe_from_image  # noqa: B018
    assert raised.value.missing == ("Image", "Probe")
