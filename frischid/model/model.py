"""An identified model: robot, effects, parameters with their bounds, and the history of its steps.

    τ(q, q̇, q̈) = Y_base(q, q̇, q̈) θ_base + τ_known

A model is saved as one readable JSON file. The file holds the URDF's text, so a prediction needs no other file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from frischid.core.arguments import check_number
from frischid.core.files import write_text
from frischid.core.named_sequence import NamedSequence
from frischid.core.shown import Shown
from frischid.core.types import Array
from frischid.core.version import __version__
from frischid.effects import Effect, columns_of
from frischid.errors import InputError, UnknownNameError
from frischid.estimators.frisch import Box
from frischid.estimators.least_squares import Estimate
from frischid.estimators.urdf_prior import UrdfPrior
from frischid.logs.controller import PDController
from frischid.logs.current_gains import CurrentGains
from frischid.logs.driven import driven
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Motions
from frischid.logs.summary import Data
from frischid.model.fit_record import FitRecord, half_width
from frischid.model.log_requirements import check_logs_fit
from frischid.model.model_digest import check_digest, check_stored, text_of, without_hash
from frischid.model.model_file import SCHEMA, read_json, read_records, robot_of
from frischid.model.model_parts import (
    filter_dict,
    parts_of,
    plain_estimate,
    plain_numbers,
    plain_part,
    robot_dict,
    without_robot,
)
from frischid.model.parameters import Parameter, parameters_by_name
from frischid.model.remembered_blocks import blocks_of
from frischid.model.stored_paths import located
from frischid.regression.block import Block
from frischid.regression.regressor import Regressor
from frischid.robot.motion_arrays import motion_of, times_of
from frischid.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Model(Shown):
    """A robot's dynamics with identified parameters.

    Attributes
    ----------
    robot : Robot
    effects : tuple of Effect
    lowpass : LowPass
        Filter of the identification, and of every later comparison.
    velocity : {"auto", "measured", "derived"}
        Where velocities come from in logs.
    base : tuple of int
        Columns of the full regressor that carry the base parameters.
    expressions : tuple of str
        Each base parameter as a combination of parameters.
    estimate : Estimate
        Values, covariance, residual spread of each joint.
    bounds : dict of str to Box
        Bounds by method (``"frisch"``, ``"bbrf"``), where there are any.
    mean_torque : ndarray, shape (J,)
        Mean of each fitted joint's torque in the identification logs, the constant a model must beat.
    reference : dict of str to float, optional
        Parameter values that give the load for effects that depend on the load; None: the URDF's values.
    standard : dict of str to float, optional
        Physically consistent value of every parameter, known ones included; None before `frischid.make_consistent`.
    history : tuple of dict
        Steps of the model, oldest first, in plain JSON values.
    previous : Model, optional
        The model before the last step of its history.
    recursion : dict, optional
        History of BBRF's bounds: ``names``, ``units``, ``variant``, ``windows``, ``steps``, ``lower``, ``upper``
        (steps × p, null where open), ``emptied``; plain JSON values.
    prior : UrdfPrior, optional
        Prior of the fit; None: the logs alone.
    fitted : FitRecord, optional
        The reach of the fitted logs, and the URDF with fitted friction; None: not known.
    controller : PDController, optional
        Makes the torque of logs that hold commands and no torque; None: logs need torque.
    currents : CurrentGains, optional
        Makes the torque of joints whose logs hold currents and no torque.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> model.inverse_dynamics(log.q[:3], log.v[:3], log.a[:3]).shape
    (3, 2)
    """

    robot: Robot
    effects: tuple[Effect, ...]
    lowpass: LowPass
    velocity: str
    base: tuple[int, ...]
    expressions: tuple[str, ...]
    estimate: Estimate
    mean_torque: Array
    bounds: Mapping[str, Box] = field(default_factory=dict)
    reference: Mapping[str, float] | None = None
    standard: Mapping[str, float] | None = None
    history: tuple[Mapping[str, Any], ...] = ()
    previous: Model | None = None
    recursion: Mapping[str, Any] | None = None
    prior: UrdfPrior | None = None
    fitted: FitRecord | None = None
    controller: PDController | None = None
    currents: CurrentGains | None = None

    def __repr__(self) -> str:
        kinds = ", ".join(dict.fromkeys(e.id for e in self.effects))
        return f"Model({self.robot.name!r}: {len(self.base)} base parameters; {kinds or 'no effects'})"

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints whose torque the model was fitted to."""
        return self.estimate.joints

    @property
    def torque_index(self) -> list[int]:
        """Positions of `joints` among the robot's joints."""
        return [self.robot.joints.index(n) for n in self.joints]

    def inverse_dynamics(self, q: Array, v: Array, a: Array, t: Array | None = None) -> Array:
        """Torque the model predicts.

        Parameters
        ----------
        q, v, a : ndarray, shape (N, J)
            Positions (rad, m), velocities and accelerations of the robot's joints.
        t : ndarray, shape (N,), optional
            Time, s, for effects that depend on it; zero by default.

        Returns
        -------
        ndarray, shape (N, J)
            N·m (N); only the columns of `joints` were identified.

        Raises
        ------
        InputError
            The arrays do not have a column for each of the robot's joints, or differ in length; or the times go
            backwards, and an effect remembers the samples before.
        """
        Y, q, v, a = self._columns(q, v, a, t)
        known, torque = self.robot.known_torque(q, v, a), self.full_theta @ Y
        return np.asarray(torque if known is None else torque + known)

    def _columns(self, q: Array, v: Array, a: Array, t: Array | None) -> tuple[Array, Array, Array, Array]:
        """The regressor (N, C, J), and the motion as arrays of floats (N, J)."""
        q, v, a = motion_of(self.robot.joints, q=q, v=v, a=a)
        times = times_of(t, len(q), forward=any(effect.memory for effect in self.effects))
        return Regressor(self.robot, self.effects, self.reference)(times, q, v, a), q, v, a

    def predict(
        self, q: Array, v: Array, a: Array, t: Array | None = None, *, interval: float = 0.9
    ) -> tuple[Array, Array, Array]:
        """Torque of the fitted joints, with the interval in which a measurement is to be expected.

        The interval is for joints that move and for measurements behind the filter of the fit (`lowpass`): torques
        that are not low-passed have more noise. The half width is `frischid.model.fit_record.half_width`.

        Parameters
        ----------
        q, v, a, t
            As in `inverse_dynamics`.
        interval : float
            Share of measurements that the interval is to hold, between 0 and 1.

        Returns
        -------
        torque, lower, upper : ndarray, shape (N, J) each
            N·m (N), of the J joints in `joints`.

        Raises
        ------
        InputError
            The interval is not between 0 and 1.
        """
        check_number("interval", interval)
        if not 0 < interval < 1:
            raise InputError(f"the interval is a share of the measurements between 0 and 1, got {interval}")
        Y, q, v, a = self._columns(q, v, a, t)
        index = self.torque_index
        half = half_width(self.estimate, self.fitted, Y[:, list(self.base)][:, :, index], interval)
        torque = self.inverse_dynamics(q, v, a, t)[:, index]
        return torque, torque - half, torque + half

    def friction(self, q: Array, v: Array, a: Array | None = None, t: Array | None = None) -> Array:
        """Torque of the model's friction effects alone.

        Parameters
        ----------
        q, v, a : ndarray, shape (N, J)
            Positions (rad, m), velocities, and accelerations (for friction that grows with the load; zero by default).
        t : ndarray, shape (N,), optional
            Time, s, for friction that remembers; zero by default.

        Returns
        -------
        ndarray, shape (N, J)
            N·m (N), with the sign it has in the equation of motion: along v.
        """
        Y = self._columns(q, v, np.zeros_like(q) if a is None else a, t)[0]
        ids = {e.id for e in self.effects if e.friction}
        felt = np.array([c.effect in ids for c in columns_of(self.robot, self.effects)])
        return np.asarray(self.full_theta[felt] @ Y[:, felt])

    def pinocchio(self) -> Any:
        """Build a Pinocchio model with the identified inertias and armature (rotor inertias).

        Raises
        ------
        InputError
            The model has base parameters only; `frischid.make_consistent` finds links that have them.
        """
        return self.robot.pinocchio(self.links, self.of_effect("rotor_inertia", "Ia"))

    def of_effect(self, effect: str, symbol: str) -> dict[str, float]:
        """Physical values of one parameter of an effect, by joint; empty if the model has none such."""
        columns, number = columns_of(self.robot, self.effects), self.robot.numbers
        found = (c for c in columns if c.effect == effect and c.name == f"{symbol}{number[c.joint]}")
        return {c.joint: self.parameter(c.name) for c in found}

    @property
    def links(self) -> Array:
        """Physical inertial parameters of all bodies in the order of ``robot.all_names``, shape (L, 10)."""
        return np.array([self.parameter(n) for n in self.robot.all_names]).reshape(-1, 10)

    def parameter(self, name: str) -> float:
        """Physical value of one parameter.

        Raises
        ------
        InputError
            The model has base parameters only.
        UnknownNameError
            No parameter has this name.
        """
        if self.standard is None:
            raise InputError(
                "this model has base parameters only, which model.to_frame() lists; find links with `frischid "
                "consistent` (frischid.make_consistent)"
            )
        if name not in self.standard:
            raise UnknownNameError("parameter", name, self.standard)
        return self.standard[name]

    def check(self, logs: Sequence[Data]) -> None:
        """Refuse logs (InputError) that lack a joint of the robot, or torque of one the model was fitted to."""
        check_logs_fit(self.robot, self.joints, driven(logs, self.controller, self.currents))

    def motions(self, logs: Sequence[Data], told: Callable[[int], None] = lambda _: None) -> Motions:
        """Logs prepared as the model's own were."""
        data, joints = driven(logs, self.controller, self.currents), self.robot.joints
        return Motions(data, joints, self.lowpass, self.velocity, told)

    def blocks(self, logs: Sequence[Data]) -> Iterator[tuple[Block, Array]]:
        """Filtered samples of logs with the torque the model predicts for them, shape (M, J)."""
        return self.evaluate(self.motions(logs))

    def evaluate(self, motions: Iterable[Motion]) -> Iterator[tuple[Block, Array]]:
        """As `blocks`, for logs that `motions` has prepared already."""
        regressor = Regressor(self.robot, self.effects, self.reference)
        for motion in motions:
            for block in blocks_of(regressor, motion, self.lowpass):
                yield block, self.full_theta @ block.Y

    def made_from(self, log: Data) -> bool:
        """Whether the parameters were fitted to this log, known by its hash, or by its name if it has none."""
        fitted = {x["sha256"] or x["source"] for event in self.history for x in event.get("logs", ())}
        return (log.identity or log.source) in fitted

    @property
    def parameters(self) -> NamedSequence[Parameter]:
        """Base parameters by position and by name: ``model.parameters[0]``, ``model.parameters["fv1"]``."""
        return parameters_by_name(self.estimate, self.expressions)

    @property
    def fitted_logs(self) -> tuple[Mapping[str, Any], ...]:
        """Entries of the logs the parameters were last fitted to, in order: ``source``, ``sha256``, ``samples``."""
        return next((tuple(e["logs"]) for e in reversed(self.history) if e.get("logs")), ())

    @cached_property
    def full_theta(self) -> Array:
        """Value of every column of the full regressor: its physical one, or zero without a base parameter."""
        columns = columns_of(self.robot, self.effects)
        if self.standard is not None:
            return np.array([self.standard[c.name] for c in columns])
        theta = np.zeros(len(columns))
        theta[list(self.base)] = self.estimate.theta
        return theta

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain JSON values."""
        return {
            "schema": SCHEMA,
            "frischid": __version__,
            "robot": robot_dict(self.robot),
            "effects": [effect.to_dict() for effect in self.effects],
            "filter": filter_dict(self.lowpass, self.velocity),
            **plain_estimate(self.estimate, self.base, self.expressions, self.bounds, self.mean_torque),
            "reference": plain_numbers(self.reference),
            "standard": plain_numbers(self.standard),
            "history": [dict(h) for h in self.history],
            "previous": None if self.previous is None else without_robot(self.previous.to_dict()),
            "recursion": None if self.recursion is None else dict(self.recursion),
            **{part: plain_part(getattr(self, part)) for part in ("prior", "fitted", "controller", "currents")},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "model") -> Model:
        """Inverse of `to_dict`.

        Raises
        ------
        InputError
            Not a frischid model, of a schema this version does not read, or a field is wrong.
        """
        records = read_records(data, source)
        robot = robot_of(records[0], source)
        model = cls(robot=robot, **parts_of(records[-1], robot, source))
        for record in reversed(records[:-1]):  # every step is of the same robot
            model = cls(robot=robot, previous=model, **parts_of(record, robot, source))
        check_digest(data, source)
        return model

    def save(self, path: str | Path) -> None:
        """Write one JSON file; it appears under its name only when complete. Paths of logs are relative to it."""
        write_text(Path(path), text_of(self.to_dict(), Path(path).parent))

    @classmethod
    def load(cls, path: str | Path) -> Model:
        """Read a model file. A file without the hash of its content is read with a warning.

        Raises
        ------
        InputError
            The file is missing, not JSON, or not a model.
        """
        found = without_hash(located(written := read_json(path), Path(path).parent, str(path)))
        model = cls.from_dict(found, str(path))
        check_stored(written, str(path))  # of the content before the paths were found
        return model
