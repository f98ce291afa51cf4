"""How sharply dry friction changes its sign, read off the data.

    τ_dry = fc tanh(q̇ / width)

Dry friction is a step at zero speed; sensors and pre-sliding make a ramp of it. The width of that ramp enters no
linear fit, so moments of all widths are taken in one pass, each a column of its own, and the one that predicts best a
part of the data left out is kept: first of a series, then of values between its members. A wider one must pay for
itself, because a sharp sign errs least on other motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.effects import BASELINE, Coulomb, Effect, State, Term
from frischid.errors import IdentifiabilityError
from frischid.estimate import cross_validated, wls
from frischid.gram import total
from frischid.reduction import Reduction
from frischid.regressor import Regressor, accumulate
from frischid.robot import Robot
from frischid.signals import LowPass, Motion

WIDTHS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)  # rad/s (m/s)
BETWEEN = (0.65, 0.8, 1.25, 1.5)  # of the best of these
SAMPLE = 6000  # samples that are looked at
DECISIVE = 0.98  # share of a sharper one's error below which a wider sign is worth it


def dry_width(
    robot: Robot, motions: Sequence[Motion], lowpass: LowPass, joints: Sequence[str], reduction: Reduction
) -> float | None:
    """Width of dry friction's sign that predicts best a part of the data left out.

    Parameters
    ----------
    robot : Robot
    motions : sequence of Motion
        Their middles are looked at, `SAMPLE` samples in all.
    lowpass : LowPass
    joints : sequence of str
        Joints whose torque rows are used.
    reduction : Reduction
        Base parameters under the baseline effects; they are the same for any width.

    Returns
    -------
    float or None
        rad/s (m/s); None: too little data for a choice.
    """
    share = min(1.0, SAMPLE / sum(len(m.t) for m in motions))
    parts = [m.middle(share) for m in motions]
    try:
        errors = _errors(robot, parts, lowpass, joints, reduction, WIDTHS)
        best = min(w for w, error in errors.items() if DECISIVE * error <= min(errors.values()))
        near = _errors(robot, parts, lowpass, joints, reduction, [float(f"{best * x:.2g}") for x in BETWEEN])
    except IdentifiabilityError:
        return None  # what the whole logs can do is judged later
    better = min(near, key=lambda width: near[width])
    return better if near[better] < DECISIVE * errors[best] else best


def baseline(width: float) -> tuple[Effect, ...]:
    """The baseline effects with dry friction of this width, rad/s (m/s)."""
    return tuple(replace(e, width=width) if isinstance(e, Coulomb) else e for e in BASELINE)


@dataclass(frozen=True)
class _Widths(Coulomb):
    """Dry friction of several widths, each in columns of its own."""

    widths: tuple[float, ...] = ()

    def terms(self, state: State) -> list[Term]:
        return [term for w in self.widths for term in self._of(w, state)]

    def _of(self, w: float, state: State) -> list[Term]:
        return self.per_joint(state, f"fc({w:g})", "", lambda i: np.tanh(state.v[:, i] / w), sign=1)

    def nominal(self, robot: Robot) -> list[float]:
        return [x for _ in self.widths for x in super(_Widths, self).nominal(robot)]


def _errors(
    robot: Robot,
    motions: Sequence[Motion],
    lowpass: LowPass,
    joints: Sequence[str],
    reduction: Reduction,
    widths: Sequence[float],
) -> dict[float, float]:
    """Mean cross-validated NRMSE for each width."""
    several = _Widths(widths=tuple(widths))
    regressor = Regressor(robot, [several if isinstance(e, Coulomb) else e for e in BASELINE])
    place = {c.name: k for k, c in enumerate(regressor.columns)}
    blocks = list(accumulate(regressor, motions, lowpass, joints))
    if len(blocks) < 2 or sum(int(b.counts.sum()) for b in blocks) < 2 * reduction.rank:
        raise IdentifiabilityError("too few samples to choose the width of dry friction's sign")
    leading = [reduction.columns[k] for k in reduction.base]
    found = {}
    for w in widths:
        names = [f"fc({w:g}){c.name.removeprefix('fc')}" if c.effect == Coulomb.id else c.name for c in leading]
        chosen = [replace(b.select([place[n] for n in names]), columns=reduction.base_columns()) for b in blocks]
        variance = cross_validated(chosen, wls(chosen))
        whole = total(chosen)
        found[w] = float(np.mean(np.sqrt(variance / (whole.torque_ss() / whole.counts))))
    return found
