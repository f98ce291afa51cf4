"""Where work is done: in this process, on the cores of this machine, or on a Dask cluster, with the same result.

Work is a function of picklable arguments. `map` applies it to many items, `tree` adds the results up in pairs,

    ((x₁ + x₂) + (x₃ + x₄)) + …

whose shape depends on the number of items alone: floating-point sums are the same wherever and in whatever order the
parts were done. On Dask the results stay with the workers that made them. When a worker dies, its parts are
computed again from their arguments. A part that is computed twice is added once, because a sum refers to parts by name.
"""

from __future__ import annotations

import logging
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata
from typing import Any

from frischid.errors import InputError

LOCAL, HERE = "local", "none"
_LOOPBACK = "127.0.0.1"  # Dask's ports carry pickled code: nobody but this machine may reach them
Progress = Callable[[int, int], None]


class Workers(ABC):
    """Somewhere to do work. `map` and `tree` return handles; `gather` turns handles into values."""

    where: str

    @abstractmethod
    def map(self, function: Callable[..., Any], items: Sequence[Any], *constants: Any) -> list[Any]:
        """Apply ``function(item, *constants)`` to every item; items may be handles, or lists of them."""

    @abstractmethod
    def pairs(self, function: Callable[[Any, Any], Any], first: Sequence[Any], second: Sequence[Any]) -> list[Any]:
        """Apply ``function(a, b)`` to every pair of handles or values."""

    @abstractmethod
    def gather(self, handles: Sequence[Any], progress: Progress = lambda done, of: None) -> list[Any]:
        """Values of handles, in their order; `progress` is told how many are there."""

    def tree(self, function: Callable[[Any, Any], Any], handles: Sequence[Any]) -> Any:
        """Combine at least one handle pairwise, neighbours first."""
        level = list(handles)
        while len(level) > 1:
            half = len(level) // 2
            level = [*self.pairs(function, level[: 2 * half : 2], level[1 : 2 * half : 2]), *level[2 * half :]]
        return level[0]


class Here(Workers):
    """One process, one thing after the other."""

    where = "one process"

    def map(self, function: Callable[..., Any], items: Sequence[Any], *constants: Any) -> list[Any]:
        """Do all of it now."""
        return [function(item, *constants) for item in items]

    def pairs(self, function: Callable[[Any, Any], Any], first: Sequence[Any], second: Sequence[Any]) -> list[Any]:
        """Do all of it now."""
        return [function(a, b) for a, b in zip(first, second, strict=True)]

    def gather(self, handles: Sequence[Any], progress: Progress = lambda done, of: None) -> list[Any]:
        """Handles are values already."""
        progress(len(handles), len(handles))
        return list(handles)


class Dask(Workers):
    """A Dask cluster, through its client."""

    def __init__(self, client: Any) -> None:
        self.client = client
        workers = client.scheduler_info(n_workers=-1)["workers"]
        self.where = f"{len(workers)} Dask worker{'s' * (len(workers) != 1)}"

    def map(self, function: Callable[..., Any], items: Sequence[Any], *constants: Any) -> list[Any]:
        """Send it to the workers; a constant is sent once, as a task of its own that can be done again."""
        shared = [self.client.submit(_same, constant, pure=False) for constant in constants]
        # One message for all of them: the scheduler is the first thing that many tasks wait for.
        rest = [[constant] * len(items) for constant in shared]
        return list(self.client.map(function, items, *rest, pure=False, retries=2))

    def pairs(self, function: Callable[[Any, Any], Any], first: Sequence[Any], second: Sequence[Any]) -> list[Any]:
        """Send them to the workers."""
        if not first:
            return []
        return list(self.client.map(function, first, second, pure=False, retries=2))

    def gather(self, handles: Sequence[Any], progress: Progress = lambda done, of: None) -> list[Any]:
        """Wait for all of them and fetch them."""
        from distributed import KilledWorker, as_completed

        for done, _ in enumerate(as_completed(list({h.key: h for h in handles}.values())), start=1):
            progress(done, len(handles))
        try:
            return list(self.client.gather(list(handles)))
        except KilledWorker as error:
            raise InputError(f"a part of the work kills every worker that gets it (out of memory?): {error}") from error


def _same(value: Any) -> Any:
    return value


@contextmanager
def workers(scheduler: str | None = None, count: int | None = None) -> Iterator[Workers]:
    """Somewhere to work, closed at the end.

    Parameters
    ----------
    scheduler : str, optional
        Address of a Dask scheduler (``tcp://host:8786``); ``"local"``: a cluster of this machine's cores; ``"none"``:
        this process. By default local where the extra ``frischid[cluster]`` is installed, else this process.
    count : int, optional
        Workers of a local cluster, one a core by default.

    Raises
    ------
    InputError
        Dask is not installed, no scheduler answers at the address, or its workers have another frischid.
    """
    if scheduler == HERE:
        yield Here()
        return
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        if scheduler is None:
            yield Here()
            return
        raise InputError('a cluster needs Dask: pip install "frischid[cluster]"') from None
    if scheduler is None or scheduler == LOCAL:
        with (
            LocalCluster(
                n_workers=count or os.cpu_count() or 1,
                threads_per_worker=1,
                host=_LOOPBACK,
                dashboard_address=f"{_LOOPBACK}:0",
                worker_dashboard_address=f"{_LOOPBACK}:0",
                silence_logs=logging.CRITICAL,
            ) as cluster,
            Client(cluster) as client,
        ):
            yield Dask(client)
        return
    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(f"{scheduler}: no Dask scheduler answers there ({error})") from error
    with client:
        _check_versions(client, scheduler)
        yield Dask(client)


def _check_versions(client: Any, scheduler: str) -> None:
    """Refuse a cluster that would compute something else."""
    if not client.scheduler_info(n_workers=-1)["workers"]:
        raise InputError(f"{scheduler}: the scheduler has no workers; start some with `dask worker {scheduler}`")
    own = metadata.version("frischid")
    for worker, found in client.run(version).items():
        if found != own:
            raise InputError(f"{scheduler}: the worker at {worker} has frischid {found}, this is {own}")


def version() -> str:
    """Version of frischid where this runs."""
    return metadata.version("frischid")
