"""The least-squares problem of drive gains: its columns, and its solution with physical links.

    columns [Y_j, L_j, w, i_j]:  base parameters, unknown parameters of the payload, torque of its weight, current

`frischid.export.drive_gains` has the mathematics and the sources.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from frischid.core.arguments import check_number
from frischid.core.types import Array
from frischid.effects import Effect, Payload
from frischid.effects.dynamics import random_states
from frischid.errors import IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators.least_squares import wls
from frischid.estimators.nominal_links import Links
from frischid.estimators.physical_links import Extras, consistent
from frischid.export.consistency import link_mapping
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.preprocessing import prepare
from frischid.regression.accumulation import accumulate
from frischid.regression.base_parameters import Reduction, reduce
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import LINK_PARAMETERS, Robot
from frischid.robot.scale import RobotScale
from frischid.robot.urdf_numbers import LARGEST_QUANTITY

_PAYLOAD_SIZE = 0.05  # m: radius of gyration of the payload in the prior, about the width of a hand


@dataclass(frozen=True)
class KnownPayload:
    """A payload of known weight.

    Attributes
    ----------
    mass : float
        kg.
    centre : sequence of 3 float, optional
        Centre of mass in the carrier's joint frame, m, where it is known.
    carrier : str, optional
        Joint behind which the payload hangs; the last by default.

    Raises
    ------
    InputError
        The mass is no positive number, or the centre is not three finite numbers.

    Examples
    --------
    >>> import frischid as fr
    >>> fr.KnownPayload(2.805, carrier="wrist_3_joint")
    KnownPayload(mass=2.805, centre=None, carrier='wrist_3_joint')
    """

    mass: float
    centre: Sequence[float] | None = None
    carrier: str | None = None

    def __post_init__(self) -> None:
        check_number("the payload's mass", self.mass)
        if not 0 < self.mass <= LARGEST_QUANTITY:
            raise InputError(f"the payload's mass must be a positive number of kg, got {self.mass}")
        centre = self.centre
        if centre is not None and not (np.shape(centre) == (3,) and (np.abs(centre) <= LARGEST_QUANTITY).all()):
            raise InputError(f"the payload's centre of mass must be three finite numbers in m, got {list(centre)}")


@dataclass(frozen=True, eq=False)
class Carried:
    """An identified payload: kg and m, in the frame of the joint that carries it."""

    mass: float
    mass_stderr: float
    centre: Array


class GainProblem:
    """Columns [base parameters, unknown payload parameters, known weight, current], and the three solutions."""

    def __init__(self, robot: Robot, effects: Sequence[Effect], payload: KnownPayload) -> None:
        carrier = payload.carrier or robot.joints[-1]
        if carrier not in robot.joints:
            raise UnknownNameError("joint", carrier, robot.joints)
        self.robot, self.effects, self.carrier = robot, tuple(effects), carrier
        self.bare = Regressor(robot, effects)
        self.reduction = structure(self.bare, robot.joints)
        self.regressor = Regressor(robot, (*effects, Payload(joints=(carrier,), full=True)))
        self.known = np.full(10, np.nan)
        self.known[0] = payload.mass
        if payload.centre is not None:
            self.known[1:4] = payload.mass * np.asarray(payload.centre, dtype=float)
        fresh = self.regressor.columns[len(self.bare.columns) :]
        number = robot.numbers[carrier]
        self.felt = [LINK_PARAMETERS.index(c.name[1:].removesuffix(str(number))) for c in fresh]
        if 0 not in self.felt:
            raise IdentifiabilityError(
                f"a payload behind {carrier} changes no joint's torque, so it does not determine the gains; mount it "
                "on a later link"
            )
        self.payload_columns = np.arange(len(self.bare.columns), len(self.regressor.columns))
        self.unknown = [k for k, p in enumerate(self.felt) if np.isnan(self.known[p])]
        self.payload_reduction = self._reduced(self.unknown)
        self.p, self.k = self.reduction.rank, 0 if self.payload_reduction is None else self.payload_reduction.rank

    def _reduced(self, which: Sequence[int]) -> Reduction | None:
        """Linearly independent columns among some of the payload's."""
        if not which:
            return None
        q, v, a = random_states(self.robot, 40)
        carried = Regressor(self.robot, self.regressor.effects[-1:])
        Y = carried(0.5 * np.arange(40.0), q, v, 3.0 * a)[:, len(self.robot.columns) + np.array(which)]
        columns = [self.regressor.columns[i] for i in self.payload_columns[list(which)]]
        return reduce(Y.transpose(0, 2, 1).reshape(-1, len(which)), columns)

    def blocks(self, logs: Sequence[Log], lowpass: LowPass, *, loaded: bool) -> list[Gram]:
        """Moments of logs; without the payload, its columns are zero."""
        motions = [m for log in logs for m in prepare(log, lowpass).motions]
        keep = [*self.reduction.base, *self.payload_columns]
        grams = [g.select(keep) for g in accumulate(self.regressor, motions, lowpass, self.robot.joints)]
        if not loaded:
            for g in grams:
                absent = slice(self.p, self.p + len(self.payload_columns))
                g.moments[:, absent], g.moments[:, :, absent], g.sums[:, absent] = 0.0, 0.0, 0.0
        return grams

    def arranged(self, gram: Gram) -> Array:
        """Moments (J, n + 2, n + 2) of [base, unknown payload, weight, current]."""
        base = [] if self.payload_reduction is None else [self.unknown[i] for i in self.payload_reduction.base]
        T = np.zeros((gram.moments.shape[1], self.p + self.k + 2))
        T[np.arange(self.p), np.arange(self.p)] = 1.0
        for column, i in enumerate(base):
            T[self.p + i, self.p + column] = 1.0
        for i, p in enumerate(self.felt):
            if not np.isnan(self.known[p]):
                T[self.p + i, -2] = self.known[p]
        T[-1, -1] = 1.0
        return np.asarray(T.T @ gram.moments @ T)

    @property
    def names(self) -> list[str]:
        """Names of the unknowns: base parameters, the payload's, gains."""
        payload = [] if self.payload_reduction is None else [c.name for c in self.payload_reduction.base_columns()]
        return [
            *(c.name for c in self.reduction.base_columns()),
            *payload,
            *(f"the gain of {n}" for n in self.robot.joints),
        ]

    def constrained(self, x: Array, information: Array) -> tuple[Array, list[str]]:
        """Gains nearest to the unconstrained ones with physical links, a physical payload and g > 0; and remarks."""
        robot, J = self.robot, len(self.robot.joints)
        own = link_mapping(robot, self.bare, self.reduction)
        L, E = 10 * len(robot.bodies), own.shape[1] - 10 * len(robot.bodies)
        mapping = np.zeros((len(x), L + 10 + E + J))
        mapping[: self.p, :L], mapping[: self.p, L + 10 : L + 10 + E] = own[:, :L], own[:, L:]
        if self.payload_reduction is not None:
            where = [L + self.felt[i] for i in self.unknown]
            mapping[self.p : self.p + self.k, where] = self.payload_reduction.mapping
        mapping[self.p + self.k :, L + 10 + E :] = np.eye(J)
        effects = self.bare.columns[len(robot.columns) :]
        size = np.abs(x[: self.p]) @ np.abs(own[:, L:]) + 1e-9
        links = Links(
            (*(f"the body behind {n}" for n in robot.bodies), "the payload"),
            np.vstack([robot.nominal.reshape(-1, 10), self._payload_prior()]),
            (None,) * (len(robot.bodies) + 1),
            np.vstack([np.array([robot.known.get(n, np.nan) for n in robot.all_names]).reshape(-1, 10), self.known]),
            RobotScale.of(robot).length,
        )
        extras = Extras(
            (*(c.name for c in effects), *(f"the gain of {n}" for n in robot.joints)),
            np.concatenate([np.zeros(E), x[-J:]]),
            np.concatenate([size, np.abs(x[-J:])]),
            np.array([*(0 for _ in effects), *[1] * J], dtype=int),
        )
        found = consistent(x, information, mapping, links, extras)
        remark = (
            "do not use the physical gains: no robot whose links can exist, with this payload, reproduces these logs "
            "within their bounds. An effect may be missing (frischid diagnose)"
        )
        return 1.0 / found.theta[-J:], [] if found.reproduces else [remark]

    def _payload_prior(self) -> Array:
        """The prior of the payload: a ball of its mass at its centre, or at the carrier's joint."""
        h = np.where(np.isnan(self.known[1:4]), 0.0, self.known[1:4])
        m, c = self.known[0], h / self.known[0]
        about = m * (2 * _PAYLOAD_SIZE**2 + c @ c) * np.eye(3) - m * np.outer(c, c)
        return np.array([m, *h, about[0, 0], about[0, 1], about[1, 1], about[0, 2], about[1, 2], about[2, 2]])

    def payload(self, blocks: Sequence[Gram], gains: Array) -> Carried:
        """The payload identified from torques with given gains, its mass unknown."""
        every = self._reduced(range(len(self.felt)))
        assert every is not None
        keep = [*range(self.p), *(self.p + i for i in every.base)]
        scaled = []
        for block in blocks:
            chosen = block.select(keep)
            chosen.moments[:, -1] *= gains[:, None]
            chosen.moments[:, :, -1] *= gains[:, None]
            chosen.sums[:, -1] *= gains
            scaled.append(chosen)
        estimate = wls(scaled)
        values = dict(zip((self.felt[i] for i in every.base), estimate.theta[self.p :], strict=True))
        at = self.p + list(every.base).index(self.felt.index(0))
        mass = values[0]
        centre = np.array([values.get(k, np.nan) for k in (1, 2, 3)]) / mass
        return Carried(float(mass), float(estimate.stderr[at]), centre)
