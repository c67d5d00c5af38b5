"""Objects of other packages: the same voxels at the same places."""

from __future__ import annotations

import numpy as np
import pytest
from sonoweave import Sequence, Volume


@pytest.fixture
def volume() -> Volume:
    values = np.random.default_rng(5).random((70, 9, 11), np.float32) + 1
    direction = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    return Volume.from_arrays(
        values, spacing=(0.5, 0.6, 0.7), origin=(1, 2, 3), direction=direction
    )


def test_sitk_image_has_same_places(volume) -> None:
    sitk = pytest.importorskip("SimpleITK")
    image = volume.to_sitk()
    assert np.array_equal(sitk.GetArrayFromImage(image), volume.values())
    assert np.allclose(
        image.TransformIndexToPhysicalPoint((3, 4, 5)),
        (volume.world_from_volume @ [3, 4, 5, 1])[:3],
    )


def test_nibabel_image_is_that_of_our_file(volume, tmp_path) -> None:
    nibabel = pytest.importorskip("nibabel")
    image = volume.to_nibabel()
    assert np.array_equal(np.asarray(image.dataobj), volume.values().transpose(2, 1, 0))
    volume.write(tmp_path / "v.nii")
    assert np.allclose(nibabel.load(tmp_path / "v.nii").affine, image.affine, atol=1e-5)


def test_xarray_volume_is_lazy_and_has_places(volume, monkeypatch) -> None:
    pytest.importorskip("xarray")
    read = []
    real = type(volume)._read
    monkeypatch.setattr(
        type(volume),
        "_read",
        lambda self, ranges, **which: read.append(ranges) or real(self, ranges, **which),
    )
    data = volume.to_xarray()
    assert not read and data["value"].dims == ("z", "y", "x")
    part = data["value"][65:68, 2].compute()
    assert np.array_equal(part, volume[65:68, 2])
    assert all(low >= 64 and high <= 70 for [low, high], _, _ in read)
    assert np.array_equal(data["weight"].compute(), volume.weights())
    assert np.allclose(data["x"], 1 + 0.5 * np.arange(11)) and data["z"].attrs["units"] == "mm"
    assert np.allclose(data.attrs["affines"]["world"], volume.world_from_volume)


def test_xarray_sequence_has_poses_and_frames(sweep) -> None:
    pytest.importorskip("xarray")
    sequence = Sequence.open(sweep)
    data = sequence.to_xarray()
    frames = data["frames"]
    assert frames.dims == ("time", "y", "x") and frames.data.chunks[0] == (1,) * 60
    assert np.array_equal(frames[7].compute(), sequence[7])
    assert np.array_equal(data["world_from_image"], sequence.poses)
    assert np.array_equal(data["time"], sequence.times)


def test_dask_takes_volume_without_dense_copy(volume) -> None:
    array = pytest.importorskip("dask.array")
    lazy = array.from_array(volume, chunks=64, asarray=False)
    assert np.isclose(float(lazy.sum().compute()), volume.values().sum(dtype=np.float64), rtol=1e-5)


def test_plot_has_path_planes_and_residuals(sweep) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    from sonoweave import Reconstructor
    from sonoweave.plotting import plot, residuals

    sequence, reconstructor = Sequence.open(sweep), Reconstructor()
    reconstructor.insert_all(sequence)
    volume = reconstructor.snapshot()
    figure = plot(sequence, volume, every=10)
    assert [axes.get_title() for axes in figure.axes][1:] == [
        "planes through the volume",
        "residuals",
    ]
    path = figure.axes[0].get_lines()[0].get_data_3d()
    middle = sequence.poses @ [sequence[0].shape[1] / 2, 0, 0, 1]
    assert np.allclose(np.array(path).T, middle[:, :3])
    # The noise has an sd of 4, and the volume is smooth.
    found = residuals(sequence, volume, every=10)
    assert np.isfinite(found).sum() == 6 and 2 < np.nanmean(found) < 12
