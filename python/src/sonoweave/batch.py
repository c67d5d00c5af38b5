"""Batches, and volumes in regions, on the processes of a cluster by Dask.

The work is done by the program: a task is a call of ``sonoweave batch run --only`` or of
``sonoweave regions run --only``. Files are the only state. Whatever is lost, a worker, the
scheduler or this process, the same command goes on, and its files have the same bytes.

Run it as ``python -m sonoweave.batch run FOLDER --cluster local``, or as ``python -m
sonoweave.batch regions VOLUME.ome.zarr --cluster tcp://scheduler:8786``.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import importlib
import itertools
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from typing import Any

from .errors import InputError

__all__ = ["Summary", "regions", "run"]

#: Most tasks that the scheduler knows at a time.
MOST_TASKS = 10_000
#: Deaths of workers that a task survives. A task that kills its workers is a program's fault.
ALLOWED_DEATHS = 10


@dataclasses.dataclass(frozen=True)
class Summary:
    """Result of a run.

    Parameters
    ----------
    done : int
        Members that are done, of this run and of earlier ones.
    failed : dict of str to str
        The last sentence about each member that is not done, by its name.
    tasks : int
        Tasks that this run has begun.
    """

    done: int
    failed: dict[str, str]
    tasks: int


def run(
    folder: str | os.PathLike[str],
    client: Any,
    *,
    flags: tuple[str, ...] = (),
    program: str | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Summary:
    """Reconstruct the sweeps of a planned batch, one a task.

    Parameters
    ----------
    folder : path
        Folder of the batch, made by ``sonoweave batch plan``, which all workers have.
    client : distributed.Client
        The cluster.
    flags : tuple of str
        Flags of ``sonoweave batch run``, such as ``("--memory=4GiB", "--timeout=30m")``.
    program : str, optional
        The program ``sonoweave`` on the workers; by default that of ``SONOWEAVE_PROGRAM``, or of
        the path.
    progress : callable, optional
        Receives the numbers of ended and of all tasks.

    Returns
    -------
    Summary
        The sweeps that are done, and the others' reasons.

    Raises
    ------
    InputError
        If the folder has no plan.
    """
    folder = pathlib.Path(folder).resolve()
    plan = folder / "plan.jsonl"
    if not plan.is_file():
        raise InputError(f"{folder}: has no plan; make one by `sonoweave batch plan`")
    sweeps = [json.loads(line) for line in plan.read_text().splitlines()]
    missing = [sweep for sweep in sweeps if not _is_done(folder, sweep)]
    missing.sort(key=lambda sweep: -sweep["cost"])
    words = ["batch", "run", str(folder), "--jobs=1", *flags, "--only"]
    said = _all(client, program, words, [sweep["id"] for sweep in missing], progress)
    failed = {sweep["id"]: said[sweep["id"]] for sweep in missing if not _is_done(folder, sweep)}
    if not failed:
        # Starts nothing, and removes what killed processes have left.
        _call(program, ["batch", "run", str(folder)])
    return Summary(len(sweeps) - len(failed), failed, len(missing))


def regions(
    volume: str | os.PathLike[str],
    client: Any,
    *,
    threads: int = 1,
    program: str | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Summary:
    """Reconstruct a planned volume, a region a task, and give it its name.

    Parameters
    ----------
    volume : path
        Volume planned by ``sonoweave regions plan``, in a folder which all workers have.
    client : distributed.Client
        The cluster.
    threads : int
        Threads of a task.
    program : str, optional
        The program ``sonoweave`` on the workers; by default that of ``SONOWEAVE_PROGRAM``, or of
        the path.
    progress : callable, optional
        Receives the numbers of ended and of all tasks.

    Returns
    -------
    Summary
        The regions that are done, and the others' reasons.

    Raises
    ------
    InputError
        If the volume has no plan, or cannot be finished.
    """
    volume = pathlib.Path(volume).resolve()
    status = _call(program, ["regions", "status", str(volume), "--json"])
    found = json.loads(status)["regions"]
    order = sorted(range(len(found)), key=lambda number: -found[number]["slices"])
    missing = [str(number) for number in order if not found[number]["done"]]
    words = ["regions", "run", str(volume), f"--threads={threads}", "--only"]
    said = _all(client, program, words, missing, progress)
    found = json.loads(_call(program, ["regions", "status", str(volume), "--json"]))["regions"]
    failed = {str(at): said.get(str(at), "") for at, one in enumerate(found) if not one["done"]}
    if not failed:
        _call(program, ["regions", "finish", str(volume)])
    return Summary(len(found) - len(failed), failed, len(missing))


def _is_done(folder: pathlib.Path, sweep: dict[str, Any]) -> bool:
    """Tell whether a sweep's account has the plan's key, and its files their lengths."""
    place = folder / "sweeps" / sweep["id"]
    try:
        account = json.loads((place / "done.json").read_text())
        return account["key"] == sweep["key"] and all(
            (place / output["path"]).stat().st_size == output["bytes"]
            for output in account["outputs"]
        )
    except (OSError, ValueError, KeyError):
        return False


def _program(program: str | None) -> str:
    """Find the program on this machine."""
    found = program or os.environ.get("SONOWEAVE_PROGRAM") or shutil.which("sonoweave")
    if found is None:
        raise InputError(
            "the program sonoweave is not on the path; install it, or name it by SONOWEAVE_PROGRAM"
        )
    return found


def _task(program: str | None, words: list[str]) -> str:
    """Run the program, which ends with this process; return its last sentence."""
    # The program asks the system for that by itself.
    environment = os.environ | {"SONOWEAVE_BATCH_PARENT": str(os.getpid())}
    done = subprocess.run(
        [_program(program), *words],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    sentences = done.stderr.strip().splitlines()
    return sentences[-1] if sentences else f"the program ended with code {done.returncode}"


def _call(program: str | None, words: list[str]) -> str:
    """Run the program on this machine, and return its output."""
    done = subprocess.run(
        [_program(program), *words], stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    if done.returncode != 0:
        raise InputError(done.stderr.strip().removeprefix("sonoweave: "))
    return done.stdout


def _all(
    client: Any,
    program: str | None,
    words: list[str],
    names: list[str],
    progress: Callable[[int, int], object] | None,
) -> dict[str, str]:
    """Run a task for each name, a bounded number at a time; return their last sentences."""
    from distributed import KilledWorker, as_completed

    said: dict[str, str] = {}
    waiting = iter(names)

    def submitted(count: int) -> Iterator[Any]:
        for name in itertools.islice(waiting, count):
            future = client.submit(_task, program, [*words, name], pure=False)
            of[future.key] = name
            yield future

    of: dict[str, str] = {}
    tasks = as_completed(list(submitted(MOST_TASKS)))
    for future in tasks:
        name = of.pop(future.key)
        try:
            said[name] = future.result()
        except KilledWorker as death:
            said[name] = f"its workers died: {death}"
        future.release()
        for more in submitted(1):
            tasks.add(more)
        if progress is not None:
            progress(len(said), len(names))
    return said


def _cluster(name: str, workers: int | None) -> Any:
    """Return a client of a cluster by its name on the command line."""
    import dask
    from distributed import Client, LocalCluster

    dask.config.set({"distributed.scheduler.allowed-failures": ALLOWED_DEATHS})
    if name == "local":
        count = workers or os.cpu_count() or 1
        local = LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None)
        return Client(local)
    if name == "slurm":
        slurm = _slurm()
        # Jobs that end, by a failure or at their time limit, are replaced.
        slurm.adapt(minimum_jobs=workers or 1, maximum_jobs=workers or 1)
        return Client(slurm)
    if "://" not in name:
        raise InputError(f"--cluster {name}: give local, slurm, or a scheduler's address")
    return Client(name)


def _slurm() -> Any:
    """Return a cluster without jobs yet, by Dask's file jobqueue.yaml.

    Raises InputError if Slurm would refuse a job. Dask only logs that, and waits for ever.
    """
    try:
        # Its types are not stated.
        jobqueue: Any = importlib.import_module("dask_jobqueue")
        slurm = jobqueue.SLURMCluster()
        with tempfile.NamedTemporaryFile("w", suffix=".sh") as script:
            script.write(slurm.job_script())
            script.flush()
            command = ["sbatch", "--test-only", script.name]
            asked = subprocess.run(command, capture_output=True, text=True, check=False)
    except ModuleNotFoundError as error:
        raise InputError(f"--cluster slurm: {error}; install sonoweave[slurm]") from error
    except ValueError as error:
        raise InputError(f"--cluster slurm: {error}; set it in Dask's jobqueue.yaml") from error
    except OSError as error:
        raise InputError(f"--cluster slurm: {error}; run it where Slurm's sbatch is") from error
    if asked.returncode != 0:
        why = " ".join(asked.stderr.split())
        raise InputError(f"--cluster slurm: {why}; change cores, memory or queue in Dask's jobqueue.yaml")
    return slurm


def _main(arguments: list[str]) -> int:
    """Run a command; return its exit code."""
    parser = argparse.ArgumentParser(prog="python -m sonoweave.batch", allow_abbrev=False)
    commands = parser.add_subparsers(dest="command", required=True)
    sweeps = commands.add_parser("run", help="reconstruct the sweeps of a planned batch")
    sweeps.add_argument("place", metavar="FOLDER")
    one = commands.add_parser("regions", help="reconstruct a planned volume in regions")
    one.add_argument("place", metavar="VOLUME.ome.zarr")
    one.add_argument("--threads", type=int, default=1, help="threads of a task")
    for command in (sweeps, one):
        command.add_argument("--cluster", default="local", help="local, slurm, or tcp://HOST:PORT")
        command.add_argument("--workers", type=int, help="processes of a local cluster, or jobs")
        command.add_argument("--program", help="the program sonoweave, on the workers")
    sweeps.epilog = "Further flags are those of `sonoweave batch run`, such as --memory=4GiB."
    given, rest = parser.parse_known_args(arguments)
    if rest and given.command != "run":
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    counts: collections.Counter[str] = collections.Counter()

    def progress(done: int, total: int) -> None:
        # A line for every tenth of the tasks.
        if done * 10 // total > counts["tenths"] or done == total:
            counts["tenths"] = done * 10 // total
            print(f"{done} of {total} tasks ended", file=sys.stderr)

    common = {"program": given.program, "progress": progress}
    try:
        with _cluster(given.cluster, given.workers) as client:
            if given.command == "run":
                summary = run(given.place, client, flags=tuple(rest), **common)
            else:
                summary = regions(given.place, client, threads=given.threads, **common)
    except InputError as error:
        print(f"sonoweave: {error}", file=sys.stderr)
        return 3
    for name, sentence in summary.failed.items():
        print(f"{name}: {sentence}")
    print(f"{summary.done} done, {len(summary.failed)} failed, {summary.tasks} tasks")
    return 10 if summary.failed else 0


if __name__ == "__main__":
    sys.exit(_main(sys.argv[1:]))
