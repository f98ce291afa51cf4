"""Linear algebra on one thread.

The matrices here have as many columns as a robot has parameters: a few hundred. On several threads, their products and
factorisations are no faster, and the rounding of a sum depends on the number of threads. Where other programs use the
cores too, threads that wait for each other cost far more: `identify` of an arm with 12 joints took 49 s in place of 4 s
on two cores with a load of 4.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


@lru_cache(maxsize=1)
def _libraries() -> Any:
    """The threaded libraries, searched once: the search takes longer than a short sum."""
    import scipy.linalg  # brings a BLAS of its own, which must be there before the search
    from threadpoolctl import ThreadpoolController

    assert scipy.linalg
    return ThreadpoolController()


def one_thread() -> Any:
    """A context in which linear algebra uses one thread; what was set before comes back after it."""
    return _libraries().limit(limits=1, user_api="blas")


def on_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The same function with its linear algebra on one thread.

    Examples
    --------
    >>> from frischid.core.threads import on_one_thread
    >>> on_one_thread(abs)(-2)
    2
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with one_thread():
            return function(*args, **kwargs)

    return limited
