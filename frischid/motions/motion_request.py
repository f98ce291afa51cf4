"""Lengths, rates and seeds that a motion can have; others are refused before anything is computed."""

from __future__ import annotations

from frischid.core.arguments import check_number
from frischid.core.text import shortened
from frischid.errors import InputError

SHORTEST_MOTION, LONGEST_MOTION = 0.01, 3600.0
"""s. A shorter motion has no finite accelerations, a longer one too many coefficients."""
LONGEST_SAMPLING = 10_000_000
"""Samples of a motion in memory, 80 MB per column."""
MOST_RUNS = 1000
"""Runs of a motion in a row: of the usual 10 s, almost three hours, and memory grows with each."""
LARGEST_SEED = 2**31
"""Generators of the Sobol sequence take seeds below 2**32, and several starts count on from the given one."""


def check_length(duration: float, seed: int) -> None:
    """Refuse (InputError) a length [s] or a seed of a motion that is made up."""
    check_number("the duration", duration)
    check_number("the seed", seed)
    if not SHORTEST_MOTION <= duration <= LONGEST_MOTION:
        raise InputError(f"the duration must be {SHORTEST_MOTION:g} to {LONGEST_MOTION:g} s, got {duration:g}")
    if not 0 <= seed <= LARGEST_SEED:
        raise InputError(f"the seed must be a whole number from 0 to {LARGEST_SEED}, got {seed}")


def check_seed(seed: int) -> None:
    """Refuse (InputError) a seed that is none."""
    check_number("the seed", seed)
    if seed < 0:
        raise InputError(f"the seed must be a whole number from 0, got {seed}")


def check_runs(repeat: int) -> None:
    """Refuse (InputError) a number of runs of a motion that is none, or that nobody records in one log."""
    if not 1 <= repeat <= MOST_RUNS:
        raise InputError(f"a motion can run 1 to {MOST_RUNS} times in a row, got repeat {shortened(repeat)}")


def check_rate(rate: float, duration: float, seed: int = 0) -> None:
    """Refuse a sampling rate [Hz] that is none or gives more than `LONGEST_SAMPLING`, and a seed that is none.

    Raises
    ------
    InputError

    Examples
    --------
    >>> from frischid.motions.motion_request import check_rate
    >>> check_rate(-1.0, 20.0)
    Traceback (most recent call last):
    frischid.errors.InputError: the rate must be a positive number up to 5e+05 Hz for 20 s, got -1
    """
    check_seed(seed)
    check_number("the rate", rate)
    if not (rate > 0 and rate * duration <= LONGEST_SAMPLING):
        most = LONGEST_SAMPLING / duration
        raise InputError(f"the rate must be a positive number up to {most:.3g} Hz for {duration:g} s, got {rate:g}")
