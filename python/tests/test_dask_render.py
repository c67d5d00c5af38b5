"""Pictures in parts on the processes of a cluster, one of which is killed."""

from __future__ import annotations

import os
import pathlib
import signal
import threading
import time

import numpy as np
import pytest
import sonoweave
import sonoweave.dask
from conftest import sonoweave_does

pytest.importorskip("distributed")

LOOKS = [
    {},
    {"mode": "mip", "view": (25, 35), "window": (0, 200), "perspective": 40},
    {"mode": "shaded", "transfer": "bone", "shading": "sample", "draw": ("scale", "cube")},
    {"mode": "average", "background": (0.2, 0.4, 0.6)},
]
SIZE = (96, 72)


@pytest.fixture(scope="module")
def volume(program, sweep, tmp_path_factory) -> pathlib.Path:
    """An OME-Zarr volume of several shards."""
    path = tmp_path_factory.mktemp("volume") / "volume.ome.zarr"
    flags = ["--spacing=0.4", "--clip=none", "--type=f32"]
    sonoweave_does(program, "reconstruct", sweep, "-o", path, *flags)
    return path


@pytest.mark.parametrize("look", LOOKS)
def test_path_has_bits_of_volume_in_memory(volume, look) -> None:
    whole = sonoweave.render(sonoweave.Volume.open(volume), size=SIZE, **look)
    assert whole.shape == (72, 96, 4) and len(np.unique(whole[..., :3])) > 20
    assert np.array_equal(sonoweave.render(volume, size=SIZE, **look), whole)
    assert np.array_equal(sonoweave.render(volume, size=SIZE, max_memory=0.2, **look), whole)
    assert np.array_equal(sonoweave.dask.render(volume, parts=3, size=SIZE, **look), whole)


def test_planes_and_levels_of_path_are_those_of_the_command(volume, program, tmp_path) -> None:
    whole = sonoweave.section(sonoweave.Volume.open(volume))
    assert np.array_equal(sonoweave.section(volume), whole)
    coarse = sonoweave.render(volume, level=1, size=SIZE)
    assert not np.array_equal(coarse, sonoweave.render(volume, size=SIZE))
    assert np.array_equal(sonoweave.dask.render(volume, parts=2, level=1, size=SIZE), coarse)


def test_cluster_has_bits_of_one_process(volume, client) -> None:
    for look in LOOKS[:2]:
        whole = sonoweave.render(volume, size=SIZE, **look)
        for parts in (1, 2, 5):
            made = sonoweave.dask.render(volume, client=client, parts=parts, size=SIZE, **look)
            assert np.array_equal(made, whole), (parts, look)
        folded = sonoweave.dask.render(
            volume, client=client, parts=5, fold=True, size=SIZE, **look
        )
        assert np.abs(folded.astype(int) - whole.astype(int)).max() <= 1


def kill_busy_worker(client) -> int:
    """Wait until a worker has tasks, and kill it; return its process."""
    processes = client.run(os.getpid)
    while True:
        for address, tasks in client.processing().items():
            if tasks:
                os.kill(processes[address], signal.SIGKILL)
                return processes[address]
        time.sleep(0.001)


def test_killed_worker_leaves_the_same_picture(volume, client) -> None:
    look = {"size": (512, 512), "shading": "sample", "step": 0.3}
    whole = sonoweave.render(volume, **look)
    made = []
    before = set(client.run(os.getpid).values())
    caller = threading.Thread(
        target=lambda: made.append(
            sonoweave.dask.render(volume, client=client, parts=6, **look)
        )
    )
    caller.start()
    killed = kill_busy_worker(client)
    caller.join()
    assert killed in before
    assert np.array_equal(made[0], whole)


def test_settings_and_paths_that_do_not_fit_are_refused(volume, tmp_path) -> None:
    for wrong, text in [
        ({"parts": 0}, "parts: must be 1 or more"),
        ({"parts": 900}, "give at most"),
        ({"mode": "slice"}, "slice"),
        ({"mode": "mop"}, "mop"),
        ({"colour": 1}, "colour"),
        ({"level": 9}, "level 9"),
    ]:
        with pytest.raises(sonoweave.InputError, match=text):
            sonoweave.dask.render(volume, **{"size": SIZE, "parts": 2} | wrong)
    with pytest.raises((sonoweave.InputError, OSError), match="none.ome.zarr"):
        sonoweave.dask.render(tmp_path / "none.ome.zarr")
    with pytest.raises(sonoweave.InputError, match="level: applies to OME-Zarr"):
        sonoweave.render(sonoweave.Volume.open(volume), level=1)
    with pytest.raises(sonoweave.InputError, match="weights: a Volume has its own"):
        sonoweave.render(sonoweave.Volume.open(volume), weights=volume)
    with pytest.raises(TypeError, match="must be a Volume or a path"):
        sonoweave.render(3)
