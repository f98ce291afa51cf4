"""The lag of the measured torque behind the measured motion, estimated with every fit.

A torque that is recorded d seconds late is the torque of an earlier state, τ(t) = Y(t − d) θ. To first order the
residuals of the fit hold the time derivative of the fitted torque,

    e_j(t) = −d · d/dt s_j(t)  −  d_j · d/dt f_j(t)  +  Y_j(t) δ,

where s is the fitted torque without dry friction, f its dry friction, and δ the correction of the parameters. The lag d
is taken from s alone: friction with memory, elastic gears and a wrong smoothing of dry friction imitate a delay, but
only where dry friction changes its sign, and each joint has its own d_j there. The derivative is antisymmetric in time.
So a smoothed torque, which is symmetric, is no lag.

A lag of about a sample step is usual: a held command acts half a step late on average, and a stamp may be a step late.
`identify` takes such a lag back: the model is fitted again to the torque that was recorded d later, and stores d
(`LowPass.torque_lag`). A longer lag is said, and is left for the user to explain. A lag that is taken back must lower
the error on stretches left out of the fit. Otherwise a missing effect imitates a lag, and the torque counts as it is.

Standard errors are those of an infinitesimal jackknife over stretches of a second or more. A lag of the recording is
the same on all joints; a model's error is not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from frischid.core.types import Array
from frischid.estimators.least_squares import Estimate
from frischid.model.identification_criteria import IdentificationCriteria
from frischid.model.identification_stages import Problem
from frischid.model.lag_sums import LagSums


@dataclass(frozen=True)
class JointLag:
    """Lag of one joint's torque and its standard error, s; whether it is more than chance."""

    name: str
    lag: float
    error: float
    significant: bool


@dataclass(frozen=True)
class TorqueLag:
    """Lag of the torque behind the motion."""

    lag: float
    error: float
    """`lag`, `error`: Of all joints together, and its standard error, s."""
    step: float
    """Time between the samples of the logs, s; the longest of several."""
    p_value: float
    """Of no lag."""
    joints: tuple[JointLag, ...]
    """Each joint alone."""
    differing: tuple[str, ...]
    """Joints whose lag differs significantly from that of all joints: a delay of the recording would be the same."""
    significant: bool
    """Whether all joints agree on a lag that is not chance."""
    sampling_steps: float
    """Longest lag that sampling and held commands explain, in sample steps."""
    taken: float = 0.0
    """Lag that the model takes back, s; it is a part of `lag`."""

    @property
    def sampling(self) -> bool:
        """Whether sampling and holding explain the lag: it is positive and not too long."""
        return self.below_grain and self.lag > 0

    @property
    def below_grain(self) -> bool:
        """Whether the lag, of either sign, is significant and not longer than sampling and holding make one."""
        return self.significant and abs(self.lag) <= self.sampling_steps * self.step

    @property
    def said(self) -> str:
        """One sentence on the lag and on what becomes of it; empty where no lag is significant and none is taken."""
        if not (self.significant or self.taken):
            return ""
        alike = ", the same on all joints" if len(self.joints) > 1 else ""
        way = "behind" if self.lag > 0 else "ahead of"
        cause = (
            "as sampling and held commands make it"
            if self.sampling
            else "which held commands do not explain: compare the clocks and filters of both channels"
        )
        return (
            f"the torque is {1e3 * abs(self.lag):.3g} ± {1e3 * self.error:.2g} ms {way} the motion "
            f"({abs(self.lag) / self.step:.2g} sample steps){alike}, {cause}. {self._remedy}"
        )

    @property
    def _remedy(self) -> str:
        if self.taken:
            return (
                f"The model counts the torque as {1e3 * abs(self.taken):.3g} ms {'late' if self.taken > 0 else 'early'}"
            )
        if self.below_grain:
            return "Parameters are biased by this lag: identify with --torque-lag auto"
        return "Parameters are biased by this lag: add time_delay (frischid add MODEL time_delay LOGS -o NEW)"

    @property
    def warning(self) -> str:
        """The sentence on a lag that biases the parameters; empty where there is none, or the model takes it back."""
        return "" if self.taken else self.said

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        kept = {**asdict(self), "joints": [asdict(joint) for joint in self.joints], "differing": list(self.differing)}
        return {**kept, "sampling": self.sampling, "said": self.said, "warning": self.warning}


def torque_lag(problem: Problem, estimate: Estimate, sums: LagSums) -> TorqueLag | None:
    """The lag from the sums of a pass over the logs.

    Where a lag is likely, the parameters are wrong by it, and a second pass is made with corrected ones: the standard
    error of the first pass is then too large. A lag that is too long to be taken back is linearised about itself in the
    second pass, not about zero. Where the joints differ in spite of such errors, there is no common lag.

    Parameters
    ----------
    estimate : Estimate
        The fit.
    sums : LagSums
        Of this fit, after the pass.

    Returns
    -------
    TorqueLag or None
        None where the logs are too short, or where the model has a delay of its own.
    """
    data, criteria = problem.data, problem.data.options.criteria
    taken = data.lowpass.torque_lag
    found = _lag(sums, data.joints, criteria, taken)
    if found is None or found[0].differing or not found[1].likely:
        return None if found is None else found[0]
    left = found[0].lag - taken
    about = left if abs(left) > criteria.lag_sampling_steps * sums.step else 0.0
    again = LagSums(problem, estimate, found[1].theta, about=about)
    for motion in again.watch(data.motions):
        for block in problem.regressor.blocks(motion, data.lowpass):
            again.add(block)
    better = _lag(again, data.joints, criteria, taken + about)
    return found[0] if better is None else replace(better[0], taken=taken)


def described(lag: TorqueLag | None) -> Iterator[str]:
    """A note on a lag that the model takes back, or where joints disagree about one that is significant on some."""
    if lag is not None and lag.taken:
        yield lag.said
        return
    own = [] if lag is None else [j for j in lag.joints if j.significant and j.name in lag.differing]
    if lag is None or not own:
        return
    said = [f"{j.name} {1e3 * j.lag:.3g} ± {1e3 * j.error:.2g} ms" for j in own]
    yield (
        f"the torque seems to lag the motion by {1e3 * lag.lag:.3g} ± {1e3 * lag.error:.2g} ms, but not on all joints "
        f"alike ({', '.join(said)}): friction, elasticity or a delay or filter of single drives, not a delay of the log"
    )


def refused(lag: TorqueLag) -> str:
    """The sentence on a lag that is not taken back, because the error on stretches left out of the fit would rise."""
    return (
        f"the torque seems to lag the motion by {1e3 * lag.lag:.3g} ± {1e3 * lag.error:.2g} ms, but with this lag taken"
        " back the error on stretches that were left out of the fit rises: a missing effect imitates a lag, and the"
        " model counts the torque as recorded"
    )


class _Again(NamedTuple):
    """Corrected parameters (p,), and whether the lag that is left makes them necessary."""

    theta: Array
    likely: bool


def _lag(
    sums: LagSums, names: Sequence[str], criteria: IdentificationCriteria, taken: float
) -> tuple[TorqueLag, _Again] | None:
    """The lag of the logs, a part of which the sums take back; None where too little was recorded."""
    sums.finish()
    J, freedom = len(names), sums.stretches - 1
    if not sums.wanted or sums.stretches < criteria.lag_stretches or not sums.step:
        return None
    one = sums.solved(np.zeros(J, int), np.arange(1, J + 1))
    each = sums.solved(np.arange(J), np.arange(J, 2 * J))
    lag, error = float(one.value[0]) + taken, float(one.error[0])
    if not error > 0:
        return None
    p_value = float(2 * special.stdtr(freedom, -abs(lag) / error))
    likely = 2 * special.stdtr(freedom, -abs(lag - taken) / error) <= criteria.lag_likely_p_value
    # the doubt about the difference itself, because a joint's lag and that of all joints share their errors
    doubt = np.sqrt(np.square(each.influence[:, :J] - one.influence[:, :1]).sum(axis=0))
    bar = -special.stdtrit(freedom, criteria.lag_differs_p_value / (2 * J)) * doubt
    bar = np.maximum(bar, criteria.lag_differs_share * abs(lag))
    told = each.error[:J] > 0  # where a joint turns a body of revolution, its lag and its rotor inertia are one column
    bar = np.where(told, bar, np.inf)
    value = each.value[:J] + taken
    own = np.where(told, 2 * special.stdtr(freedom, -np.abs(value) / np.maximum(each.error[:J], 1e-300)), 1.0)
    joints = tuple(
        JointLag(n, float(x), float(s), bool(p < criteria.lag_p_value / J))
        for n, x, s, p in zip(names, value, each.error, own, strict=False)
    )
    differing = tuple(j.name for j, most in zip(joints, bar, strict=True) if abs(j.lag - lag) > most)
    known = p_value < criteria.lag_p_value
    limit = criteria.lag_sampling_steps
    found = TorqueLag(lag, error, sums.step, p_value, joints, differing, known and not differing, limit, taken)
    return found, _Again(sums.theta + one.change, bool(likely))
