"""Drive gains from a payload of known weight: what a joint's torque is per ampere.

    g_j i_j = Y_j θ                        without the payload
    g_j i_j = Y_j θ + L_j x_L              with it, its mass in x_L known

Currents alone fix θ and g only up to one common factor; the known weight fixes that (Gautier and Briot 2014, ASME J.
Dynamic Systems, Measurement and Control 136(5)). Three ways, from the same moments:

- *total least squares*: with X = (g, θ, x) and known torque w of the weight, ``[I_j  −Y_j  −L_j  −w] (X, 1) ≈ 0``. Only
  currents are noisy, so θ and x are eliminated exactly and g is the eigenvector of the least eigenvalue of what is left
  (mixed least squares - total least squares, Van Huffel and Vandewalle 1991, chapter 3);
- *in amperes*: ``i_j = κ_j (Y_j θ + L_j x + w) + noise`` with κ = 1/g, by Gauss-Newton from there: the likelihood of
  noisy currents. Its standard errors are a jackknife over blocks of time, as in `frischid.estimators.least_squares`;
- *physically constrained*: the same, nearest by its information, with every link and the payload physical and g > 0.

Given gains are checked the other way round: they must give the payload's weight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.core.types import Array
from frischid.effects import BASELINE, Effect, Payload
from frischid.effects.dynamics import random_states
from frischid.errors import IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators.drive_gain_ls import in_amperes, total_least_squares
from frischid.estimators.least_squares import wls
from frischid.estimators.physical_links import Extras, Links, consistent
from frischid.export.consistency import link_mapping
from frischid.logs.cutoff_choice import choose_lowpass
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.preprocessing import prepare
from frischid.logs.summary import held_by
from frischid.regression.accumulation import accumulate
from frischid.regression.base_parameters import Reduction, reduce
from frischid.regression.moments import Gram, total
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import LINK_PARAMETERS, Robot

SIZE = 0.05  # m: radius of gyration the payload is believed to have


@dataclass(frozen=True, eq=False)
class Carried:
    """A payload as identified: kg and m, in the frame of the joint that carries it."""

    mass: float
    mass_stderr: float
    centre: Array


@dataclass(frozen=True, eq=False)
class Gains:
    """Drive gains of J joints.

    Attributes
    ----------
    joints : tuple of str
    channel : {"current", "tau"}
        What the gains are for: currents (N·m/A, N/A), or a torque channel that may be mis-scaled (1).
    gains, stderr : ndarray, shape (J,)
        In amperes, see the module.
    total_least_squares, constrained : ndarray, shape (J,)
    given : ndarray, shape (J,), or None
        Gains to check.
    payload : Carried or None
        What `given` make of the payload; None without them.
    mass : float
        What it weighs, kg.
    samples : int
        Filtered samples used.
    lowpass : LowPass
    notes : tuple of str
    """

    joints: tuple[str, ...]
    channel: str
    gains: Array
    stderr: Array
    total_least_squares: Array
    constrained: Array
    given: Array | None
    payload: Carried | None
    mass: float
    samples: int
    lowpass: LowPass
    notes: tuple[str, ...]


def find_gains(
    robot: Robot,
    unloaded: Sequence[Log],
    loaded: Sequence[Log],
    mass: float,
    *,
    centre: Sequence[float] | None = None,
    carrier: str | None = None,
    given: Mapping[str, float] | None = None,
    effects: Sequence[Effect] = BASELINE,
    cutoff: float | str | None = "auto",
) -> Gains:
    """Identify drive gains from logs without and with a payload of known weight.

    Parameters
    ----------
    robot : Robot
        With ``frames="joint"``.
    unloaded, loaded : sequence of Log
        With currents, or with torques whose scale is to be checked.
    mass : float
        Of the payload, kg.
    centre : sequence of 3 float, optional
        Its centre of mass in the carrier's joint frame, m, where known.
    carrier : str, optional
        Joint behind which it hangs; the last by default.
    given : mapping of str to float, optional
        Gains to check, N·m/A (N/A).
    effects : sequence of Effect
        What acts besides the links; taken to be the same with and without the payload.
    cutoff : float, "auto" or None

    Raises
    ------
    InputError
        A log lacks currents, or the mass is not a positive number.
    IdentifiabilityError
        The logs do not determine the gains.
    """
    if not (np.isfinite(mass) and mass > 0):
        raise InputError(f"the payload's mass must be a positive number of kg, got {mass}")
    if robot.frames != "joint":
        raise InputError("drive gains are found in joint frames; load the robot without --frames")
    robot, notes = held_by(robot, [*unloaded, *loaded])
    channel = (
        "current" if all(log.has("current")[log.index(robot.joints)].all() for log in [*unloaded, *loaded]) else "tau"
    )
    _check_given(robot, given)
    problem = _Problem(robot, effects, carrier or robot.joints[-1], mass, centre)
    lowpass = _lowpass([_measured(log, robot, channel) for log in [*unloaded, *loaded]], robot, cutoff)
    blocks = [
        *problem.blocks([_measured(log, robot, channel) for log in unloaded], lowpass, loaded=False),
        *problem.blocks([_measured(log, robot, channel) for log in loaded], lowpass, loaded=True),
    ]
    arranged, counts, J = [problem.arranged(b) for b in blocks], total(blocks).counts, len(robot.joints)
    rough, start = total_least_squares(np.sum(arranged, axis=0), counts)
    x, covariance, information = in_amperes(arranged, counts, rough, start, problem.names)
    gains = 1.0 / x[-J:]
    constrained, remark = problem.constrained(x, information)
    values = None
    if given is not None or channel == "tau":
        values = np.array([(given or {}).get(n, 1.0) for n in robot.joints])
    return Gains(
        robot.joints,
        channel,
        gains,
        gains**2 * np.sqrt(np.diag(covariance)[-J:]),
        rough,
        constrained,
        values,
        None if values is None else problem.payload(blocks, values),
        mass,
        int(sum(b.counts.max() for b in blocks)),
        lowpass,
        (*notes, *remark),
    )


def _check_given(robot: Robot, given: Mapping[str, float] | None) -> None:
    missing = [] if given is None else [n for n in robot.joints if n not in given]
    if missing:
        raise InputError(f"gains are given for some joints only; {', '.join(missing)} lack one (give all or none)")


def _measured(log: Log, robot: Robot, channel: str) -> Log:
    """The log with currents in the place of torques."""
    chosen = log.select(robot.joints)
    values = getattr(chosen, channel)
    if values is None or np.isnan(values).any():
        raise InputError(
            f"{log.source}: neither current_<joint> nor tau_<joint> for all of {', '.join(robot.joints)}; drive gains "
            "need one of them in every log"
        )
    return replace(chosen, tau=values)


def _lowpass(logs: Sequence[Log], robot: Robot, cutoff: float | str | None) -> LowPass:
    if cutoff == "auto":
        return choose_lowpass(logs, robot.joints)
    return LowPass(None if cutoff is None else float(cutoff))


class _Problem:
    """Columns [base parameters, unknown payload parameters, known weight, current], and the three solutions."""

    def __init__(
        self, robot: Robot, effects: Sequence[Effect], carrier: str, mass: float, centre: Sequence[float] | None
    ) -> None:
        if carrier not in robot.joints:
            raise UnknownNameError("joint", carrier, robot.joints)
        self.robot, self.effects, self.carrier = robot, tuple(effects), carrier
        self.bare = Regressor(robot, effects)
        self.reduction = structure(self.bare, robot.joints)
        self.regressor = Regressor(robot, (*effects, Payload(joints=(carrier,), full=True)))
        self.known = np.full(10, np.nan)
        self.known[0] = mass
        if centre is not None:
            if np.shape(centre) != (3,) or not np.isfinite(centre).all():
                raise InputError(f"the payload's centre of mass must be three finite numbers in m, got {list(centre)}")
            self.known[1:4] = mass * np.asarray(centre, dtype=float)
        fresh = self.regressor.columns[len(self.bare.columns) :]
        number = robot.numbers[carrier]
        self.felt = [LINK_PARAMETERS.index(c.name[1:].removesuffix(str(number))) for c in fresh]
        if 0 not in self.felt:
            raise IdentifiabilityError(f"no joint feels a payload behind {carrier}; it cannot fix the gains")
        self.payload_columns = np.arange(len(self.bare.columns), len(self.regressor.columns))
        self.unknown = [k for k, p in enumerate(self.felt) if np.isnan(self.known[p])]
        self.payload_reduction = self._reduced(self.unknown)
        self.p, self.k = self.reduction.rank, 0 if self.payload_reduction is None else self.payload_reduction.rank

    def _reduced(self, which: Sequence[int]) -> Reduction | None:
        """Independent ones among some of the payload's columns."""
        if not which:
            return None
        q, v, a = random_states(self.robot, 40)
        Y = self.regressor(0.5 * np.arange(40.0), q, v, 3.0 * a)[:, self.payload_columns[list(which)]]
        columns = [self.regressor.columns[i] for i in self.payload_columns[list(which)]]
        return reduce(Y.transpose(0, 2, 1).reshape(-1, len(which)), columns)

    def blocks(self, logs: Sequence[Log], lowpass: LowPass, *, loaded: bool) -> list[Gram]:
        """Moments of logs, the payload's columns zero where it does not hang there."""
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

    # ------------------------------------------------------------------ three solutions

    @property
    def names(self) -> list[str]:
        payload = [] if self.payload_reduction is None else [c.name for c in self.payload_reduction.base_columns()]
        return [
            *(c.name for c in self.reduction.base_columns()),
            *payload,
            *(f"the gain of {n}" for n in self.robot.joints),
        ]

    def constrained(self, x: Array, information: Array) -> tuple[Array, list[str]]:
        """Gains nearest to the unconstrained ones with physical links, a physical payload, and g > 0; remarks."""
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
            np.vstack([robot.nominal.reshape(-1, 10), self._believed()]),
            (None,) * (len(robot.bodies) + 1),
            np.vstack([np.array([robot.known.get(n, np.nan) for n in robot.all_names]).reshape(-1, 10), self.known]),
        )
        extras = Extras(
            (*(c.name for c in effects), *(f"the gain of {n}" for n in robot.joints)),
            np.concatenate([np.zeros(E), x[-J:]]),
            np.concatenate([size, np.abs(x[-J:])]),
            np.array([*(0 for _ in effects), *[1] * J], dtype=int),
        )
        found = consistent(x, information, mapping, links, extras)
        remark = "no physical robot and payload reproduce these logs within their bounds (frischid diagnose)"
        return 1.0 / found.theta[-J:], [] if found.reproduces else [remark]

    def _believed(self) -> Array:
        """A ball of the payload's mass at its centre, or at the carrier's joint."""
        h = np.where(np.isnan(self.known[1:4]), 0.0, self.known[1:4])
        m, c = self.known[0], h / self.known[0]
        about = m * (2 * SIZE**2 + c @ c) * np.eye(3) - m * np.outer(c, c)
        return np.array([m, *h, about[0, 0], about[0, 1], about[1, 1], about[0, 2], about[1, 2], about[2, 2]])

    def payload(self, blocks: Sequence[Gram], gains: Array) -> Carried:
        """The payload as torques with given gains show it, its mass free."""
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
