"""Workers: this process, the cores of this machine, or a Dask cluster, with the same result.

Work is a function of picklable arguments. `map` applies the function to many items; `tree` adds the results in pairs,

    ((x₁ + x₂) + (x₃ + x₄)) + …

The shape of this tree depends only on the number of items, so floating-point sums are the same on all workers and in
any order of work. On Dask the results stay with the workers that computed them. When a worker dies, its parts are
computed again from their arguments. A part that is computed twice is added once, because a sum refers to parts by name.
"""

from __future__ import annotations

import logging
import os
import signal
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

from frischid.core.extras import install_command
from frischid.core.version import __version__
from frischid.errors import InputError

LOCAL, HERE = "local", "none"
_LOOPBACK = "127.0.0.1"  # Dask's ports carry pickled code: nobody but this machine may reach them
Progress = Callable[[int, int], None]


class Workers(ABC):
    """Processes that do work. `map` and `tree` return handles; `gather` turns handles into values."""

    where: str

    @abstractmethod
    def map(self, function: Callable[..., Any], items: Sequence[Any], *constants: Any) -> list[Any]:
        """Apply ``function(item, *constants)`` to every item; items may be handles, or lists of them."""

    @abstractmethod
    def pairs(self, function: Callable[[Any, Any], Any], first: Sequence[Any], second: Sequence[Any]) -> list[Any]:
        """Apply ``function(a, b)`` to every pair of handles or values."""

    @abstractmethod
    def gather(self, handles: Sequence[Any], progress: Progress = lambda done, of: None) -> list[Any]:
        """Values of handles, in their order; `progress` is called with the number of finished ones."""

    def tree(self, function: Callable[[Any, Any], Any], handles: Sequence[Any]) -> Any:
        """Combine at least one handle pairwise, neighbours first."""
        level = list(handles)
        while len(level) > 1:
            half = len(level) // 2
            level = [*self.pairs(function, level[: 2 * half : 2], level[1 : 2 * half : 2]), *level[2 * half :]]
        return level[0]


class Here(Workers):
    """One process, this one, which does one item after the other."""

    where = "one process"

    def map(self, function: Callable[..., Any], items: Sequence[Any], *constants: Any) -> list[Any]:
        """Do all of the work at once."""
        return [function(item, *constants) for item in items]

    def pairs(self, function: Callable[[Any, Any], Any], first: Sequence[Any], second: Sequence[Any]) -> list[Any]:
        """Do all of the work at once."""
        return [function(a, b) for a, b in zip(first, second, strict=True)]

    def gather(self, handles: Sequence[Any], progress: Progress = lambda done, of: None) -> list[Any]:
        """Return the handles, which are already values."""
        progress(len(handles), len(handles))
        return list(handles)


class Dask(Workers):
    """A Dask cluster, through its client."""

    def __init__(self, client: Any) -> None:
        self.client = client
        workers = client.scheduler_info(n_workers=-1)["workers"]
        self.where = f"{len(workers)} Dask worker{'s' * (len(workers) != 1)}"

    def map(self, function: Callable[..., Any], items: Sequence[Any], *constants: Any) -> list[Any]:
        """Send the work to the workers; a constant is sent once, as a task of its own that can be repeated."""
        shared = [self.client.submit(_same, constant, pure=False) for constant in constants]
        # One message for all tasks: with many messages, tasks would wait for the scheduler.
        rest = [[constant] * len(items) for constant in shared]
        return list(self.client.map(function, items, *rest, pure=False, retries=2))

    def pairs(self, function: Callable[[Any, Any], Any], first: Sequence[Any], second: Sequence[Any]) -> list[Any]:
        """Send the pairs to the workers."""
        if not first:
            return []
        return list(self.client.map(function, first, second, pure=False, retries=2))

    def gather(self, handles: Sequence[Any], progress: Progress = lambda done, of: None) -> list[Any]:
        """Wait for all handles and fetch their values."""
        from distributed import KilledWorker, as_completed

        for done, _ in enumerate(as_completed(list({h.key: h for h in handles}.values())), start=1):
            progress(done, len(handles))
        try:
            return list(self.client.gather(list(handles)))
        except KilledWorker as error:
            raise InputError(
                f"every worker that got one part of the work ended, probably for lack of memory ({error}); "
                "start fewer workers per machine, or give shorter logs"
            ) from error


def _same(value: Any) -> Any:
    return value


@contextmanager
def workers(scheduler: str | None = None, count: int | None = None) -> Iterator[Workers]:
    """Open workers, and close them at the end.

    Parameters
    ----------
    scheduler : str, optional
        Address of a Dask scheduler (``tcp://host:8786``); ``"local"``: a cluster of this machine's cores; ``"none"``:
        this process. By default local if the extra ``frischid[cluster]`` is installed, otherwise this process.
    count : int, optional
        Workers of a local cluster, one per core by default.

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
        raise InputError(f"a cluster needs Dask: {install_command('cluster')}") from None
    if scheduler is None or scheduler == LOCAL:
        with ExitStack() as opened:
            with _deaf_children():
                cluster = LocalCluster(
                    n_workers=count or os.cpu_count() or 1,
                    threads_per_worker=1,
                    host=_LOOPBACK,
                    dashboard_address=f"{_LOOPBACK}:0",
                    worker_dashboard_address=f"{_LOOPBACK}:0",
                    silence_logs=logging.CRITICAL,
                )
                opened.enter_context(cluster)
                client = opened.enter_context(Client(cluster))
            yield Dask(client)
        return
    try:
        client = Client(scheduler, timeout=10)
    except (OSError, ValueError, AssertionError) as error:  # on a busy machine, Dask's own loop is late
        raise InputError(
            f"{scheduler}: no Dask scheduler answers there ({error}); check the address, or start one with `dask "
            "scheduler`"
        ) from error
    with client:
        _check_versions(client, scheduler)
        yield Dask(client)


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Processes and threads that start within the block do not hear Ctrl-C: this process does, and ends them.

    A terminal sends Ctrl-C to every process of a command, and each worker would answer with a traceback. The mask of
    blocked signals passes from a thread to the threads and processes that it starts. A Ctrl-C within the block counts
    at its end.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _check_versions(client: Any, scheduler: str) -> None:
    """Refuse a cluster whose workers have another version of frischid."""
    if not client.scheduler_info(n_workers=-1)["workers"]:
        raise InputError(f"{scheduler}: the scheduler has no workers; start some with `dask worker {scheduler}`")
    for worker, found in client.run(version).items():
        if found != __version__:
            raise InputError(
                f"{scheduler}: the worker at {worker} has frischid {found}, and this process has {__version__}; "
                "install one version on all machines"
            )


def version() -> str:
    """Version of frischid on the worker that runs this function."""
    return __version__
