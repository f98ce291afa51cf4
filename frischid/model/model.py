"""An identified model: robot, effects, parameters with their bounds, and how they came about.

    τ(q, q̇, q̈) = Y_base(q, q̇, q̈) θ_base + τ_known

A model is one readable JSON file. It holds the URDF's text, so nothing else is needed to predict with it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from frischid.core.files import write_text
from frischid.core.types import Array, Column
from frischid.effects import Effect, columns_of, effect_from_dict
from frischid.errors import InputError
from frischid.estimators.frisch import Box
from frischid.estimators.least_squares import Estimate
from frischid.estimators.urdf_prior import UrdfPrior
from frischid.logs.filters import LowPass
from frischid.logs.log import Log, check_torque
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Motions, Recording, preview_of
from frischid.regression.block import Block
from frischid.regression.regressor import Regressor
from frischid.robot.robot import Robot

SCHEMA = "frischid.model/1"


@dataclass(frozen=True, eq=False)
class Model:
    """What identification gives.

    Attributes
    ----------
    robot : Robot
    effects : tuple of Effect
    lowpass : LowPass
        Filter the parameters were found with, and with which the model is compared.
    velocity : {"auto", "measured", "derived"}
        Where velocities come from in logs.
    base : tuple of int
        Columns of the full regressor that carry the base parameters.
    expressions : tuple of str
        Each base parameter as the combination of parameters it stands for.
    estimate : Estimate
        Values, covariance, residual spread of each joint.
    bounds : dict of str to Box
        Bounds by method (``"frisch"``, ``"bbrf"``), where there are any.
    mean_torque : ndarray, shape (J,)
        Mean of each fitted joint's torque in the identification logs, the constant a model must beat.
    reference : dict of str to float, optional
        Parameter values from which effects that depend on the load take it; None: the URDF's own.
    standard : dict of str to float, optional
        Physically consistent value of every parameter, known ones included, that has these base parameters; None until
        `frischid.export.consistency.make_consistent` found them.
    history : tuple of dict
        What was done, oldest first, in plain JSON values.
    previous : Model, optional
        The model before the last step of its history.
    recursion : dict, optional
        How BBRF's bounds closed in: ``names``, ``units``, ``variant``, ``windows``, ``steps``, ``lower``, ``upper``
        (steps × p, null where open), ``emptied``; plain JSON values.
    prior : UrdfPrior, optional
        The prior the parameters were fitted with; None: the logs alone.
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
        """
        q, v, a = (np.atleast_2d(np.asarray(x, dtype=float)) for x in (q, v, a))
        Y = Regressor(self.robot, self.effects, self.reference)(np.zeros(len(q)) if t is None else t, q, v, a)
        known = self.robot.known_torque(q, v, a)
        torque = self.full_theta @ Y
        return np.asarray(torque if known is None else torque + known)

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
        q, v = (np.atleast_2d(np.asarray(x, dtype=float)) for x in (q, v))
        a = np.zeros_like(q) if a is None else np.atleast_2d(np.asarray(a, dtype=float))
        Y = Regressor(self.robot, self.effects, self.reference)(np.zeros(len(q)) if t is None else t, q, v, a)
        columns = columns_of(self.robot, self.effects)
        ids = {e.id for e in self.effects if e.friction}
        felt = np.array([c.effect in ids for c in columns])
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
        columns = [c for c in columns_of(self.robot, self.effects) if c.effect == effect]
        number = self.robot.numbers
        return {c.joint: self.parameter(c.name) for c in columns if c.name == f"{symbol}{number[c.joint]}"}

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
        """
        if self.standard is None:
            raise InputError(
                "this model has base parameters only, from which no single link follows; find physical links with "
                "`frischid consistent` (frischid.make_consistent) first"
            )
        return self.standard[name]

    def check(self, logs: Sequence[Log | Recording]) -> None:
        """Refuse logs that lack a joint of the robot, or torque of one the model was fitted to.

        Raises
        ------
        InputError
        """
        for log in logs:
            head = preview_of(log)
            absent = [n for n in self.robot.joints if n not in head.joints]
            if absent:
                raise InputError(
                    f"{log.source}: no position (q_<joint>) of {', '.join(absent)}, and the model needs every joint's; "
                    f"the log has {', '.join(head.joints)}"
                )
            if isinstance(log, Log):
                check_torque(head, self.joints)
            there = head.select(self.joints).has("tau")
            missing = [n for n, known in zip(self.joints, there, strict=True) if not known]
            if missing:
                raise InputError(
                    f"{log.source}: no torque (tau_<joint>) of {', '.join(missing)}, which the model was fitted to; "
                    "leave the log out, or identify again with --torque-joints that it has"
                )

    def motions(self, logs: Sequence[Log | Recording]) -> Motions:
        """Logs prepared as the model's own were."""
        return Motions(logs, self.robot.joints, self.lowpass, self.velocity)

    def blocks(self, logs: Sequence[Log | Recording]) -> Iterator[tuple[Block, Array]]:
        """Filtered samples of logs with the torque the model predicts for them, shape (M, J)."""
        return self.evaluate(self.motions(logs))

    def evaluate(self, motions: Iterable[Motion]) -> Iterator[tuple[Block, Array]]:
        """The same of motions that are prepared already."""
        regressor = Regressor(self.robot, self.effects, self.reference)
        for motion in motions:
            for block in regressor.blocks(motion, self.lowpass):
                yield block, self.full_theta @ block.Y

    def made_from(self, log: Log | Recording) -> bool:
        """Whether the parameters were fitted to this log, known by its hash, or by its name if it has none."""
        fitted = {x["sha256"] or x["source"] for event in self.history for x in event.get("logs", ())}
        return (log.identity or log.source) in fitted

    @property
    def fitted_to(self) -> int:
        """How many logs the parameters were last fitted to."""
        return next((len(event["logs"]) for event in reversed(self.history) if event.get("logs")), 0)

    @cached_property
    def full_theta(self) -> Array:
        """Value of every column of the full regressor: the physical one, or zero where it is no base parameter."""
        columns = columns_of(self.robot, self.effects)
        if self.standard is not None:
            return np.array([self.standard[c.name] for c in columns])
        theta = np.zeros(len(columns))
        theta[list(self.base)] = self.estimate.theta
        return theta

    # ------------------------------------------------------------------ files

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain JSON values."""
        e = self.estimate
        return {
            "schema": SCHEMA,
            "frischid": metadata.version("frischid"),
            "robot": self.robot.to_dict(),
            "effects": [effect.to_dict() for effect in self.effects],
            "filter": {"cutoff_hz": self.lowpass.cutoff, "reason": self.lowpass.reason, "velocity": self.velocity},
            "estimator": e.estimator,
            "parameters": [self._parameter(i) for i in range(len(self.base))],
            "joints": [
                {"name": n, "sigma": float(s), "weight": float(w), "mean_torque": float(m)}
                for n, s, w, m in zip(e.joints, e.sigma, e.weights, self.mean_torque, strict=True)
            ],
            "condition": e.condition,
            "notes": list(e.notes),
            "reference": None if self.reference is None else dict(self.reference),
            "standard": None if self.standard is None else dict(self.standard),
            "history": [dict(h) for h in self.history],
            "covariance": e.covariance.tolist(),
            "information": e.information.tolist(),
            "previous": None if self.previous is None else _without_robot(self.previous.to_dict()),
            "recursion": None if self.recursion is None else dict(self.recursion),
        }

    def _parameter(self, i: int) -> dict[str, Any]:
        column = self.estimate.columns[i]
        return {
            "name": column.name,
            "expression": self.expressions[i],
            "unit": column.unit,
            "joint": column.joint,
            "effect": column.effect,
            "sign": column.sign,
            "column": self.base[i],
            "value": float(self.estimate.theta[i]),
            "stderr": float(self.estimate.stderr[i]),
            "from_data": None if self.estimate.from_data is None else float(self.estimate.from_data[i]),
            "bounds": {k: [_finite(box.lower[i]), _finite(box.upper[i])] for k, box in self.bounds.items()},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "model") -> Model:
        """Inverse of `to_dict`.

        Raises
        ------
        InputError
            Not a frischid model, or of a schema this version does not read.
        """
        schema = data.get("schema") if isinstance(data, Mapping) else None
        if schema != SCHEMA:
            raise InputError(
                f"{source}: expected a frischid model of schema {SCHEMA}, found {schema!r}; write one with "
                "`frischid identify "
                "ROBOT LOG -o model.json`, or read it with the version of frischid that wrote it"
            )
        try:
            return cls._read(data)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{source}: the model file is damaged: {type(error).__name__} {error}") from error

    @classmethod
    def _read(cls, data: Mapping[str, Any]) -> Model:
        parameters, joints, filtering = data["parameters"], data["joints"], data["filter"]
        columns = tuple(Column(p["name"], p["unit"], p["joint"], p["effect"], p["sign"]) for p in parameters)
        names = tuple(c.name for c in columns)
        estimate = Estimate(
            columns,
            np.array([p["value"] for p in parameters]),
            np.array(data["covariance"], dtype=float).reshape(len(columns), len(columns)),
            tuple(j["name"] for j in joints),
            np.array([j["sigma"] for j in joints]),
            np.array([j["weight"] for j in joints]),
            data["condition"],
            data["estimator"],
            np.array(data["information"]),
            tuple(data["notes"]),
            np.array(shares) if None not in (shares := [p.get("from_data") for p in parameters]) else None,
        )
        methods = parameters[0]["bounds"] if parameters else {}
        bounds = {
            k: Box(
                names,
                np.array([_number(p["bounds"][k][0], -np.inf) for p in parameters]),
                np.array([_number(p["bounds"][k][1], np.inf) for p in parameters]),
            )
            for k in methods
        }
        return cls(
            Robot.from_dict(data["robot"]),
            tuple(effect_from_dict(e) for e in data["effects"]),
            LowPass(filtering["cutoff_hz"], filtering["reason"]),
            filtering["velocity"],
            tuple(p["column"] for p in parameters),
            tuple(p["expression"] for p in parameters),
            estimate,
            np.array([j["mean_torque"] for j in joints]),
            bounds,
            data["reference"],
            data.get("standard"),  # older files have none
            tuple(data["history"]),
            None if data["previous"] is None else cls.from_dict({**data["previous"], "robot": data["robot"]}),
            data.get("recursion"),
        )

    def save(self, path: str | Path) -> None:
        """Write one JSON file; it appears under its name only when complete."""
        write_text(Path(path), json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: str | Path) -> Model:
        """Read a model file.

        Raises
        ------
        InputError
            The file is missing, not JSON, or not a model.
        """
        try:
            return cls.from_dict(json.loads(Path(path).read_text(encoding="utf-8")), str(path))
        except OSError as error:
            raise InputError(f"{path}: the model file cannot be read ({error.strerror})") from None
        except (json.JSONDecodeError, UnicodeDecodeError) as error:
            raise InputError(
                f"{path}: not a JSON model file ({error}); the command `frischid identify` writes one"
            ) from None


def _without_robot(data: dict[str, Any]) -> dict[str, Any]:
    """Every step is of the same robot: its URDF is kept once."""
    return {k: v for k, v in data.items() if k != "robot"}


def _finite(x: float) -> float | None:
    return float(x) if np.isfinite(x) else None


def _number(x: float | None, absent: float) -> float:
    return absent if x is None else x
