"""Arguments of the public functions: another type than the function takes is refused, with the call that gives it."""

from __future__ import annotations

from numbers import Real
from typing import Any

from frischid.core.text import shortened
from frischid.errors import InputError


def check_kind(name: str, value: Any, kind: type, remedy: str) -> None:
    """Refuse (InputError) a value of another type.

    Parameters
    ----------
    name : str
        Name of the argument.
    remedy : str
        How to make such a value.

    Examples
    --------
    >>> import frischid as fr
    >>> from frischid.core.arguments import check_kind
    >>> check_kind("noise", 0.01, fr.Noise, "frischid.Noise(tau=0.01)")
    Traceback (most recent call last):
    frischid.errors.InputError: noise must be of the type Noise, got 0.01: frischid.Noise(tau=0.01)
    """
    if not isinstance(value, kind):
        raise InputError(f"{name} must be of the type {kind.__name__}, got {shortened(value)}: {remedy}")


def check_number(name: str, value: Any) -> None:
    """Refuse (InputError) what is no single real number, such as a text or a list.

    Examples
    --------
    >>> from frischid.core.arguments import check_number
    >>> check_number("noise q", [1e-5, 1e-4])
    Traceback (most recent call last):
    frischid.errors.InputError: noise q must be one number, got [1e-05, 0.0001]
    """
    if not isinstance(value, Real):
        raise InputError(f"{name} must be one number, got {shortened(value)}")


def is_real(value: Any) -> bool:
    """Whether a value is a real number, of Python or of numpy, and no truth value."""
    return isinstance(value, Real) and not isinstance(value, bool)
