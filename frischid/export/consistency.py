"""A model whose links could exist: physical standard parameters that keep the model's base parameters.

`frischid.estimators.physical_links` does the mathematics. This module prepares its input: the URDF is the prior, and
the boxes for centres of mass come from the URDF's own shapes or from the user. The result is a model with
`Model.standard`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from frischid.core.text import shortened
from frischid.core.types import Array
from frischid.effects import columns_of
from frischid.errors import InputError, UnknownNameError
from frischid.estimators.nominal_links import Links
from frischid.estimators.physical_links import Active, Consistent, Extras, consistent
from frischid.model.headline import alarms_of_fit
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.physical_alarms import of_physical
from frischid.motions.collision import body_boxes
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor, nominal_parameters
from frischid.regression.structure import structure
from frischid.robot.robot import LINK_PARAMETERS, Robot
from frischid.robot.scale import RobotScale

Box = tuple[Sequence[float], Sequence[float]]

_IN_ROW_SPACE = 1e-9  # squared distance of a unit vector from the row space up to which it lies in it
_CONTRADICTED = 2.0  # standard errors: a coefficient that has the wrong sign by more than this stays as identified


@dataclass(frozen=True, eq=False)
class Consistency:
    """A model with physical links, and the changes that this needed.

    Attributes
    ----------
    model : Model
        The model with `Model.standard`; its base parameters are those of the physical links.
    result : Consistent
    change : ndarray, shape (p,)
        Change of each base parameter, in its standard errors.
    boxes : dict of str to (lower, upper)
        Boxes used for the centres of mass, by joint, in the joint's frame, m.
    notes : tuple of str

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> found = fr.make_consistent(model)
    >>> found.unexplained < 1.0
    True
    """

    model: Model
    result: Consistent
    change: Array
    boxes: Mapping[str, tuple[Array, Array]]
    notes: tuple[str, ...]

    @property
    def active(self) -> tuple[Active, ...]:
        """Constraints that decide the result."""
        return self.result.active

    @property
    def unexplained(self) -> float:
        """Rms change of the base parameters that the constraints force, in standard errors."""
        return float(np.sqrt(self.result.misfit / len(self.change)))


def make_consistent(model: Model, *, boxes: Mapping[str, Box] | None = None, shapes: bool = True) -> Consistency:
    """Find physical links that have a model's base parameters.

    Parameters
    ----------
    model : Model
    boxes : mapping of str to (lower, upper), optional
        Joint -> corners of a box, in the joint's frame (m), in which the centre of mass of the joint's body must lie.
    shapes : bool
        Whether bodies without a given box get the box of the URDF's shapes (collision, else visual), where known.

    Returns
    -------
    Consistency

    Raises
    ------
    InputError
        The model has columns of a change (a payload added to a model), or a box is malformed.
    InfeasibleError
        Some link cannot exist; the message says which and why.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> found = fr.make_consistent(model, boxes={"joint2": ((-1, -1, -1), (1, 1, 1))})
    >>> found.result.feasible, sorted(found.model.standard)[:3]
    (True, ['Ia1', 'Ia2', 'Ixx1'])
    """
    check_model(model)
    robot, regressor = model.robot, Regressor(model.robot, model.effects, model.reference)
    mapping = _structure(model, regressor)
    chosen, notes = _boxes(robot, boxes or {}, shapes)
    links = Links(
        tuple(f"the body behind {n}" for n in robot.bodies),
        robot.nominal.reshape(-1, 10),
        tuple(_half_spaces(robot, n, chosen.get(n)) for n in robot.bodies),
        np.array([robot.known.get(n, np.nan) for n in robot.all_names]).reshape(-1, 10),
        RobotScale.of(robot).length,
    )
    estimate = model.estimate
    extras, contradictions = _extras(model, regressor, mapping)
    result = _as_the_urdf(consistent(estimate.theta, estimate.information, mapping, links, extras), mapping, extras)
    said = (*notes, *result.notes, *contradictions, *unmeasured_friction(model))
    names = (*robot.all_names, *extras.names)
    change = (result.base - estimate.theta) / np.maximum(estimate.stderr, 1e-300)
    physical = replace(
        model,
        estimate=replace(estimate, theta=result.base),
        standard=dict(zip(names, map(float, result.theta), strict=True)),
        previous=model,
    )
    event: dict[str, Any] = {
        "action": "consistent",
        "effects": [str(e) for e in model.effects],
        "logs": [],
        "misfit": result.misfit,
        "largest_change_in_standard_errors": float(np.abs(change).max()),
        "active": [list(a) for a in result.active],
        "notes": list(said),
        "alarms": [alarm.to_dict() for alarm in of_physical(alarms_of_fit(model.history), physical)],
    }
    return Consistency(replace(physical, history=(*model.history, event)), result, change, chosen, said)


def _as_the_urdf(result: Consistent, mapping: Array, extras: Extras) -> Consistent:
    """The result with the URDF's values of effects that act on no measured torque: no limit moves those."""
    links = len(result.theta) - len(extras.names)
    unseen = ~mapping[:, links:].any(axis=0)
    names = set(np.compress(unseen, extras.names))
    theta = np.concatenate([result.theta[:links], np.where(unseen, extras.nominal, result.theta[links:])])
    return replace(result, theta=theta, active=tuple(a for a in result.active if a.where not in names))


def unmeasured_friction(model: Model) -> list[str]:
    """Joints whose friction no log shows, because their torque was not measured: a file keeps the URDF's value."""
    robot, kinds = model.robot, {e.id for e in model.effects if e.friction}
    rubbing = {c.joint for c in columns_of(robot, model.effects) if c.effect in kinds}
    return [
        f"{joint}: friction was not measured, the URDF's value is kept"
        for joint in robot.joints
        if joint in rubbing and joint not in model.joints
    ]


def as_identified(model: Model) -> Model:
    """Give a model standard parameters with exactly its base parameters, physical or not.

    They are the URDF's parameters with the smallest possible change, each measured in its typical size in a link.
    """
    robot, regressor = model.robot, Regressor(model.robot, model.effects, model.reference)
    mapping = _structure(model, regressor)
    nominal = robot.nominal.reshape(-1, 10)
    mass = np.where(nominal[:, 0] > 0, nominal[:, 0], 1.0)[:, None]
    sizes = mass * np.array([1.0, *[0.1] * 3, *[0.01] * 6])
    extras = _extras(model, regressor, mapping)[0]
    scale = np.concatenate([sizes.ravel(), extras.scale])
    start = np.concatenate([[robot.known.get(n, x) for n, x in zip(robot.all_names, robot.nominal, strict=True)],
                            extras.nominal])  # fmt: skip
    change = np.linalg.pinv(mapping * scale) @ (model.estimate.theta - mapping @ start)
    names = (*robot.all_names, *extras.names)
    return replace(model, standard=dict(zip(names, map(float, start + scale * change), strict=True)))


def free_parameters(model: Model) -> dict[str, tuple[str, ...]]:
    """Rigid parameters that are a free choice: the torque depends on them only in sums with other parameters.

    A parameter k is determined if e_k lies in the row space of K in ``θ_base = K θ``. Of the free ones, a physical
    model has the values nearest to the URDF's links.

    Returns
    -------
    dict of str to tuple of str
        Of each body in ``robot.bodies``, named by the joint before it: ``"m"``, ``"mx"``, ..., ``"Izz"`` where free;
        without known parameters.
    """
    robot = model.robot
    mapping = _structure(model, Regressor(robot, model.effects, model.reference))
    rows = np.linalg.svd(mapping, full_matrices=False)[2]
    determined = (rows**2).sum(axis=0) > 1.0 - _IN_ROW_SPACE
    free = [not known and name not in robot.known for name, known in zip(robot.all_names, determined, strict=False)]
    return {
        body: tuple(symbol for symbol, there in zip(LINK_PARAMETERS, free[10 * i : 10 * i + 10], strict=True) if there)
        for i, body in enumerate(robot.bodies)
    }


def free_masses(model: Model) -> tuple[str, ...]:
    """Bodies whose mass is a free choice, named by the joints before them, in the order of ``robot.bodies``."""
    return tuple(body for body, names in free_parameters(model).items() if "m" in names)


def describes_change(model: Model) -> bool:
    """Whether a model has columns of a change beside all of the robot's own parameters, which leave its links open."""
    regressor = Regressor(model.robot, model.effects, model.reference)
    return structure(regressor, model.joints).base != model.base


def _structure(model: Model, regressor: Regressor) -> Array:
    """K in ``θ_base = K θ`` over all rigid parameters (known ones: zero) and the effects'."""
    robot = model.robot
    reduction = structure(regressor, model.joints)
    if reduction.base != model.base:
        raise InputError(
            "this model describes a change of the robot (such as a payload) beside the robot's own parameters, so its "
            "links are undetermined; take the change back (frischid history --undo) or identify the robot again"
        )
    return link_mapping(robot, regressor, reduction)


def link_mapping(robot: Robot, regressor: Regressor, reduction: Reduction) -> Array:
    """K over all rigid parameters in the order of ``robot.all_names`` (known ones: zero), then the effects'."""
    rigid = len(robot.columns)
    mapping = np.zeros((reduction.rank, len(robot.all_names) + len(regressor.columns) - rigid))
    mapping[:, [robot.all_names.index(c.name) for c in robot.columns]] = reduction.mapping[:, :rigid]
    mapping[:, len(robot.all_names) :] = reduction.mapping[:, rigid:]
    return mapping


def _extras(model: Model, regressor: Regressor, mapping: Array) -> tuple[Extras, list[str]]:
    """The effects' parameters, each with the size of its base parameter.

    Known signs are a prior, not a law. Where the logs contradict a sign clearly (a "rotor inertia" that absorbs a
    delay), the coefficient stays as identified, with a note.
    """
    columns, estimate = regressor.columns[len(model.robot.columns) :], model.estimate
    K = np.abs(mapping[:, mapping.shape[1] - len(columns) :])
    size = np.abs(estimate.theta) + estimate.stderr
    scale = np.where(K > 0, size[:, None] / np.where(K > 0, K, 1.0), 0.0).max(axis=0, initial=0.0)
    nominal = nominal_parameters(model.robot, model.effects)[len(model.robot.columns) :]
    values = {c.name: (x, s) for c, x, s in zip(estimate.columns, estimate.theta, estimate.stderr, strict=True)}
    signs, notes = [], []
    for column in columns:
        x, s = values.get(column.name, (0.0, 1.0))
        contradicted = column.sign * x < -_CONTRADICTED * s
        signs.append(0 if contradicted else column.sign)
        if contradicted:
            notes.append(
                f"{column.name} = {x:.3g} ± {s:.2g} {column.unit} has an impossible sign, by more than its error. "
                "Another cause than its name says must be behind this value, and the value stays as identified"
            )
    usable = np.where(scale > 0, scale, 1.0)
    return Extras(tuple(c.name for c in columns), nominal, usable, np.array(signs, dtype=int)), notes


def _boxes(
    robot: Robot, given: Mapping[str, Box], shapes: bool
) -> tuple[dict[str, tuple[Array, Array]], tuple[str, ...]]:
    """Boxes by joint: the user's, otherwise those of the URDF's shapes unless the URDF contradicts itself."""
    notes: list[str] = []
    chosen = {}
    if shapes:
        masses = robot.nominal.reshape(-1, 10)[:, 0]
        for name, box in body_boxes(robot).items():
            i = robot.bodies.index(name)
            centre = robot.model.inertias[i + 1].lever
            if masses[i] > 0 and ((centre < box[0]) | (centre > box[1])).any():
                notes.append(
                    f"the body behind {name}: the URDF puts its centre of mass outside its own shapes, so their "
                    "box is not used"
                )
            else:
                chosen[name] = box
    for name, corners in given.items():
        if name not in robot.bodies:
            raise UnknownNameError("joint", name, robot.bodies, robot.source)
        if not isinstance(corners, Sequence | np.ndarray) or len(corners) != 2:
            raise InputError(f"the box of {name} must be two corners of three numbers in m, got {shortened(corners)}")
        low, high = (np.asarray(corner, dtype=float) for corner in corners)
        if low.shape != (3,) or high.shape != (3,) or not (low < high).all():
            raise InputError(f"the box of {name} must be two corners of three numbers in m, the first below the second")
        chosen[name] = (low, high)
    return chosen, tuple(notes)


def _half_spaces(robot: Robot, joint: str, box: tuple[Array, Array] | None) -> tuple[Array, Array] | None:
    """Half-spaces ``A c ≤ b`` of a box in the joint's frame, for a centre of mass c in the parameters' own frame."""
    if box is None:
        return None
    A, b = np.vstack([np.eye(3), -np.eye(3)]), np.concatenate([box[1], -box[0]])
    placement = robot.frame_placement(joint)
    return A @ placement.rotation, b - A @ placement.translation
