"""Executor on the workers of a Dask cluster, for work that is divided into independent tasks."""

from __future__ import annotations

import importlib
from collections.abc import Generator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from armid.errors import ArmidError, MissingExtraError

LOCAL = "local"
"""Address that stands for worker processes on this machine."""

LOST_WORKERS = 20
"""Number of workers that may be lost while they work at the same task, before it counts as the cause."""

PATIENCE = 20.0
"""Time to wait for a scheduler [s]."""


@contextmanager
def cluster_executor(address: str, workers: int) -> Generator[Executor]:
    """Context manager with an executor whose tasks run on a Dask cluster.

    Tasks of a worker that is lost are run again by another one. Results do not depend on the number of workers.

    Args:
        address: Address of a scheduler, such as `tcp://host:8786`, or `local` for processes on this machine.
        workers: Number of processes on this machine, if the address is `local`.

    Raises:
        MissingExtraError: The package `distributed` is not installed.
        ArmidError: No scheduler answers at the address.
    """
    try:
        dask: Any = importlib.import_module("dask")
        distributed: Any = importlib.import_module("distributed")
    except ImportError as error:
        raise MissingExtraError("distributed", "A cluster of workers", "dask") from error
    with dask.config.set({"distributed.scheduler.allowed-failures": LOST_WORKERS}):
        if address == LOCAL:
            cluster = distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None
            )
            with cluster, distributed.Client(cluster) as client:
                yield client.get_executor(pure=False)
            return
        try:
            client = distributed.Client(address, timeout=PATIENCE)
        except (OSError, ValueError) as error:
            raise ArmidError(
                f"No scheduler of Dask answers at {address}.",
                possible=f"`{LOCAL}` for processes on this machine, or an address such as tcp://host:8786",
                remedy="start one with `dask scheduler` and workers with `dask worker ADDRESS`, in environments with "
                "the same version of armid, and check the address.",
            ) from error
        with client:
            yield client.get_executor(pure=False)
