"""Whether a body on another link explains the logs better than on the link that was named.

A glue pump on a forearm, weighed as if it hung on the flange, gets a wrong mass with narrow bounds. So the body is also
fitted on each link between the base and the named one, with the same ten parameters and the same prior. With the
squared residuals of the logs' blocks of time b in units of the model's variance,

    d_b = Σ_j (SSE_bj on the named link − SSE_bj on the other link) / σ_j²,

the other link is better where the mean of d_b is above zero by Student's t (p < 0.01, corrected for the number of links
that are tried). That matters where the logs determine the mass there, and this mass is outside the bound of the mass
here.

Source: Vuong 1989, Likelihood ratio tests for model selection and non-nested hypotheses, Econometrica 57(2).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.estimators.p_values import mean_above_zero
from frischid.model.alarms import Alarm
from frischid.model.model import Model
from frischid.model.payload_fit import BodyFit, felt_on
from frischid.robot.robot import LINK_PARAMETERS

BY_CHANCE = 0.01
"""Probability that no better link looks better. The level of the other tests of a comparison."""
FEWEST_BLOCKS = 5


class _Carrier(NamedTuple):
    """A link that explains the logs better: mean gain, joint, the mass there and its bound, kg, and the p value."""

    gain: float
    joint: str
    mass: float
    bound: float
    chance: float


def carriers_before(model: Model, name: str) -> list[str]:
    """Joints between the base and a joint behind whose links the mass of a body acts on the torque."""
    robot = model.robot
    path = set(robot.model.supports[robot.numbers[name]])
    before = [joint for joint in robot.joints if joint != name and robot.numbers[joint] in path]
    return [joint for joint in before if LINK_PARAMETERS.index("m") in felt_on(model, joint)]


def other_carriers(model: Model, name: str, bodies: Mapping[str, BodyFit]) -> tuple[Alarm, ...]:
    """The alarm that a body is on another link than the named one; none where the named link is as good as any.

    Parameters
    ----------
    name : str
        Joint of the link on which the body is taken to be.
    bodies : mapping of str to BodyFit
        The fit there, and those on the links before it.
    """
    found = sorted(_better(model, name, bodies), reverse=True)
    if not found:
        return ()
    where = [f"{x.joint} ({x.mass:.3g} ± {x.bound:.2g} kg)" for x in found]
    return (
        Alarm(
            "other-carrier",
            "doubt",
            f"A body on the link of {listed(where, 'or')} explains these logs better than one on the link of {name}. "
            "If the body is there, the mass is wrong by more than its bound.",
            f"Look where the body is, and name the joint of its link: --carrier {found[0].joint}.",
            tuple(x.joint for x in found),
            found[0].chance,
            BY_CHANCE,
        ),
    )


def _better(model: Model, name: str, bodies: Mapping[str, BodyFit]) -> Iterator[_Carrier]:
    """Each link that explains the logs better, with another mass."""
    before, (here, own) = _squares(model, bodies[name]), _mass(bodies[name])
    others = {joint: body for joint, body in bodies.items() if joint != name}
    for joint, other in others.items() if len(before) >= FEWEST_BLOCKS else ():
        gain = before - _squares(model, other)
        chance = min(1.0, mean_above_zero(gain) * len(others)) if gain.any() else 1.0
        mass, bound = _mass(other)
        if chance < BY_CHANCE and mass > bound and abs(mass - here) > own:
            yield _Carrier(float(gain.mean()), joint, mass, bound, chance)


def _mass(body: BodyFit) -> tuple[float, float]:
    """Mass of a body and its bound of 95 %, kg."""
    return float(body.phi[0]), 2.0 * float(np.sqrt(body.covariance[0, 0]))


def _squares(model: Model, body: BodyFit) -> Array:
    """Squared residuals of each block of time in units of the model's variance, (blocks,)."""
    theta, variance = body.fit.theta, model.estimate.sigma**2
    return np.array([float((block.residual_ss(theta) / variance).sum()) for block in body.blocks])
