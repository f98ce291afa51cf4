"""Families of motions that a search chooses from.

    (q, q̇, q̈)(t) = (β(t), β̇(t), β̈(t)) X

Each motion of a family is linear in its coefficients X, so the gradient of a cost by X is a product with the same β.
The curves are those of `frischid.motions.trajectory`. Steps and chirps (`frischid.motions.chirps`) are quintics through
points that a law gives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError
from frischid.motions.chirps import STEP_SHARES, USUAL, law
from frischid.motions.trajectory import BSpline, ClosedForm, Fourier, Quintic

FAMILIES = ("fourier", "bspline", "points", *STEP_SHARES)

WITHOUT_RETURN = ("bspline", "points")
"""Families whose motions end elsewhere than where they began."""


def check_return(family: str, repeat: int) -> None:
    """Refuse (InputError) several runs in a row of a family whose motions do not end where they began."""
    if repeat > 1 and family in WITHOUT_RETURN:
        raise InputError(
            f"a motion of the family {family} cannot be repeated: it does not end where it began; plan with the family "
            "fourier"
        )


@dataclass(frozen=True, eq=False)
class Family:
    """Motions linear in their coefficients."""

    build: Callable[[Array], ClosedForm]
    """Coefficients (P, J) -> motion."""
    constant: Array
    """Coefficients of the motion that stays at 1, (P,)."""
    fastest: float = 0.0
    """Hz. Highest frequency that a motion may have; 0 where its number of coefficients says this."""

    @classmethod
    def named(cls, name: str, duration: float, size: int, highest: float = USUAL) -> Family:
        """Build a family by name, of `size` harmonics, control points, via points, or chirp windows to `highest` Hz."""
        if name == "fourier":
            return cls(
                lambda X: Fourier.rested(X[0], X[1 : size + 1], X[size + 1 :], duration), np.eye(2 * size + 1)[0]
            )
        if name == "bspline":
            return cls(lambda X: BSpline.rested(X, duration), np.ones(size))
        if name in STEP_SHARES:
            t, rows, constant = law(name, duration, size, highest)
            return cls(lambda X: Quintic(t, *(rows @ X)), constant, highest)
        if name != "points":
            raise UnknownNameError("family", name, FAMILIES)
        t = np.linspace(0.0, duration, size)

        def joined(X: Array) -> Quintic:
            rest = np.zeros((1, X.shape[1]))
            v, a = X[size : 2 * size - 2], X[2 * size - 2 :]
            return Quintic(t, X[:size], np.concatenate([rest, v, rest]), np.concatenate([rest, a, rest]))

        return cls(joined, np.concatenate([np.ones(size), np.zeros(2 * size - 4)]))

    def basis(self, t: Array) -> Array:
        """Rows β, β̇, β̈ at times t: the family's motion with unit coefficients, (3, N, P)."""
        return np.stack(self.build(np.eye(len(self.constant)))(t))
