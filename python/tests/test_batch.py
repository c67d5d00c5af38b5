"""Batches and volumes in regions on a cluster of this machine's processes, some of them killed."""

from __future__ import annotations

import hashlib
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

import pytest
import sonoweave
from conftest import sonoweave_does
from sonoweave import batch

pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")

SWEEPS = 12
FLAGS = ["--spacing=0.3", "--clip=none"]


def files(folder: pathlib.Path) -> dict[str, str]:
    """Hash all files of results; accounts name their host, time and try."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "done.json"
    }


@pytest.fixture(scope="module")
def planned(program, tmp_path_factory) -> pathlib.Path:
    """A folder with a planned batch, ``run``, and its results by one process, ``alone``."""
    folder = tmp_path_factory.mktemp("batch")
    rows = ["id,recording,settings"]
    for seed in range(SWEEPS):
        words = ["--frames=30", "--image-size=160x120", f"--seed={seed}"]
        sonoweave_does(program, "phantom", "-o", folder / f"{seed}.igs.mha", *words)
        rows.append(f"s{seed},{seed}.igs.mha,{' '.join(FLAGS)}")
    (folder / "manifest.csv").write_text("\n".join(rows) + "\n")
    for name in ("run", "alone"):
        sonoweave_does(program, "batch", "plan", folder / "manifest.csv", "-o", folder / name)
    sonoweave_does(program, "batch", "run", folder / "alone", "--jobs=1")
    return folder


def test_cluster_has_bytes_of_one_process(program, planned, client) -> None:
    shutil.rmtree(planned / "run" / "sweeps", ignore_errors=True)
    seen = []
    summary = batch.run(
        planned / "run", client, program=program, progress=lambda *at: seen.append(at)
    )
    assert (summary.done, summary.failed, summary.tasks) == (SWEEPS, {}, SWEEPS)
    assert seen[-1] == (SWEEPS, SWEEPS)
    assert files(planned / "run" / "sweeps") == files(planned / "alone" / "sweeps")
    assert batch.run(planned / "run", client, program=program).tasks == 0


def test_failed_sweep_is_named(program, planned, client, tmp_path) -> None:
    (tmp_path / "bad.igs.mha").write_bytes((planned / "0.igs.mha").read_bytes())
    (tmp_path / "good.igs.mha").write_bytes((planned / "1.igs.mha").read_bytes())
    rows = "id,recording,settings\nbad,bad.igs.mha,--clip=none\ngood,good.igs.mha,--clip=none\n"
    (tmp_path / "manifest.csv").write_text(rows)
    sonoweave_does(program, "batch", "plan", tmp_path / "manifest.csv", "-o", tmp_path / "run")
    whole = (tmp_path / "bad.igs.mha").read_bytes()
    (tmp_path / "bad.igs.mha").write_bytes(whole[:-1000])
    summary = batch.run(tmp_path / "run", client, program=program)
    assert summary.done == 1 and list(summary.failed) == ["bad"], summary
    with pytest.raises(sonoweave.InputError, match="has no plan"):
        batch.run(tmp_path, client)
    with pytest.raises(sonoweave.InputError, match="has no plan"):
        batch.regions(tmp_path / "none.ome.zarr", client, program=program)


class Driver:
    """The command in a process of its own, whose workers are found and killed."""

    def __init__(self, program: str, *words: object, **settings: str) -> None:
        environment = os.environ | {"SONOWEAVE_PROGRAM": program} | settings
        command = [sys.executable, "-m", "sonoweave.batch", *map(str, words), "--workers=4"]
        self.child = subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )

    def is_running(self) -> bool:
        return self.child.poll() is None

    def signal_busy_worker(self, number: int) -> bool:
        """Wait until a worker runs the program, and send it a signal; tell whether one did."""
        while self.is_running():
            try:
                for worker in psutil.Process(self.child.pid).children():
                    if any("sonoweave" in child.name() for child in worker.children()):
                        worker.send_signal(number)
                        return True
            except psutil.Error:
                pass
            time.sleep(0.005)
        return False

    def kill(self) -> None:
        workers = psutil.Process(self.child.pid).children(recursive=True)
        self.child.kill()
        self.child.wait()
        # They end by themselves once they miss the scheduler; the next driver need not wait.
        for worker in workers:
            try:
                worker.kill()
            except psutil.Error:
                pass


def survives(program: str, words: list[object], again) -> int:
    """Run a command whose drivers and workers are killed; return the number of dead workers."""
    workers, drivers = 0, 0
    while workers < 10 or drivers < 3:
        driver = Driver(program, *words)
        for _ in range(4):
            workers += driver.signal_busy_worker(signal.SIGKILL)
        if driver.signal_busy_worker(signal.SIGKILL):
            drivers += 1
            driver.kill()
            continue
        # It was done before; all is done again.
        assert driver.child.wait() == 0
        again()
    last = Driver(program, *words)
    printed, _ = last.child.communicate()
    assert last.child.returncode == 0, printed
    assert "0 failed" in printed
    return workers


def test_killed_workers_and_drivers_leave_the_same_files(program, planned) -> None:
    run = planned / "run"
    shutil.rmtree(run / "sweeps", ignore_errors=True)
    again = lambda: shutil.rmtree(run / "sweeps")  # noqa: E731
    assert survives(program, ["run", run], again) >= 10
    assert files(run / "sweeps") == files(planned / "alone" / "sweeps")
    # No temporary file is left.
    accounts = {f"sweeps/s{at}/done.json" for at in range(SWEEPS)}
    left = {str(path.relative_to(run)) for path in run.rglob("*") if path.is_file()}
    results = {f"sweeps/{name}" for name in files(run / "sweeps")}
    tries = {name for name in left if name.startswith("attempts/") and name.endswith(".json")}
    assert left == results | accounts | tries | {"plan.jsonl"}


def test_stopped_worker_is_replaced(program, planned) -> None:
    run = planned / "run"
    shutil.rmtree(run / "sweeps", ignore_errors=True)
    driver = Driver(program, "run", run, DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL="3s")
    # Nothing but the scheduler's limit ends it.
    assert driver.signal_busy_worker(signal.SIGSTOP)
    printed, _ = driver.child.communicate()
    assert driver.child.returncode == 0 and f"{SWEEPS} done, 0 failed" in printed, printed
    assert files(run / "sweeps") == files(planned / "alone" / "sweeps")


def test_regions_on_killed_workers_are_the_whole(program, sweep, tmp_path) -> None:
    flags = ["--spacing=0.25", "--clip=none", "--type=f32"]
    whole, volume = tmp_path / "whole.ome.zarr", tmp_path / "volume.ome.zarr"
    sonoweave_does(program, "reconstruct", sweep, "-o", whole, *flags)
    plan = ["regions", "plan", sweep, "-o", volume, *flags, "--max-memory=0.024"]
    sonoweave_does(program, *plan)

    def again() -> None:
        shutil.rmtree(volume)
        sonoweave_does(program, *plan)

    assert survives(program, ["regions", volume], again) >= 10
    assert files(volume) == files(whole)
    assert not (tmp_path / "volume.ome.zarr.part").exists()
