"""Many sweeps on the processes of a cluster, by Dask.

    python cluster.py FOLDER SWEEP.igs.mha…

Each sweep is a task: it reads its own files and returns some numbers. Frames and volumes do not
travel. A task whose volume exists does nothing, so that a run can be repeated.
"""

from __future__ import annotations

import pathlib
import sys
from typing import Any

import sonoweave
from distributed import Client, LocalCluster, as_completed


def reconstruct(sequence: sonoweave.Sequence, settings: dict[str, Any], to: str) -> dict[str, Any]:
    """Reconstruct a sweep; runs in a process of the cluster."""
    target = pathlib.Path(to)
    if target.exists():
        return {"volume": to, "used": None}
    reconstructor = sonoweave.Reconstructor(**settings)
    ledger = reconstructor.insert_all(sequence)
    reconstructor.snapshot().write(target)
    return {"volume": to, "used": ledger["frames"]["used"]}


def main(folder: str, *sweeps: str) -> None:
    """Distribute the sweeps, and print the results as they come."""
    settings = {"spacing": 1.0, "threads": 1}
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        tasks = [
            client.submit(
                reconstruct,
                sonoweave.Sequence.open(sweep),
                settings,
                str(pathlib.Path(folder) / f"{pathlib.Path(sweep).name.split('.')[0]}.mha"),
                pure=False,
            )
            for sweep in sweeps
        ]
        for task in as_completed(tasks):
            done = task.result()
            print(f"{done['volume']}: {'kept' if done['used'] is None else done['used']}")


if __name__ == "__main__":
    main(*sys.argv[1:])
