"""May a step of `improve` stay? It must help where it acts, harm no joint, and be physically possible.

With q_i and q_i' the cross-validated squared errors of a joint without and with the effect, less the part that
uncertain parameters alone cause (`weighted_fit`), block of time b has the rise

    d_b = Σ_{i in b} (q_i' − q_i).

A fit to one log of two may leave a coefficient open, and predict the other log badly. No model has this error.

- *Harm*: a joint becomes worse when its d_b are positive on average (Student's t over blocks, one-sided, Bonferroni
  over the joints), and its rows reject the parameters of the model with the effect. Joints share parameters. Where an
  effect explains one joint, that joint has more say about them, and they move within their uncertainty. This raises
  the error of another joint, in all blocks alike, so blocks do not show this spread. The rows of a joint reject new
  parameters by the likelihood ratio,

      n_j/ℓ_j log(Σ q_j' / Σ q_j) > χ²_ν,     ν_j = tr(H⁻¹ ω_j Y_jᵀ Y_j),

  with n_j/ℓ_j effectively independent samples, which determine ν_j of the parameters.
- *Help*: over the joints the effect acts on, the fall −Σ_j w_j d_b with w_j = 1 / Σ q_j must be positive by the same
  test, or by Wilcoxon's test of ranks. Of B blocks, ranks have a p value of 2⁻ᴮ or more. Where that is above the level,
  whatever the data say, each block counts with the effect's energy in it, as in `frischid.diagnosis.block_test`. Where
  the joints together do not pass, the same test of each joint alone, Bonferroni over them, says where the effect helps.
- *Together*: the errors of J joints are combined by the mean log ratio

      (1/J) Σ_j log(Σ q_j' / Σ q_j)  <  0,

  so that every joint counts by its relative change. In the mean NRMSE the joint with the largest error counts most, and
  its gain could hide harm to all others.
- *Standstill*: this ratio must not rise significantly when samples at standstill count too. The error of a joint that
  rests in a pose stays as it is, so a rest is one observation, however long, of all joints together (`rises`).
- *Signs*: a coefficient of known sign has this sign.
- *Friction brakes*: on the logs' motion at a multiple of its speed, the friction of each joint takes energy,

      Σ_t τ_friction,j q̇_j  ≥  0.

  A slow log may speak for a term that grows with a power of the speed and would drive the joint in faster motion.

Blocks last about a second. Where a residual is correlated for longer, a step is refused too often rather than too
rarely. All tests use the logs that select; test logs have no part.

Source: Wilcoxon 1945, "Individual comparisons by ranking methods", Biometrics Bulletin 1(6).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy import special

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.diagnosis.block_test import LEAST_BLOCKS, counted_squares, p_value_of, share_of_rows
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.rises import Rises
from frischid.effects import Effect, columns_of
from frischid.estimators.p_values import mean_above_zero
from frischid.logs.log import Log
from frischid.logs.recording import Recording
from frischid.model.alarms import AlarmCriteria
from frischid.model.identification_alarms import run_faster
from frischid.model.model import Model
from frischid.regression.block import Block
from frischid.regression.regressor import Regressor

RISES_AT_STANDSTILL = (
    "the error would rise when samples at standstill count too; the search for effects counts motion alone"
)
"""Reason to refuse a step."""


def reason_against(validator: CrossValidator, effects: Sequence[Effect]) -> str:
    """Why the cross-validated errors speak against adding some effects; empty where they speak for the addition.

    Parameters
    ----------
    validator : CrossValidator
        Of the model without the effects, on the logs that select.
    effects : sequence of Effect
        The effects of one finding.
    """
    criteria = validator.criteria
    candidate = validator.joined(validator.candidates(effects))
    after = validator.extended(candidate)
    sums = validator.base_predictive().sum(axis=0), after.base_predictive().sum(axis=0)
    each = [_rise(validator, after, row) for row in range(len(validator.joints))]
    worse = _worse(validator, after, [rise for rise, _ in each])
    if worse:
        return f"{_named(validator.joints, worse, *sums)} would become worse"
    ratio = np.log(np.maximum(sums[1], 1e-300) / np.maximum(sums[0], 1e-300))
    rise, energy = np.sum([np.stack(each[row]) / max(sums[0][row], 1e-300) for row in candidate.columns], axis=0)
    if not p_value_of_fall(-rise, energy, criteria) < criteria.block_p_value:
        return (
            f"the error of {listed([validator.joints[row] for row in candidate.columns])} does not fall consistently "
            "over blocks of time"
        )
    return "" if ratio.mean() < 0 else "the errors of all joints together do not fall"


def harmless(validator: CrossValidator, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Those of some effects that act on no joint which all of them together would make worse.

    Parameters are as in `reason_against`.
    """
    after = validator.extended(validator.joined(validator.candidates(effects)))
    worse = set(_worse(validator, after, [_rise(validator, after, row)[0] for row in range(len(validator.joints))]))
    columns = [{row for c in validator.candidates([effect]) for row in c.columns} for effect in effects]
    return tuple(effect for effect, rows in zip(effects, columns, strict=True) if not rows & worse)


def helped(validator: CrossValidator, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Those of some effects on whose own joints the error falls, with all of them in the model (Bonferroni)."""
    after = validator.extended(validator.joined(validator.candidates(effects)))
    columns = [{row for c in validator.candidates([effect]) for row in c.columns} for effect in effects]
    before, level = validator.base_predictive().sum(axis=0), validator.criteria.block_p_value / len(effects)

    def p_value(rows: Iterable[int]) -> float:
        each = [np.stack(_rise(validator, after, row)) / max(before[row], 1e-300) for row in rows]
        rise, energy = np.sum(each, axis=0)
        return p_value_of_fall(-rise, energy, validator.criteria)

    return tuple(effect for effect, rows in zip(effects, columns, strict=True) if p_value(rows) < level)


def _worse(before: CrossValidator, after: CrossValidator, rises: Sequence[Array]) -> list[int]:
    """Positions of the joints that a wider model makes worse."""
    sums = before.base_predictive().sum(axis=0), after.base_predictive().sum(axis=0)
    return worse_joints(rises, *sums, before.criteria, rejection(after.fit.determined, before.effective, *sums))


def _rise(before: CrossValidator, after: CrossValidator, row: int) -> tuple[Array, Array]:
    """Rise of a joint's squared cross-validated error, and energy of the change of its prediction, per block, (B,)."""
    rise, energy = np.zeros((2, before.data.cache.blocks))
    for data in before.data.motions_of(row):
        (apart, whole), (apart_after, whole_after) = (v.predicted(data) for v in (before, after))
        one, other = (share_of_rows(data, v.fit.shares) for v in (before, after))
        first = counted_squares(data.tau - apart, data.tau - whole, one)
        second = counted_squares(data.tau - apart_after, data.tau - whole_after, other)
        np.add.at(rise, data.block, second - first)
        np.add.at(energy, data.block, counted_squares(apart - apart_after, whole - whole_after, (one + other) / 2))
    return rise, energy


def p_value_of_fall(fall: Array, energy: Array, criteria: DiagnosisCriteria) -> float:
    """P value of the fall of the squared error over blocks of time.

    Parameters
    ----------
    fall, energy : ndarray, shape (B,)
        Fall in each block, and energy of the effect in it; blocks without rows hold zero.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.diagnosis.criteria import DiagnosisCriteria
    >>> from frischid.diagnosis.step_acceptance import p_value_of_fall
    >>> three = np.array([0.55, 0.01, 0.44])  # a short log, whose error is gone in every block
    >>> p_value_of_fall(three, three, DiagnosisCriteria()) < 0.001
    True
    """
    there = fall != 0
    fall, energy = fall[there], energy[there]
    found = p_value_of(fall)
    ranks_can_tell = 0.5 ** len(fall) < criteria.block_p_value
    return found if ranks_can_tell else min(found, p_value_of(fall, energy))


def rejection(determined: Array, effective: Array, before: Array, after: Array) -> Array:
    """P value of each joint's rise (J,), where the parameters only moved within the uncertainty of the joint's rows.

    Parameters
    ----------
    determined : ndarray, shape (J,)
        Number of parameters that the joint's rows determine.
    effective : ndarray, shape (J,)
        Effectively independent samples.
    before, after : ndarray, shape (J,)
        Sums of squared errors.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.diagnosis.step_acceptance import rejection
    >>> one = np.ones(2)
    >>> rejection(np.array([9.0, 9.0]), np.array([200.0, 2000.0]), one, 1.02 * one).round(3)  # 1 % of the rms error
    array([0.914, 0.   ])
    """
    rise = np.log(np.maximum(after, 1e-300) / np.maximum(before, 1e-300))
    return np.asarray(special.chdtrc(determined, effective * np.maximum(rise, 0.0)))


def worse_joints(
    rises: Sequence[Array], before: Array, after: Array, criteria: DiagnosisCriteria, rejected: Array
) -> list[int]:
    """Positions of the joints whose squared error rises significantly, by both tests, and not negligibly.

    Parameters
    ----------
    rises : sequence of ndarray, shape (B,)
        For each joint the rise of its squared error in each block of time; blocks without rows hold zero.
    before, after : ndarray, shape (J,)
        Sums of squared errors.
    rejected : ndarray, shape (J,)
        P values of `rejection`.
    """
    level = criteria.block_p_value / len(rises)
    found = []
    for row, rise in enumerate(rises):
        rise = rise[rise != 0]
        if len(rise) < LEAST_BLOCKS or after[row] <= (1 + criteria.harmless_rise) * before[row]:
            continue
        if max(mean_above_zero(rise), rejected[row]) < level:
            found.append(row)
    return found


def _named(joints: Sequence[str], rows: Sequence[int], before: Array, after: Array) -> str:
    """Joints with the ratio by which their rms error rises."""
    return listed([f"{joints[row]} (error × {np.sqrt(after[row] / max(before[row], 1e-300)):.3g})" for row in rows])


# ---------------------------------------------------------------- the refitted model


def reason_against_refit(
    before: Model,
    after: Model,
    effects: Sequence[Effect],
    logs: Sequence[Log | Recording],
    criteria: DiagnosisCriteria,
) -> str:
    """Why a model that was fitted again with some effects may not stay; empty where it may.

    Parameters
    ----------
    before, after : Model
        Without and with the effects, with the same filter.
    logs : sequence of Log or Recording
        The logs that select.
    """
    impossible = impossible_coefficients(after, effects)
    if impossible:
        return f"the sign of {listed(impossible)} is physically impossible"
    driven = driven_by_friction(before, after, logs)
    if driven:
        return f"at {AlarmCriteria().faster:g} times the speed, friction would drive {listed(driven)} and not brake"
    return RISES_AT_STANDSTILL if worse_with_standstill(before, after, logs, criteria) else ""


def impossible_coefficients(model: Model, effects: Sequence[Effect]) -> list[str]:
    """Coefficients of some effects whose estimate has the impossible sign.

    With a prior, known signs are bounds of the fit, so there is none.

    Parameters
    ----------
    model : Model
        With the effects.
    """
    names = {column.name for effect in effects for column in effect.columns(model.robot)}
    e = model.estimate
    return [
        f"{column.name} = {x:.3g} ± {s:.2g}"
        for column, x, s in zip(e.columns, e.theta, e.stderr, strict=True)
        if column.name in names and column.sign * x < 0
    ]


def driven_by_friction(before: Model, after: Model, logs: Sequence[Log | Recording]) -> list[str]:
    """Joints that friction would drive with some effects, on the logs' motion run faster.

    A joint that friction drives without the effects too counts only if the effects make that worse.

    Parameters
    ----------
    before, after : Model
        Without and with the effects.
    logs : sequence of Log or Recording
        The logs that select.
    """
    taken = [_energy_of_friction(model, logs, AlarmCriteria().faster) for model in (before, after)]
    return [name for name, *work in zip(after.robot.joints, *taken, strict=True) if work[1] < min(0.0, work[0])]


def _energy_of_friction(model: Model, logs: Sequence[Log | Recording], faster: float) -> Array:
    """Power that friction takes from each joint, W, (J,): a sum over states of the logs' motion, run faster."""
    regressor = Regressor(model.robot, model.effects, model.reference)
    friction = {effect.id for effect in model.effects if effect.friction}
    felt = np.array([column.effect in friction for column in columns_of(model.robot, model.effects)])
    taken = np.zeros(len(model.robot.joints))
    for Y, v in run_faster(regressor, model.motions(logs), faster):
        taken += ((model.full_theta[felt] @ Y[:, felt]) * v).sum(axis=0)
    return taken


def worse_with_standstill(
    before: Model, after: Model, logs: Sequence[Log | Recording], criteria: DiagnosisCriteria
) -> bool:
    """Whether the mean log ratio of the joints' errors rises significantly when samples at standstill count too.

    No model is fitted to samples at standstill, so their errors need no cross-validation. Errors in motion are those of
    the fitted logs, which favours the step; so a rise shows the harm that an effect does at standstill.

    Parameters
    ----------
    before, after : Model
        Without and with the effects, with the same filter.
    logs : sequence of Log or Recording
        The logs that select.
    """
    sums, rises = np.zeros((2, len(before.joints))), Rises(len(before.joints), criteria.block_seconds)
    for part, squares in _squares(before, after, logs):
        sums += squares.sum(axis=1)
        rises.add(part, part.used[:, before.torque_index], squares[1] - squares[0])
    sums = np.maximum(sums, 1e-300)
    if np.log(sums[1] / sums[0]).mean() <= np.log1p(criteria.harmless_rise):
        return False
    return p_value_of(rises.of_all(sums[0])) < criteria.block_p_value


def _squares(before: Model, after: Model, logs: Sequence[Log | Recording]) -> Iterator[tuple[Block, Array]]:
    """Each part of the logs with its squared errors without and with the effects, (2, M, J)."""
    index = before.torque_index
    for part, one, other in _predicted(before, after, logs):
        yield part, np.stack([part.tau - one, part.tau - other])[:, :, index] ** 2


def _predicted(before: Model, after: Model, logs: Sequence[Log | Recording]) -> Iterator[tuple[Block, Array, Array]]:
    """Filtered samples with the torques (M, J) of both models; the columns they share are computed once."""
    shared = after.effects[: len(before.effects)] == before.effects
    if not shared or (after.reference != before.reference and any(effect.loaded for effect in after.effects)):
        for (part, one), (_, other) in zip(before.blocks(logs), after.blocks(logs), strict=True):
            yield part, one, other
        return
    theta = np.zeros(len(after.full_theta))
    theta[: len(before.full_theta)] = before.full_theta
    for part, other in after.blocks(logs):
        yield part, np.asarray(theta @ part.Y), other
