"""OME-Zarr as data sets of xarray: the same voxels at the same places, level by level."""

from __future__ import annotations

import json
import pathlib

import numpy as np
import pytest
from sonoweave import InputError, Reconstructor, Sequence, Volume

pytest.importorskip("xarray")
zarr = pytest.importorskip("zarr", minversion="3")
import sonoweave.zarr  # noqa: E402


@pytest.fixture(scope="module")
def written(sweep, tmp_path_factory) -> pathlib.Path:
    """A volume of ours with two levels."""
    path = tmp_path_factory.mktemp("zarr") / "v.ome.zarr"
    reconstructor = Reconstructor(spacing=0.5, clip="none", path="general")
    reconstructor.insert_all(Sequence.open(sweep))
    reconstructor.snapshot().write(path, type="f32")
    return path


def foreign(path: pathlib.Path, **changes: object) -> np.ndarray:
    """Write an image of one level as other programs do: no weights, µm, no shards."""
    values = np.random.default_rng(2).integers(0, 999, (5, 6, 7), np.uint16)
    group = zarr.open_group(path, mode="w", zarr_format=3)
    array = group.create_array("scale0", shape=values.shape, chunks=(2, 3, 7), dtype="uint16")
    array[:] = values
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    steps = [
        {"type": "scale", "scale": [500, 250, 125]},
        {"type": "translation", "translation": [1000, 0, -2000]},
    ]
    scales = {
        "axes": axes,
        "datasets": [{"path": "scale0", "coordinateTransformations": steps}],
        "coordinateTransformations": [{"type": "scale", "scale": [2, 2, 2]}],
    }
    group.attrs["ome"] = {"version": "0.5", "multiscales": [scales | changes]}
    return values


def test_finest_level_is_volume_with_places(written) -> None:
    data, volume = sonoweave.zarr.open(written), Volume.open(written)
    assert data["value"].dims == data["weight"].dims == ("z", "y", "x")
    assert data["value"].dtype == np.float32 and data["value"].shape == volume.shape
    assert np.array_equal(data["value"].compute(), volume.values())
    assert np.array_equal(data["weight"].compute(), volume.weights()) and data["weight"].any()
    for place, axis in enumerate("xyz"):
        expected = volume.origin[place] + volume.spacing[place] * np.arange(data.sizes[axis])
        assert np.array_equal(data[axis], expected) and data[axis].attrs["units"] == "mm"
    assert np.array_equal(data.attrs["affines"]["world"], volume.world_from_volume)
    fields = dict(data.attrs["sonoweave"]["fields"])
    assert fields["SonoweaveMethod"] == "gaussian-truncated"


def test_levels_are_lazy_with_a_chunk_a_shard(written, monkeypatch) -> None:
    read = []
    real = zarr.Array.__getitem__
    monkeypatch.setattr(
        zarr.Array, "__getitem__", lambda self, key: read.append(key) or real(self, key)
    )
    data = sonoweave.zarr.open(written)
    assert read == []
    assert {max(sizes) for sizes in data["value"].data.chunks} == {128}
    data["value"][3, 4, 5].compute()
    assert len(read) == 1


def test_coarser_level_has_centres_between_finer_ones(written) -> None:
    fine, coarse = sonoweave.zarr.open(written), sonoweave.zarr.open(written, level=1)
    for axis in "zyx":
        pairs = fine[axis].values[: fine.sizes[axis] // 2 * 2].reshape(-1, 2)
        assert np.allclose(coarse[axis][: len(pairs)], pairs.mean(1), atol=1e-9)
    world, below = coarse.attrs["affines"]["world"], fine.attrs["affines"]["world"]
    assert np.allclose(world @ [3, 4, 5, 1], below @ [6.5, 8.5, 10.5, 1], atol=1e-9)
    at = np.argwhere(coarse["weight"].values[:60, :60, :60] > 0)[0]
    box = tuple(slice(2 * i, 2 * i + 2) for i in at)
    values, weights = fine["value"].values[box], fine["weight"].values[box]
    expected = (values * weights).sum() / weights.sum()
    assert np.isclose(coarse["value"].values[tuple(at)], expected, rtol=1e-5)


def test_turned_volume_has_its_matrix(written, tmp_path) -> None:
    """Axes that OME-Zarr 0.5 cannot express are in attributes of ours."""
    poses = np.tile(np.eye(4), (30, 1, 1))
    c, s = np.cos(0.3), np.sin(0.3)
    poses[:, :3, :3] = [[0, c * 0.5, -s], [0, s * 0.5, c], [0.5, 0, 0]]
    poses[:, :3, 3] = np.outer(np.arange(30) * 0.5, [-s, c, 0])
    frames = np.random.default_rng(1).integers(1, 255, (30, 40, 60), np.uint8)
    reconstructor = Reconstructor(path="planar", planar_tolerance=1000, clip="none")
    reconstructor.insert_all(Sequence.from_arrays(frames, poses))
    volume = reconstructor.snapshot()
    volume.write(tmp_path / "v.ome.zarr", type="f32")
    again = Volume.open(tmp_path / "v.ome.zarr")
    assert not np.allclose(again.direction, np.eye(3))
    data = sonoweave.zarr.open(tmp_path / "v.ome.zarr")
    assert np.allclose(data.attrs["affines"]["world"], again.world_from_volume, atol=1e-9)
    assert np.array_equal(data["value"].compute(), again.values())


def test_image_of_others_is_read_without_weights(tmp_path) -> None:
    values = foreign(tmp_path / "other.zarr")
    data = sonoweave.zarr.open(tmp_path / "other.zarr")
    assert set(data) == {"value"} and np.array_equal(data["value"].compute(), values)
    assert np.allclose(data["z"], 2 + 1.0 * np.arange(5))
    assert np.allclose(data["y"], 0.5 * np.arange(6)) and np.allclose(
        data["x"], -4 + 0.25 * np.arange(7)
    )
    world = data.attrs["affines"]["world"]
    assert np.allclose(world @ [1, 1, 1, 1], [-3.75, 0.5, 3, 1]) and "sonoweave" not in data.attrs
    assert data["value"].data.chunks == ((2, 2, 1), (3, 3), (7,))


def test_what_does_not_fit_is_named(written, tmp_path) -> None:
    with pytest.raises(FileNotFoundError) as missing:
        sonoweave.zarr.open(tmp_path / "none.ome.zarr")
    assert missing.value.filename == str(tmp_path / "none.ome.zarr")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: is no group of Zarr 3"):
        sonoweave.zarr.open(tmp_path / "empty")
    with pytest.raises(InputError, match="has the levels 0 to 1, and no level 7"):
        sonoweave.zarr.open(written, level=7)
    with pytest.raises(InputError, match="no level -1"):
        sonoweave.zarr.open(written, -1)
    for level in ("0", 1.0, True):
        with pytest.raises(TypeError, match="level"):
            sonoweave.zarr.open(written, level)
    space = [{"name": name, "type": "space", "unit": "millimeter"} for name in "zyx"]
    for name, changes, text in [
        ("axes", {"axes": space[:2]}, "must have the axes z, y, x of space, not z, y"),
        ("unit", {"axes": [{**axis, "unit": "parsec"} for axis in space]}, "unit of length"),
        ("none", {"datasets": [{"path": "0", "coordinateTransformations": []}]}, "no array 0"),
        (
            "turn",
            {"datasets": [{"path": "0", "coordinateTransformations": [{"type": "affine"}]}]},
            "a transform 'affine'",
        ),
        ("lack", {"datasets": [{"path": "0"}]}, "lack 'coordinateTransformations'"),
    ]:
        foreign(tmp_path / name, **changes)
        with pytest.raises(InputError, match=text):
            sonoweave.zarr.open(tmp_path / name)
    group = zarr.open_group(tmp_path / "plain", mode="w", zarr_format=3)
    with pytest.raises(InputError, match="has no attributes of OME"):
        sonoweave.zarr.open(tmp_path / "plain")
    group.attrs["ome"] = {"version": "0.6"}
    with pytest.raises(InputError, match="has version 0.6"):
        sonoweave.zarr.open(tmp_path / "plain")
    group.attrs["ome"] = {"version": "0.5"}
    with pytest.raises(InputError, match="lack 'multiscales'"):
        sonoweave.zarr.open(tmp_path / "plain")


def test_attributes_of_ours_are_json(written) -> None:
    own = sonoweave.zarr.open(written).attrs["sonoweave"]
    assert json.loads((written / "zarr.json").read_text())["attributes"]["sonoweave"] == own
