"""Width and lead of dry friction's change of direction, chosen from the data.

    τ_dry = fc tanh((q̇ + lead q̈) / width)

Dry friction is a step at zero speed. Sensors and pre-sliding turn the step into a ramp of some width. If friction stops
a joint before the joint reverses, friction changes before the speed does, by the lead. Width and lead are not linear
parameters. So moments of many values are computed in one pass, each value as a column of its own. The value that best
predicts data left out of the fit is kept: first of a series of widths, then of leads, then of values in between. A
wider sign, or a lead, must lower the error clearly, because a sharp sign at the reversal has the smallest error on
other motions. On a slow robot the sharpest sign of the series may still be too wide: where the error clearly falls at
that end, sharper ones are tried too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.effects import BASELINE, Coulomb, Effect, State, Term
from frischid.errors import IdentifiabilityError
from frischid.estimators.held_out import held_out_stretches, held_out_variance
from frischid.estimators.least_squares import joint_weights, least_squares_folds
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.regression.accumulation import accumulate
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor
from frischid.robot.robot import Robot

WIDTHS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)  # rad/s (m/s)
SHARPER = (0.0001, 0.0002, 0.0005)  # rad/s (m/s): tried where the sharpest of WIDTHS is clearly better than the next
LEADS = (0.001, 0.002, 0.005, 0.01, 0.02)  # s
WIDTHS_WITH_LEAD = (
    0.002,
    0.01,
)  # rad/s (m/s): widths that are tried with a lead; a sign that looks wide without a lead is narrow with it
REFINEMENTS = (0.65, 0.8, 0.95, 1.25, 1.5)  # factors on the best of these
SMOOTHING_SAMPLES = 6000  # samples that are used
OVERSAMPLING = 20.0  # sufficient rate of samples, as a multiple of the cut-off
LEAST_VARIANCE = 1e-30  # lower limit of a variance, so that a dead torque has a logarithm
DECISIVE = 0.98  # a wider sign, or a lead, must lower the error of the simpler one to this share


def dry_friction(
    robot: Robot,
    motions: Sequence[Motion],
    lowpass: LowPass,
    joints: Sequence[str],
    reduction: Reduction,
    effects: Sequence[Effect] = BASELINE,
) -> Coulomb | None:
    """Dry friction with the width and lead that best predict data left out of the fit.

    Parameters
    ----------
    motions : sequence of Motion
        Their middles are used, `SMOOTHING_SAMPLES` samples in all, at a rate that suffices for the filter.
    joints : sequence of str
        Joints whose torque rows are used.
    reduction : Reduction
        Base parameters under the effects; they are the same for any width and lead.
    effects : sequence of Effect
        Effects of the robot, with dry friction among them.

    Returns
    -------
    Coulomb or None
        None: too little data for a choice.
    """
    coarse = [m.part(slice(None, None, _every(m, lowpass))) for m in motions]
    share = min(1.0, SMOOTHING_SAMPLES / sum(len(m.t) for m in coarse))
    parts = [m.middle(share) for m in coarse]

    simple, ahead = (
        [Coulomb(width=w) for w in WIDTHS],
        [Coulomb(width=w, lead=lead) for w in WIDTHS_WITH_LEAD for lead in LEADS],
    )
    try:
        known = _errors(robot, parts, lowpass, joints, reduction, [*simple, *ahead], effects)
        if known[simple[0]] < DECISIVE * known[simple[1]]:
            sharper = [Coulomb(width=w) for w in SHARPER]
            known |= _errors(robot, parts, lowpass, joints, reduction, sharper, effects)
            simple = [*sharper, *simple]
        best = _simplest(simple, known)
        best = _simplest([best, min(ahead, key=lambda c: known[c])], known)
        near = _near(best)
        known |= _errors(robot, parts, lowpass, joints, reduction, near, effects)
    except IdentifiabilityError:
        return None  # later stages decide whether the whole logs suffice
    return _simplest([best, min(near, key=lambda c: known[c])], known)


def _every(motion: Motion, lowpass: LowPass) -> int:
    """Every n-th sample is used: a filter to a few hertz needs no kilohertz."""
    return 1 if lowpass.cutoff is None else max(1, int(1.0 / (OVERSAMPLING * lowpass.cutoff * motion.step)))


def _simplest(ordered: Sequence[Coulomb], errors: Mapping[Coulomb, float]) -> Coulomb:
    """The first one whose error is not clearly above the least error."""
    return next(c for c in ordered if DECISIVE * errors[c] <= min(errors[x] for x in ordered))


def _near(best: Coulomb) -> list[Coulomb]:
    """Values between those of the series."""
    leads = [best.lead * x for x in (*REFINEMENTS, 1.0)] if best.lead else [0.0]
    return [Coulomb(width=_rounded(best.width * x), lead=_rounded(lead)) for x in REFINEMENTS for lead in leads]


def _rounded(x: float) -> float:
    return float(f"{x:.2g}")


def baseline(dry: Coulomb) -> tuple[Effect, ...]:
    """The baseline effects with this dry friction."""
    return tuple(dry if isinstance(e, Coulomb) else e for e in BASELINE)


@dataclass(frozen=True)
class _Several(Coulomb):
    """Several dry frictions, each in columns of its own."""

    members: tuple[Coulomb, ...] = ()

    def terms(self, state: State) -> list[Term]:
        return [
            replace(term, column=replace(term.column, name=f"{term.column.name}_{k}"))
            for k, member in enumerate(self.members)
            for term in member.terms(state)
        ]

    def nominal(self, robot: Robot) -> list[float]:
        return [x for member in self.members for x in member.nominal(robot)]


def _errors(
    robot: Robot,
    motions: Sequence[Motion],
    lowpass: LowPass,
    joints: Sequence[str],
    reduction: Reduction,
    members: Sequence[Coulomb],
    effects: Sequence[Effect],
) -> dict[Coulomb, float]:
    """Geometric mean over the joints of the cross-validated NRMSE with each of some dry frictions."""
    several = _Several(members=tuple(members))
    regressor = Regressor(robot, [several if isinstance(e, Coulomb) else e for e in effects])
    leading, described = [reduction.columns[k] for k in reduction.base], reduction.base_columns()
    base = {c.name for c in leading}
    kept = [k for k, c in enumerate(regressor.columns) if c.effect == Coulomb.id or c.name in base]
    # Every member is judged on the same stretches, so the blocks of each stretch are added once.
    stretches = held_out_stretches(accumulate(regressor, motions, lowpass, joints, base=kept))
    if int(stretches.counts.sum()) < 2 * reduction.rank:
        raise IdentifiabilityError(
            "the logs have too few samples to choose the width of dry friction's sign; record longer, or give the "
            "width, for example coulomb(width=0.01)"
        )
    place = {c.name: k for k, c in enumerate(stretches.columns)}
    found = {}
    for k, member in enumerate(members):
        names = [f"{c.name}_{k}" if c.effect == Coulomb.id else c.name for c in leading]
        chosen = stretches.select([place[n] for n in names]).described(described)
        whole = chosen.total()
        variance = held_out_variance(least_squares_folds(chosen, joint_weights(whole)))
        # The mean of logarithms, as in the likelihood of joints that each have noise of their own.
        left = np.maximum(variance / np.maximum(whole.torque_ss() / whole.counts, LEAST_VARIANCE), LEAST_VARIANCE)
        found[member] = float(np.exp(0.5 * np.mean(np.log(left))))
    return found
