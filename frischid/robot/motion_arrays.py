"""Arrays of a motion that a caller gives: refused, with a name and a shape, unless each joint has its column."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError


def motion_of(joints: Sequence[str], **given: Any) -> tuple[Array, ...]:
    """Positions, velocities and other values of the joints as arrays of floats, (N, J) each.

    Parameters
    ----------
    joints : sequence of str
        The robot's J joints.
    **given : array_like, shape (N, J) or (J,)
        The arrays by the names that a message gives them; the first one has the N samples that the others must have.

    Raises
    ------
    InputError
        An array holds no numbers, does not have J columns, or the lengths differ.

    Examples
    --------
    >>> from frischid.robot.motion_arrays import motion_of
    >>> q, v = motion_of(("shoulder", "elbow"), q=[[0, 1], [2, 3]], v=[[0, 0], [0, 0]])
    >>> q.dtype, v.shape
    (dtype('float64'), (2, 2))
    >>> motion_of(("shoulder", "elbow"), q=[[0, 1], [2, 3]], tau=[[0], [0]])
    Traceback (most recent call last):
    frischid.errors.InputError: tau has the shape (2, 1); expected (2, 2): a row for each sample of q, ...
    """
    arrays = {name: np.atleast_2d(numbers_of(name, x)) for name, x in given.items()}
    first, lead = next(iter(arrays.items()))
    for name, x in arrays.items():
        if x.ndim != 2 or x.shape[1] != len(joints) or len(x) != len(lead):
            raise InputError(
                f"{name} has the shape {x.shape}; expected ({len(lead)}, {len(joints)}): a row for each sample of "
                f"{first}, a column for each of {', '.join(joints)}"
            )
    return tuple(arrays.values())


def times_of(t: Any, count: int, *, forward: bool = False) -> Array:
    """Times of the samples of a motion, s, shape (count,); zeros where none are given.

    Parameters
    ----------
    t : array_like, shape (count,), or None
    count : int
        Samples of the motion.
    forward : bool
        Whether something remembers the samples before, so that no time may lie before the one above it.

    Raises
    ------
    InputError
        The times are not finite numbers, one for each sample; or they go backwards.

    Examples
    --------
    >>> from frischid.robot.motion_arrays import times_of
    >>> times_of([0, 1], 3)
    Traceback (most recent call last):
    frischid.errors.InputError: t has the shape (2,); expected (3,): a time in s for each sample
    """
    if t is None:
        return np.zeros(count)
    times = numbers_of("t", t)
    if times.shape != (count,):
        raise InputError(f"t has the shape {times.shape}; expected ({count},): a time in s for each sample")
    if not np.isfinite(times).all():
        raise InputError(f"t[{int(np.argmin(np.isfinite(times)))}] is not a finite number; t holds times in s")
    if forward and (np.diff(times) < 0).any():
        k = int(np.argmax(np.diff(times) < 0)) + 1
        raise InputError(
            f"t[{k}] = {times[k]:g} s lies before t[{k - 1}] = {times[k - 1]:g} s, and an effect remembers the "
            "samples before; give the samples in the order of their times"
        )
    return times


def numbers_of(name: str, x: Any) -> Array:
    """An array of floats; `name` is what a message calls it.

    Raises
    ------
    InputError
        The values are no numbers, or rows have different lengths.
    """
    try:
        return np.asarray(x, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be an array of numbers, of rows of one length: {error}") from error
