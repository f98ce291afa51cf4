"""The errors of frischid, one class for each kind that a caller may want to handle.

Every message names the fault, its place, and the remedy. For bad input, the package raises only these errors; it never
raises a bare exception and never uses an assertion.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

NAMES_OFFERED = 5  # similar names in a message


class FrischidError(Exception):
    """Base class of all errors that frischid raises on purpose.

    Examples
    --------
    >>> import frischid as fr
    >>> try:
    ...     fr.Robot.load("panda2")
    ... except fr.FrischidError as error:
    ...     print(error)
    unknown robot 'panda2'...
    """


class InputError(FrischidError):
    """A file, a column, a value or an option is not usable; the message names it and the remedy.

    Examples
    --------
    >>> import frischid as fr
    >>> fr.Noise(tau=-1.0)
    Traceback (most recent call last):
    frischid.errors.InputError: noise tau must be zero or a positive number, got -1.0
    """


class UnknownNameError(InputError):
    """A name (joint, effect, robot, parameter, column) that does not exist.

    Parameters
    ----------
    kind : str
        Kind of the name, for example ``"joint"``.
    name : str
        The unknown name.
    valid : iterable of str
        The names that exist.
    where : str
        Source of the valid names, for example a file.
    """

    def __init__(self, kind: str, name: str, valid: Iterable[str], where: str = "") -> None:
        options = sorted({name or "''" for name in valid})
        close = close_names(str(name), options)
        listing = ", ".join(close or options[:40]) or "(none)"
        more = f" (+{len(options) - 40} more)" if not close and len(options) > 40 else ""
        lead = "did you mean" if close else "the names are"
        others = f"; all: {', '.join(options)}" if close and len(options) <= 40 else ""
        place = f" in {where}" if where else ""
        super().__init__(f"unknown {kind} '{name}'{place}; {lead}: {listing}{more}{others}")


class IdentifiabilityError(FrischidError):
    """The data do not determine the wanted parameters (too few samples, no motion, a singular moment matrix)."""


class NoBodyError(IdentifiabilityError):
    """Logs that show no body on a link: a result, not a misuse.

    Parameters
    ----------
    frame, carrier : str
        Frame of the wanted result, and the joint of the link.
    limit : float
        kg. Two standard errors above the mass that the logs would give, or above zero.
    more : str
        What else the logs show, for the end of the sentence.
    """

    def __init__(self, frame: str, carrier: str, limit: float, more: str = "") -> None:
        self.frame, self.carrier, self.limit = frame, carrier, limit
        super().__init__(f"no body: less than {limit:.2g} kg (two standard errors) on the link of {carrier}{more}")


class EmptyBoxError(FrischidError):
    """Bounds contradict one another: some lower bound lies above its upper bound.

    Parameters
    ----------
    parameter : str
        Name of the parameter whose interval became empty.
    lower, upper : float
        The two bounds, in the parameter's unit.
    window : int or None
        BBRF window at which the interval became empty, ``None`` when the box was empty from the start.
    """

    def __init__(self, parameter: str, lower: float, upper: float, window: int | None = None) -> None:
        self.parameter, self.lower, self.upper, self.window = parameter, lower, upper, window
        when = "" if window is None else f" at window {window}"
        super().__init__(
            f"the box is empty{when}: parameter {parameter} has lower bound {lower:.6g} above upper bound "
            f"{upper:.6g}; use a longer window, the calibrated recursion (--bbrf calibrated), or the one-shot Frisch "
            "box (--bbrf none)"
        )


def close_names(name: str, options: Iterable[str]) -> list[str]:
    """Names in `options` that resemble `name`, best first (difflib ratio at least 0.5, or containing it)."""
    options = list(options)
    lowered = {o.lower(): o for o in options}
    by_ratio = [lowered[o] for o in difflib.get_close_matches(name.lower(), list(lowered), n=NAMES_OFFERED, cutoff=0.5)]
    by_part = [o for o in options if name and name.lower() in o.lower() and o not in by_ratio]
    return (by_ratio + by_part)[:NAMES_OFFERED]
