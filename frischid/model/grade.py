"""The grade of an error: its place between the noise of the sensors and the URDF with fitted friction.

    A … E   five equal factors from the noise of the sensors to the reference:  (reference / noise)^(1/5) each
    F       no better than the reference

The reference is the URDF with fitted friction, or a constant torque where the URDF is worse than that, or as good as
the sensors. Words such as "halfway" are not true of a factor, so a grade's words give the two factors themselves.
"""

from __future__ import annotations

import numpy as np

from frischid.core.text import percent

AS_THE_SENSORS = 1.15
"""Error over the noise floor up to which the sensors may cause all of it: the floor is not known better."""


def between(nrmse: float, floor: float, reference: float) -> float:
    """Place of an error between two others, by logarithms: 0 at the smaller one, 1 at the larger one and beyond.

    Examples
    --------
    >>> from frischid.model.grade import between
    >>> between(0.1, 0.01, 1.0)
    0.5
    """
    if floor <= 0 or nrmse <= floor:
        return 0.0
    return 1.0 if nrmse >= reference else float(np.log(nrmse / floor) / np.log(reference / floor))


def fifth(nrmse: float, floor: float, reference: float) -> int:
    """The fifth of the scale of `between` in which an error lies: 0 to 4.

    Examples
    --------
    >>> from frischid.model.grade import fifth
    >>> [fifth(nrmse, 0.01, 1.0) for nrmse in (0.01, 0.1, 2.0)]
    [0, 2, 4]
    """
    return min(4, int(5 * between(nrmse, floor, reference)))


def graded(nrmse: float, floor: float, urdf: float, constant: float) -> tuple[str, str]:
    """The grade of an error, A to F, and its meaning in words.

    Parameters
    ----------
    floor, urdf, constant : float
        NRMSE of the sensors' noise alone, of the URDF with fitted friction, and of a constant torque.

    Examples
    --------
    >>> from frischid.model.grade import graded
    >>> graded(0.05, 0.01, 0.2, 1.0)
    ('C', '25 % of the error of the URDF with fitted friction, 5 times the noise of the sensors')
    >>> graded(0.3, 0.01, 0.2, 1.0)
    ('F', 'no better than the URDF with fitted friction')
    """
    if nrmse <= AS_THE_SENSORS * floor:  # also where the URDF is as good
        return "A", "as good as the noise of the sensors allows"
    # A URDF that is as good as the sensors leaves nothing to compare with.
    known = AS_THE_SENSORS * floor < urdf < constant
    name, reference = ("the URDF with fitted friction", urdf) if known else ("a constant torque", constant)
    if nrmse >= reference:
        return "F", f"no better than {name}"
    times = f", {nrmse / floor:.2g} times the noise of the sensors" if floor > 0 else ""
    return "ABCDE"[fifth(nrmse, floor, reference)], f"{percent(nrmse / reference)} of the error of {name}{times}"
