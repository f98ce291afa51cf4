"""Values of a controller: checked, as text, and as a file holds them."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from frischid.core.arguments import is_real
from frischid.core.text import shortened
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.log import GARBAGE


def check_limits(limit: Array, joints: Sequence[str]) -> None:
    """Refuse (InputError) an effort limit of a joint whose kd, and so whose whole torque, is not known."""
    limited = [joint for joint, x in zip(joints, limit, strict=True) if np.isfinite(x)]
    if limited:
        raise InputError(
            f"the effort limit of {limited[0]} acts on the whole torque and needs its kd: give "
            f"--kd {shlex.quote(f'{limited[0]}=VALUE')}, or leave --effort-limit out where the drive does not reach "
            "its limit"
        )


def check_value(name: str, joint: str, value: Any) -> None:
    """Refuse (InputError) a value that is no number, or has the wrong sign."""
    of = f" of {joint}" if joint else ""
    if not is_real(value) or not abs(value) < GARBAGE:
        raise InputError(f"the controller's {name}{of} must be a number below {GARBAGE:g}, got {shortened(value)}")
    if value < 0 or (value == 0 and name in ("kp", "limit")):
        sign = "above 0" if name in ("kp", "limit") else "at least 0"
        why = ": a drive pushes towards its command; is the sign of the command or of the position wrong?" * (
            name in ("kp", "kd")
        )
        raise InputError(f"the controller's {name}{of} must be {sign}, got {value:g}{why}")


def opened(key: str, value: Any) -> Any:
    """A value of a file, with None for the word ``auto`` where kd may be open."""
    if key != "kd":
        return value
    if isinstance(value, Mapping):
        return {joint: None if x == "auto" else x for joint, x in value.items()}
    return None if value == "auto" else value


def shown_value(value: Any) -> str:
    """A value, or the values of joints, as the command line writes them."""
    if value is None:
        return "unknown"
    if isinstance(value, Mapping):
        same = set(value.values())
        if len(same) == 1:
            return shown_value(same.pop())
        shown = [f"{joint}={shown_value(x)}" for joint, x in value.items()]
        return ", ".join(shown)
    return f"{value:.4g}"
