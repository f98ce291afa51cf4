"""A body on the last link that the URDF lacks, or that the robot lacks: a payload, or a missing hand.

    τ − τ_nominal ≈ Γ_last(q, q̇, q̈) φ + friction,      φ = (m, mc, I) of the body

One least-squares problem over all joints gives the body. The body is accepted when it explains nearly all of the
nominal URDF's error and is possible. Its mass is positive, or negative and in size at most the mass of the last link;
its centre of mass is within reach.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.checks.log_issue import Notebook
from frischid.checks.sketch import Sketch, shared_fit
from frischid.core.types import Array


@dataclass(frozen=True)
class Body:
    """The body that fits best on the last link.

    Attributes
    ----------
    joint : str
        Joint of the link that carries the body.
    mass : float
        kg; negative when the URDF has a body that is missing on the robot.
    centre : ndarray, shape (3,)
        In the joint's frame, m.
    removed : float
        Share of the nominal URDF's squared error that the body explains; 0 when the body is not possible.
    torque : ndarray, shape (M, J), or None
        Torque of the body at the samples of the sketch.
    """

    joint: str
    mass: float
    centre: Array
    removed: float
    torque: Array | None = None


def payload_errors(sketch: Sketch) -> Body:
    """Fit a body on the last link."""
    few = sketch.thinned(sketch.criteria.few_samples)
    robot = few.robot
    joint = robot.bodies[int(np.argmax([len(list(robot.model.supports[k])) for k in robot.numbers.values()]))]
    last = [i for i, column in enumerate(robot.columns) if column.joint == joint]
    if len(last) < 10 or not len(few.rows):
        return Body(joint, 0.0, np.zeros(3), 0.0)
    Y = np.empty((len(few), len(robot.columns), len(robot.joints)))
    robot.regressor(few.q, few.v, few.a, Y)
    phi = shared_fit(few, {int(j): Y[:, last, j] for j in few.rows}, few.tau - few.nominal)[:10]
    body = np.einsum("nck,c->nk", Y[:, last], phi)
    after = float(np.sum(few.errors(few.nominal + body) ** 2))
    before = float(np.sum(few.asis**2))
    mass, centre = float(phi[0]), phi[1:4] / (phi[0] or 1.0)
    masses = robot.nominal[0::10]
    criteria, own = sketch.criteria, masses[robot.numbers[joint] - 1]
    sensible = -criteria.missing_mass * own < mass < masses.sum() and np.linalg.norm(centre) < criteria.payload_reach
    torque = body if len(few) == len(sketch) else None
    return Body(joint, mass, centre, 1 - after / max(before, 1e-12) if sensible else 0.0, torque)


def check_payload(sketch: Sketch, notes: Notebook) -> bool:
    """Report an additional or missing body on the last link; return whether there is one."""
    if len(sketch.rows) == 0 or sketch.asis.max() < notes.criteria.payload_nrmse:
        return False
    body = payload_errors(sketch)
    criteria = notes.criteria
    # errors as small as those of URDFs may be errors of its links, unless the body explains all there is
    small = sketch.asis.max() < criteria.urdf_error
    if body.removed < (criteria.exact_share if small else criteria.explained_share):
        return False
    what = f"explains {body.removed:.0%} of the squared error of the nominal URDF"
    at = ", ".join(f"{x:.2f}" for x in np.round(body.centre, 2) + 0.0)
    if body.mass > 0:
        notes.add(
            "payload",
            f"a body of about {body.mass:.2g} kg at ({at}) m in the joint's frame, which is not in the URDF, {what}",
            (body.joint,),
            "likely",
            "use a URDF with the payload if it belongs to the robot; take it off if it does not",
        )
    else:
        notes.add(
            "missing hand",
            f"about {-body.mass:.2g} kg that the URDF has on the last link at ({at}) m are missing on the robot: their "
            f"absence {what}",
            (body.joint,),
            "likely",
            "use the URDF of the robot without the hand (or tool) it was measured without",
        )
    return True
