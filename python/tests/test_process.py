"""Threads, signals, forks, callbacks and memory."""

from __future__ import annotations

import gc
import multiprocessing
import os
import pathlib
import signal
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from sonoweave import Reconstructor, Sequence, SonoweaveError, Volume


class Counter(threading.Thread):
    """Counts while another thread works."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.count, self.ends = 0, False

    def run(self) -> None:
        while not self.ends:
            self.count += 1
            time.sleep(0.0005)

    def during(self, work: Callable[[], object]) -> tuple[int, float]:
        """Return how far it counted during some work, and the work's time, s."""
        before, began = self.count, time.perf_counter()
        work()
        return self.count - before, time.perf_counter() - began


@pytest.fixture
def counter():
    counter = Counter()
    counter.start()
    yield counter
    counter.ends = True
    counter.join()


@pytest.fixture(scope="module")
def long_sweep() -> Sequence:
    """400 frames of noise across 200 mm, some seconds of work at a fine spacing."""
    frames = np.random.default_rng(3).integers(0, 255, (400, 200, 256), np.uint8)
    poses = np.tile(np.diag([0.2, 0.2, 0.2, 1.0]), (400, 1, 1))
    poses[:, 2, 3] = np.arange(400) * 0.5
    return Sequence.from_arrays(frames, poses, np.arange(400) / 30)


#: Number of calls of some kinds of work, which take milliseconds each.
CALLS = {"snapshot": 8, "values": 4, "open": 4}


def work(name: str, sweep: Sequence, folder: pathlib.Path) -> Callable[[], object]:
    """Return a long call of that name."""
    reconstructor = Reconstructor(spacing=0.4, clip="none", threads=1)
    if name == "insert_all":
        return lambda: reconstructor.insert_all(sweep)
    if name == "insert":
        frame, pose = np.random.default_rng(1).random((1500, 1500), np.float32), sweep.poses[0]
        return lambda: reconstructor.insert(frame, pose)
    reconstructor.insert_all(sweep)
    volume = reconstructor.snapshot()
    volume.write(folder / "volume.mha", type="f32")
    calls: dict[str, Callable[[], object]] = {
        "snapshot": lambda: [reconstructor.snapshot() for _ in range(CALLS["snapshot"])],
        "values": lambda: [volume.values() for _ in range(CALLS["values"])],
        "write": lambda: volume.write(folder / "again.nii.gz"),
        "open": lambda: [Volume.open(folder / "volume.mha") for _ in range(CALLS["open"])],
    }
    return calls[name]


@pytest.mark.parametrize("name", ["insert_all", "insert", "snapshot", "values", "write", "open"])
def test_other_threads_run_meanwhile(counter, long_sweep, tmp_path, name) -> None:
    call = work(name, long_sweep, tmp_path)
    counted, seconds = counter.during(call)
    assert seconds > 0.02, "too short to tell"
    # Otherwise it would count once a call at most, and between two calls.
    assert counted > 2 * CALLS.get(name, 1) + 2, f"{counted} in {seconds} s"


def repeated(sweep: Sequence) -> Sequence:
    """Return a sweep five times: at a fine spacing it takes a second, ten calls of progress."""
    return Sequence.from_arrays(
        np.tile(np.stack(list(sweep)), (5, 1, 1)), np.tile(sweep.poses, (5, 1, 1))
    )


def test_interrupt_ends_run_and_keeps_volume(long_sweep) -> None:
    long = repeated(long_sweep)
    reconstructor = Reconstructor(spacing=0.25, clip="none", threads=1)
    interrupted: list[float] = []

    def interrupt() -> None:
        time.sleep(0.03)
        interrupted.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    def progress(done: int, total: int) -> None:
        if not interrupted and not killer.is_alive():
            killer.start()

    killer = threading.Thread(target=interrupt)
    # A shell's background processes begin with the signal ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            reconstructor.insert_all(long, progress=progress)
    finally:
        signal.signal(signal.SIGINT, before)
    assert interrupted
    frames = reconstructor.ledger["frames"]
    assert (
        0 < frames["used"] < len(long)
        and frames["used"] == frames["total"]
        and frames["waiting"] == 0
    )
    used = frames["used"]
    assert reconstructor.snapshot().weights().any()
    # It goes on.
    reconstructor.insert(long_sweep[399], long_sweep.poses[399])
    assert reconstructor.ledger["frames"]["used"] == used + 1


def test_interrupted_volume_is_that_of_its_frames(long_sweep) -> None:
    long = repeated(long_sweep)

    def empty() -> Reconstructor:
        return Reconstructor(spacing=0.25, clip="none", path="general", threads=1)

    reconstructor = empty()

    def stop(done: int, total: int) -> None:
        if done > 20:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        reconstructor.insert_all(long, progress=stop)
    used = reconstructor.ledger["frames"]["used"]
    assert 20 < used < len(long)
    again = empty()
    for at in range(used):
        again.insert(long[at], long.poses[at])
    assert np.array_equal(again.snapshot().values(), reconstructor.snapshot().values())


def test_progress_is_called_and_ends_with_all(long_sweep) -> None:
    calls: list[tuple[int, int]] = []
    began = time.perf_counter()
    Reconstructor(spacing=0.5, clip="none", threads=1).insert_all(
        long_sweep, progress=lambda *call: calls.append(call)
    )
    seconds = time.perf_counter() - began
    assert calls[-1] == (400, 400) and [done for done, _ in calls] == sorted(
        done for done, _ in calls
    )
    assert 2 <= len(calls) <= 10 * seconds + 2


def test_progress_takes_class_of_bars(sweep) -> None:
    class Bar:
        made: list[Bar] = []

        def __init__(self, total: int) -> None:
            self.total, self.n, self.closed = total, 0, False
            self.made.append(self)

        def update(self, more: int) -> None:
            self.n += more

        def close(self) -> None:
            self.closed = True

    Reconstructor().insert_all(Sequence.open(sweep), progress=Bar)
    assert [(bar.n, bar.total, bar.closed) for bar in Bar.made] == [(60, 60, True)]


def reconstruct(path: str, to: multiprocessing.SimpleQueue) -> None:
    """Send the sum of a volume's bits."""
    reconstructor = Reconstructor(spacing=1.0)
    reconstructor.insert_all(Sequence.open(path))
    to.put(int(reconstructor.snapshot().values().view(np.uint32).astype(np.uint64).sum()))


@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
def test_child_process_has_same_bits(sweep, method) -> None:
    context = multiprocessing.get_context(method)
    here, there = context.SimpleQueue(), context.SimpleQueue()
    reconstruct(str(sweep), here)
    child = context.Process(target=reconstruct, args=(str(sweep), there))
    child.start()
    child.join(60)
    assert child.exitcode == 0
    assert there.get() == here.get()


def try_parents(
    reconstructor: Reconstructor, sequence: Sequence, to: multiprocessing.SimpleQueue
) -> None:
    """Send the text of the error for a reconstructor of the parent."""
    calls = [
        reconstructor.snapshot,
        lambda: reconstructor.insert_all(sequence),
        lambda: reconstructor.ledger,
    ]
    for call in calls:
        try:
            call()
            to.put("no error")
        except SonoweaveError as error:
            to.put(str(error))


def test_reconstructor_from_before_fork_refuses(grown, sweep) -> None:
    context = multiprocessing.get_context("fork")
    texts = context.SimpleQueue()
    child = context.Process(target=try_parents, args=(grown, Sequence.open(sweep), texts))
    child.start()
    child.join(60)
    assert child.exitcode == 0
    assert all("made before a fork" in texts.get() for _ in range(3))
    assert grown.ledger["frames"]["used"] == 5


def resident() -> int:
    """Return the memory that the process holds, bytes."""
    return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_thousand_objects_leave_no_memory(sweep) -> None:
    values = np.ones((20, 20, 20), np.float32)
    frames, poses = np.zeros((4, 20, 20), np.uint8), np.tile(np.eye(4), (4, 1, 1))

    def make(count: int) -> None:
        for _ in range(count):
            Volume.from_arrays(values).values()
            Sequence.from_arrays(frames, poses)[1]
            Sequence.open(sweep, frames=range(4))
            Reconstructor(threads=1)
        gc.collect()

    make(200)
    before = resident()
    make(1000)
    assert resident() - before <= 5 << 20


def test_snapshots_leave_no_memory(grown) -> None:
    for _ in range(20):
        grown.snapshot()
    before = resident()
    for _ in range(200):
        grown.snapshot()
    assert resident() - before <= 20 << 20


def test_threads_may_share_a_reconstructor(sweep) -> None:
    sequence = Sequence.open(sweep)
    reconstructor = Reconstructor(clip="none", threads=1)
    errors: list[BaseException] = []

    def insert(part: int) -> None:
        try:
            for at in range(part, len(sequence), 4):
                reconstructor.insert(sequence[at], sequence.poses[at], time=float(at))
        except BaseException as error:
            errors.append(error)

    def read() -> None:
        try:
            for _ in range(10):
                if reconstructor.ledger["frames"]["used"]:
                    assert np.isfinite(reconstructor.snapshot().values()).all()
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=insert, args=(part,)) for part in range(4)]
    threads += [threading.Thread(target=read) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not errors and reconstructor.ledger["frames"]["used"] == len(sequence)
