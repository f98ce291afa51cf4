"""Measured against predicted, joint by joint, on logs that were not fitted.

    RMSE = sqrt(mean (τ − τ̂)²),   NRMSE = RMSE / std(τ),   fit = 100 (1 − NRMSE) %

Both torques pass the model's filter. Every figure has two references: the URDF's links with fitted friction, and a
constant (the mean torque of the identification logs). A model with a larger error than either is useless.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from frischid.core.named_sequence import NamedSequence
from frischid.core.progress import counter
from frischid.core.shown import Shown
from frischid.core.text import counted
from frischid.core.types import Array
from frischid.effects import columns_of
from frischid.errors import InputError
from frischid.logs.given import Logs, as_logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.summary import Data
from frischid.model.alarms import Alarm, AlarmCriteria, by_severity
from frischid.model.comparison_alarms import UNLIKE, Elsewhere, elsewhere, is_worse
from frischid.model.comparison_criteria import COMPARISON_CRITERIA
from frischid.model.events import cross_validated_nrmse
from frischid.model.expected_error import ExpectedError
from frischid.model.joint_fit import ErrorSums, JointFit
from frischid.model.log_faults import faulty_new_logs
from frischid.model.model import Model
from frischid.model.model_argument import check_model
from frischid.model.noise_floor import NoiseFloor
from frischid.model.residual_conditions import SAMPLES_KEPT, Residuals, SampledBlocks
from frischid.model.standstill_joints import STANDSTILL_LOG, rows_of
from frischid.regression.block import Block
from frischid.regression.regressor import nominal_parameters


@dataclass(frozen=True, eq=False)
class Comparison(Shown):
    """Errors of a model on some logs.

    Attributes
    ----------
    joints : NamedSequence of JointFit
        By position and by name: ``comparison.joints[0]``, ``comparison.joints["elbow"]``.
    samples : int
        Filtered samples compared.
    standstill : float
        Share of the torque samples left out because the joint stood still (its dry friction is then undetermined).
    nrmse_with_standstill : float
        Mean NRMSE when the samples at standstill are counted.
    sources : tuple of str
        The logs.
    alarms : tuple of Alarm
        Reasons not to trust the model or these figures; none on the model's own logs.
    poses : int
        Number of the samples that are poses of an arm at standstill. They test gravity alone, up to the dry friction.
    not_compared : tuple of str
        Joints that never move in these logs, or whose torque never changes: no error of theirs can be measured.
    residuals : Residuals
        Residuals and motion behind the figures: where the model fails, and the structure of the residual error. Of very
        long logs, `SAMPLES_KEPT` samples in stretches spread evenly.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> motions = [fr.random_fourier(robot, 5.0, seed=seed) for seed in (1, 2)]
    >>> logs = [fr.simulate(robot, motion, rate=100.0, noise=fr.Noise(tau=0.05)) for motion in motions]
    >>> comparison = fr.compare(fr.identify(robot, logs[:1], recursion="none").model, logs[1:])
    >>> comparison.joints.names
    ('joint1', 'joint2')
    >>> comparison.joints[0] is comparison.joints["joint1"]
    True
    """

    joints: NamedSequence[JointFit]
    samples: int
    standstill: float
    nrmse_with_standstill: float
    sources: tuple[str, ...]
    alarms: tuple[Alarm, ...]
    residuals: Residuals = field(repr=False)
    not_compared: tuple[str, ...] = ()
    poses: int = 0

    def __repr__(self) -> str:
        joints = counted(len(self.joints), "joint")
        return f"Comparison(NRMSE {self.nrmse:.4f} over {joints}, noise floor {self.noise_floor:.4f})"

    @property
    def noise_floor(self) -> float:
        """Mean NRMSE of the sensors' noise alone."""
        return float(np.mean([j.noise_floor for j in self.joints]))

    @property
    def nrmse(self) -> float:
        """Mean NRMSE over the joints."""
        return float(np.mean([j.nrmse for j in self.joints]))

    @property
    def nominal(self) -> float:
        """Mean NRMSE of the URDF's links with friction fitted to the model's own logs."""
        return float(np.mean([j.nominal for j in self.joints]))

    @property
    def behind_urdf(self) -> list[str]:
        """Joints whose torque the URDF's links with fitted friction predict better, as ``worse-than-urdf`` counts."""
        limits = AlarmCriteria()
        return [j.name for j in self.joints if is_worse(j.nrmse, j.nominal, j.noise_floor, limits)]

    @property
    def constant(self) -> float:
        """Mean NRMSE of a constant torque."""
        return float(np.mean([j.constant for j in self.joints]))

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        structure = self.residuals.structure()
        return {
            "nrmse": self.nrmse,
            "noise_floor": self.noise_floor,
            "nominal_nrmse": self.nominal,
            "constant_nrmse": self.constant,
            "samples": self.samples,
            "poses": self.poses,
            "standstill_share": self.standstill,
            "nrmse_with_standstill": self.nrmse_with_standstill,
            "logs": list(self.sources),
            "not_compared": list(self.not_compared),
            "alarms": [alarm.to_dict() for alarm in self.alarms],
            "conditions": self.residuals.to_dict(),
            "criteria": COMPARISON_CRITERIA.to_dict(),
            "joints": {
                name: {
                    "rmse": j.rmse,
                    "nrmse": j.nrmse,
                    "fit": j.fit,
                    "bias": j.bias,
                    "std": j.std,
                    "nominal_nrmse": j.nominal,
                    "constant_nrmse": j.constant,
                    "noise_floor": j.noise_floor,
                    "expected_nrmse": j.expected,
                    "correlation_time": structure[name].correlation_time,
                    "white": structure[name].white,
                    "depends_on": dict(structure[name].depends_on),
                    "worst": vars(j.worst),
                }
                for name, j in self.joints.items()
            },
        }


def compare(
    model: Model,
    logs: Logs,
    evaluated: Sequence[tuple[Block, Array]] | None = None,
    *,
    criteria: AlarmCriteria | None = None,
    residuals_kept: int = SAMPLES_KEPT,
    mapping: MappingLike = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Predict logs and measure the error.

    Parameters
    ----------
    model : Model
    logs : sequence of Log, Recording or data frame, or one data frame
        At least one; each must hold position and torque of the model's joints. A joint that never moves is not compared
        (``Comparison.not_compared``).
    evaluated : sequence of (Block, ndarray), optional
        ``model.blocks(logs)``, where the caller has it already.
    criteria : AlarmCriteria, optional
    residuals_kept : int
        Samples whose residuals stay in memory, to show where the model fails; at least a stretch of 1,000.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.
    progress : callable
        Called with the share of the samples that are compared, after each log or chunk.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        A log lacks a joint or its torque, or no joint moves.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> motions = [fr.random_fourier(robot, 5.0, seed=seed) for seed in (1, 2)]
    >>> logs = [fr.simulate(robot, motion, rate=100.0, noise=fr.Noise(tau=0.05)) for motion in motions]
    >>> model = fr.identify(robot, logs[:1], recursion="none").model
    >>> comparison = fr.compare(model, logs[1:])
    >>> comparison.nrmse < 0.05 < comparison.constant
    True
    """
    check_model(model)
    logs = as_logs(logs, model.robot.joints, mapping)
    if not logs:
        raise InputError("there is no log to compare the model with; give at least one")
    model.check(logs)
    errors = ModelErrors(model, residuals_kept)
    progress("comparing")
    known = all(isinstance(log, Log) for log in logs)
    told = counter(progress, "comparing", sum(len(log) for log in logs if isinstance(log, Log)) if known else 0)
    motions = errors.noise.watch(model.motions(logs, told))
    for block, fitted in model.evaluate(motions) if evaluated is None else evaluated:
        errors.add(block, fitted)
    for _ in motions:  # those of blocks that the caller evaluated are still to be seen
        pass
    found = errors.comparison(tuple(log.source for log in logs))
    if all(model.made_from(log) for log in logs):
        return found
    return replace(found, alarms=_alarms(model, logs, found, errors, criteria or AlarmCriteria()))


class ModelErrors:
    """Errors of a model on logs, gathered block by block.

    Attributes
    ----------
    noise : NoiseFloor
        Is to see the motions that the blocks come from.
    """

    def __init__(self, model: Model, residuals_kept: int = SAMPLES_KEPT) -> None:
        count = len(model.joints)
        self._model, self._urdf = model, urdf_parameters(model)
        self._moving, self._everything, self._kept = ErrorSums(count), ErrorSums(count), SampledBlocks(residuals_kept)
        self.noise, self.expected = NoiseFloor(model), ExpectedError(model)

    def add(self, block: Block, fitted: Array) -> None:
        """Take in a block and the torque the model predicts for the block, shape (M, J)."""
        index = self._model.torque_index
        known = block.known[:, index]
        guess = (self._urdf @ block.Y)[:, index]
        rows = (block.t, block.tau[:, index] + known, fitted[:, index] + known, guess + known)
        used = block.used[:, index].astype(float)
        self._moving.add(*rows, used, block.source)
        self._everything.add(*rows, np.ones_like(used), block.source)
        self._kept.add(block, fitted)
        self.expected.add(block)

    def own_torque(self) -> tuple[Array, Array]:
        """Mean and spread of the torque seen, (J,) each; from now on this mean is that of the model's own logs."""
        mean = self._moving.tau / np.maximum(self._moving.count, 1)
        self._model = replace(self._model, mean_torque=mean)
        return mean, self._moving.std

    def comparison(self, sources: tuple[str, ...]) -> Comparison:
        """The comparison on these logs, without alarms.

        Raises
        ------
        InputError
            No joint moves, or no torque changes.
        """
        sums = self._moving
        changing = sums.changing
        if not changing.any():
            raise InputError(
                f"{', '.join(sources)}: no joint moves with a torque that changes: there is nothing to compare. "
                f"{STANDSTILL_LOG}"
            )
        model = rows_of(self._model, changing)
        residuals, both = Residuals(model, self._kept.blocks), (sums.of(changing), self._everything.of(changing))
        rmse = np.sqrt(sums.error2 / np.maximum(sums.count, 1))
        floor = np.minimum(self.noise.under(rmse), rmse)[changing]  # an error below a floor refutes the floor
        found = _summary(model, both, sources, floor, self.expected_rms[changing], residuals)
        left_out = tuple(name for name, known in zip(self._model.joints, changing, strict=True) if not known)
        return replace(found, not_compared=left_out, poses=self.noise.poses)

    @property
    def expected_rms(self) -> Array:
        """Error to expect from the model's uncertainty, and from the dry friction that holds poses, N·m (N), (J,)."""
        return np.asarray(np.hypot(self.expected.rms, self.noise.held))


def urdf_parameters(model: Model) -> Array:
    """Reference parameters, (C,): the URDF's links, with friction fitted to the model's own logs where it is known."""
    if model.fitted is None:
        rigid = [c.effect == "rigid" for c in columns_of(model.robot, model.effects)]
        return np.asarray(np.where(rigid, nominal_parameters(model.robot, model.effects), 0.0))
    theta = np.zeros(len(columns_of(model.robot, model.effects)))
    theta[list(model.base)] = model.fitted.urdf
    return theta


def _alarms(
    model: Model, logs: Sequence[Data], summary: Comparison, errors: ModelErrors, criteria: AlarmCriteria
) -> tuple[Alarm, ...]:
    """Alarms of a model on logs that it was not fitted to."""
    rmse = np.array([j.rmse for j in summary.joints])
    compared = np.isin(model.joints, summary.joints.names)
    known = cross_validated_nrmse(model.history, model.joints)
    seen = Elsewhere(
        joints=summary.joints.names,
        spread=np.array([j.std for j in summary.joints]),
        fitted_spread=np.full(len(rmse), np.nan) if model.fitted is None else model.fitted.spread[compared],
        held=errors.noise.held[compared],
        expected=errors.expected.rms[compared] if model.prior is not None else np.full(len(rmse), np.nan),
        measured=rmse,
        floors=np.array([j.noise_floor * j.std for j in summary.joints]),
        outside=errors.expected.outside_share[compared],
        nrmse=summary.nrmse,
        noise_floor=summary.noise_floor,
        cross_validated=np.nan if known is None else known,
        urdf=summary.nominal if model.fitted is not None else np.nan,
    )
    found = elsewhere(seen, criteria)
    unlike = {joint for alarm in found if alarm.id == UNLIKE for joint in alarm.joints}
    return by_severity([*(faulty_new_logs(model, logs, unlike) if unlike else ()), *found])


def _summary(
    model: Model,
    both: tuple[ErrorSums, ErrorSums],
    sources: tuple[str, ...],
    floor: Array,
    expected: Array,
    residuals: Residuals,
) -> Comparison:
    """Figures from the sums over moving samples, and over all; every joint of the model moves."""
    sums, everything = both
    n, std = sums.count, sums.std
    rmse, nominal = np.sqrt(sums.error2 / n), np.sqrt(sums.nominal2 / n)
    constant = np.sqrt(std**2 + (sums.tau / n - model.mean_torque) ** 2)
    joints = {}
    for j, name in enumerate(model.joints):
        worst = sums.worst[j]
        assert worst is not None  # there is at least one sample, or prepare() raised
        joints[name] = JointFit(
            name=name,
            rmse=float(rmse[j]),
            nrmse=float(rmse[j] / std[j]),
            fit=float(100 * (1 - rmse[j] / std[j])),
            bias=float(sums.error[j] / n[j]),
            std=float(std[j]),
            nominal=float(nominal[j] / std[j]),
            constant=float(constant[j] / std[j]),
            noise_floor=float(floor[j] / std[j]),
            expected=float(expected[j] / std[j]),
            worst=worst,
        )
    standstill = 1.0 - float(n.sum() / everything.count.sum())
    with_standstill = float(np.mean(np.sqrt(everything.error2 / everything.count) / everything.std))
    return Comparison(NamedSequence("joint", joints), sums.samples, standstill, with_standstill, sources, (), residuals)
