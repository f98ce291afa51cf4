"""A body on the last link that the URDF lacks, or that the robot lacks: a payload, or a missing hand.

    τ − τ_nominal ≈ Γ_last(q, q̇, q̈) φ + friction,      φ = (m, mc, I) of the body

One least-squares problem over all joints gives the body. The body is accepted when it explains nearly all of the
nominal URDF's error and is possible. Its mass is positive, or negative and in size at most the mass of the last link;
its centre of mass is within reach. No mass is stated where the motion does not determine the mass, as that of a wheel.

A URDF whose links are too heavy or too light looks like a body too: an error of the last link *is* a body on it. So the
links' own errors are the rival,

    τ − τ_nominal ≈ Σ_i ε_i Γ_i μ_i + friction,      ε_i ~ N(0, s²),      s = 0.1 for a body,

either with one factor 1 + ε_i for the parameters μ_i of each link, or with an ε for each of its ten parameters and
μ = m, m ℓ, m ℓ² for mass, first moments and inertias, with the link's mass m by the URDF and the ℓ of a rod of its
length: where the centres of mass are wrong too, no factors explain the torques, and ten numbers on the last link seem
to. The likelier of these two rivals counts. With e_k the error of row k behind the body or a rival, and ν_k its degrees
of freedom, the body is the better explanation if

    ½ Σ_k ν_k ln(e²_links,k / e²_body,k) + Σ_i ε_i² / (2 s²) + ½ ln det(s² H)  >  cost of a body and of its p numbers.

H is the information about ε with its prior: the two terms with s are the price of the links' errors in the marginal
likelihood (MacKay 1992, Neural Computation 4(3)). ν_k is the number of independent samples of row k less the numbers of
its friction. The p numbers of a body, ten if the motion turns it about all axes, fit every short log. So e²_body is the
mean square that is left, times Σν / (Σν − p): a log with Σν ≤ p is evidence of nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.checks.faults import cost
from frischid.checks.log_issue import Notebook
from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import FRICTION_NUMBERS, Sketch, shared_fit
from frischid.core.text import percent
from frischid.core.types import Array
from frischid.robot.robot import Robot
from frischid.robot.stated_inertials import sizes_of_links

LEAST_ERROR = 1e-6
"""NRMSE: noise-free logs are not infinitely sure."""

CARRIED = (
    "use a URDF with the payload if it belongs to the robot; take it off if it does not; if the robot carries nothing, "
    "the URDF is that of another robot, or its links are too light"
)
"""The remedy for a body that the URDF lacks."""
LEFT_OFF = (
    "use a URDF without this hand or tool: the robot did not carry it; if the URDF has none, it is that of another "
    "robot, or its links are too heavy"
)
"""The remedy for a body that the robot lacks."""


@dataclass(frozen=True, eq=False)
class Body:
    """The body that fits best on the last link."""

    joint: str
    """Joint of the link that carries the body."""
    mass: float
    """kg; negative when the URDF has a body that is missing on the robot."""
    centre: Array
    """In the joint's frame, m, (3,)."""
    removed: float
    """Share of the nominal URDF's squared error that the body explains; 0 when the body is not possible."""
    torque: Array | None = None
    """Torque of the body at the samples of the sketch, (M, J), or None."""


def last_joint(robot: Robot) -> str:
    """The joint that the most others carry."""
    return robot.bodies[int(np.argmax([len(list(robot.model.supports[k])) for k in robot.numbers.values()]))]


def last_link(sketch: Sketch) -> Array:
    """Columns of the parameters of the last link, (M, P, J); P is below 10 where a robot has no full body there."""
    return sketch.motion.body(last_joint(sketch.robot))


def payload_errors(sketch: Sketch) -> Body:
    """Fit a body on the last link."""
    few = sketch.thinned(sketch.criteria.few_samples)
    joint, Y = last_joint(few.robot), last_link(few)
    if Y.shape[1] < 10 or not len(few.rows):
        return Body(joint, 0.0, np.zeros(3), 0.0)
    phi = shared_fit(few, {int(j): Y[:, :, j] for j in few.rows}, few.tau - few.nominal)[:10]
    body = np.einsum("nck,c->nk", Y, phi)
    after = float(np.sum(few.errors(few.nominal + body) ** 2))
    before = float(np.sum(few.asis**2))
    torque = body if len(few) == len(sketch) else None
    removed = 1 - after / max(before, 1e-12) if possible(few, Y, phi) else 0.0
    return Body(joint, float(phi[0]), phi[1:4] / (phi[0] or 1.0), removed, torque)


def possible(sketch: Sketch, columns: Array, body: Array) -> bool:
    """Whether a body on the last link is possible, with its parameters (10,) and their columns (M, 10, J).

    Its mass is no more than the robot's or, if it is missing, the link's; its centre is within reach, and the motion
    determines the mass.
    """
    masses, criteria, mass = sketch.robot.nominal[0::10], sketch.criteria, float(body[0])
    own = masses[sketch.robot.numbers[last_joint(sketch.robot)] - 1]
    if mass == 0.0 or not -criteria.missing_mass * own < mass < masses.sum():  # 0: undetermined beside friction
        return False
    near = bool(np.linalg.norm(body[1:4] / mass) < criteria.payload_reach)
    return near and determines_mass(columns[:, :, sketch.rows])


def determines_mass(columns: Array) -> bool:
    """Whether the mass of a body changes the torque in a way of its own; the columns are (M, 10, R), the mass first."""
    table = _table(columns)
    return bool(np.linalg.matrix_rank(table) > np.linalg.matrix_rank(table[:, 1:]))


def _table(columns: Array) -> Array:
    """Columns (M, 10, R) of all rows below one another, (M R, 10)."""
    return columns.transpose(0, 2, 1).reshape(-1, columns.shape[1])


def check_payload(sketch: Sketch, notes: Notebook) -> bool:
    """Report an additional or missing body on the last link; return whether there is one."""
    if len(sketch.rows) == 0 or sketch.asis.max() < notes.criteria.payload_nrmse:
        return False
    few, criteria = sketch.thinned(sketch.criteria.few_samples), notes.criteria
    body = payload_errors(sketch)
    # errors as small as those of URDFs may be errors of its links, unless the body explains all there is
    small = sketch.asis.max() < criteria.urdf_error
    if body.removed < (criteria.exact_share if small else criteria.explained_share) or not beats_links(
        few, payload_errors(few)
    ):
        return False
    what = f"explains {percent(body.removed)} of the squared error of the nominal URDF"
    at = ", ".join(f"{x:.2f}" for x in np.round(body.centre, 2) + 0.0)
    if body.mass > 0:
        notes.add(
            "payload",
            f"a body of about {body.mass:.2g} kg at ({at}) m in the joint's frame, which is not in the URDF, {what}",
            (body.joint,),
            "likely",
            CARRIED,
        )
    else:
        notes.add(
            "missing hand",
            f"about {-body.mass:.2g} kg that the URDF has on the last link at ({at}) m are missing on the robot: their "
            f"absence {what}",
            (body.joint,),
            "likely",
            LEFT_OFF,
        )
    return True


def beats_links(sketch: Sketch, body: Body) -> bool:
    """Whether a body, with its torque along the sketch, is a better explanation than errors of the URDF's links.

    Parameters
    ----------
    sketch : Sketch
        Of at most `CheckCriteria.few_samples` samples.
    """
    criteria, fits = sketch.criteria, RowFits(sketch)
    if body.torque is None:
        return False
    numbers = int(np.linalg.matrix_rank(_table(last_link(sketch)[:, :, sketch.rows])))
    freedom = np.maximum(fits.weight - FRICTION_NUMBERS, 0.0)
    left = float(freedom.sum()) - numbers
    if left <= 0:
        return False
    inside = np.maximum(sketch.errors(sketch.nominal + body.torque), LEAST_ERROR)
    with_body = inside * np.sqrt(1 + numbers / left)
    gain = -evidence(sketch, with_body, freedom, criteria.link_error) - float(np.sum(freedom * np.log(with_body)))
    return gain > cost(criteria, "payload", 1, numbers, float(fits.weight.mean()))


def evidence(sketch: Sketch, noise: Array, weight: Array, spread: float, cap: float = np.inf) -> float:
    """Log marginal likelihood of a sketch whose URDF has errors of its links: of their factors or of all parameters.

    Parameters
    ----------
    sketch : Sketch
        Of at most `CheckCriteria.few_samples` samples.
    noise : ndarray, shape (R,)
        NRMSE of the rows' own noise.
    weight : ndarray, shape (R,)
        Independent samples of the rows, or their degrees of freedom.
    spread : float
        Standard deviation s of the links' errors.
    cap : float
        Larger errors count as this one.
    """
    found = []
    for links in _link_errors(sketch):
        scales, volume = _scales(sketch, links, weight / noise**2, spread)
        behind = np.clip(sketch.errors(sketch.nominal + links @ scales), LEAST_ERROR, cap)
        found.append(-float(np.sum(weight * np.log(behind))) - float(scales @ scales) / (2 * spread**2) - volume)
    return max(found)


def _link_errors(sketch: Sketch) -> tuple[Array, Array]:
    """Torque of each link of the URDF, and of an error of each of their parameters as large as the link, (M, J, L)."""
    robot, masses = sketch.robot, sketch.robot.nominal[0::10]
    nominal = dict(zip(robot.all_names, robot.nominal, strict=True))
    values = np.array([nominal[c.name] for c in robot.columns])
    own = np.array([[c.joint == name for c in robot.columns] for name in robot.bodies], dtype=float)
    of_links = np.array([masses[robot.numbers[c.joint] - 1] for c in robot.columns])
    columns = sketch.motion.regressor().transpose(0, 2, 1)
    return columns @ (own * values).T, columns * (of_links * sizes_of_links(robot))


def _scales(sketch: Sketch, links: Array, weight: Array, spread: float) -> tuple[Array, float]:
    """The most likely errors ε (L,), and ½ ln det(s² H); the friction of each row is fitted."""
    L = links.shape[2]
    H, g = np.eye(L) / spread**2, np.zeros(L)
    for k, j in enumerate(sketch.rows):
        use = sketch.used[:, j]
        y = np.column_stack([links[use, j], sketch.tau[use, j] - sketch.nominal[use, j]]) / sketch.spread[k]
        Q, _ = np.linalg.qr(sketch.motion.friction(j)[use][:, :FRICTION_NUMBERS])
        y -= Q @ (Q.T @ y)
        H += weight[k] * y[:, :L].T @ y[:, :L] / len(y)
        g += weight[k] * y[:, :L].T @ y[:, L] / len(y)
    return np.asarray(np.linalg.solve(H, g)), 0.5 * float(np.linalg.slogdet(spread**2 * H)[1])
