"""One effect in one place: its best shape, its evidence, its price, and whether chance explains the evidence.

A candidate has k parameters: its coefficients and its searched shape parameters. Its gain is

    gain = Λ − ½ k log n,     Λ = ½ Σ_j (n_j / ℓ_j) log(Q_j before / Q_j after),

the log likelihood ratio of the folds left out less the price of its parameters (Schwarz 1978, Ann. Statist. 6(2)). Q is
the held-out squared error without the part that uncertain parameters alone cause (`weighted_fit`): a candidate that
happens to draw less of this part has explained nothing.

If m candidates were tried, the p value of each is

    p = min(1, m · P(χ²_k > 2Λ))      (Bonferroni).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from scipy import special

from frischid.diagnosis.block_test import block_test
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.candidate_fits import Score
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.effects import EFFECTS, Coulomb, Effect, Offset, Viscous
from frischid.robot.robot import Robot

_CHANGES_HAVE_NAMES = (Viscous, Coulomb, Offset)  # friction_change and offset_change


@runtime_checkable
class Watcher(Protocol):
    """A `progress` that also hears of every candidate as soon as the candidate is scored."""

    def __call__(self, text: str, /) -> None:
        """Hear what is being done."""

    def scored(self, found: ScoredCandidate, change: float) -> None:
        """Hear of a candidate, and of the relative change of the mean cross-validated NRMSE with this one alone."""


@dataclass(frozen=True, eq=False)
class ScoredCandidate:
    """One effect in one place, in the shape that fits best."""

    candidate: Candidate
    score: Score
    ratio: float
    """Log likelihood ratio Λ of the folds left out."""
    price: float
    """½ k log n."""
    explained: float
    """Fall of the sum of the joints' squared held-out NRMSE, without the part that uncertain parameters alone cause."""

    @property
    def together(self) -> Candidate:
        """The candidate, under the name that all places of an effect have."""
        return self.candidate

    @property
    def effect(self) -> Effect:
        """The effect, in its place and shape."""
        return self.candidate.effect

    @property
    def gain(self) -> float:
        """Rise of the log likelihood, less the price."""
        return self.ratio - self.price

    def p_value(self, tried: int) -> float:
        """P value of a likelihood ratio at least this large, corrected for the candidates tried (Bonferroni)."""
        if self.gain <= 0:
            return 1.0
        return min(1.0, tried * float(special.chdtrc(parameters_of(self.candidate), 2 * self.ratio)))

    @property
    def worth_its_name(self) -> bool:
        """Whether its largest coefficient reaches the size below which the effect is another one (`Effect.least`)."""
        return bool(np.abs(self.score.beta).max(initial=0.0) >= type(self.effect).least)


def parameters_of(candidate: Candidate) -> int:
    """Number of parameters of a candidate: coefficients, and shape parameters whose values are searched."""
    return len(candidate.signs) + len(candidate.effect.searched)


def price(validator: CrossValidator, candidate: Candidate) -> float:
    """Price of a candidate's parameters, ½ k log n, with n the rows of its joints."""
    rows = float(validator.counts.sum(axis=0)[list(candidate.columns)].sum())
    return 0.5 * parameters_of(candidate) * float(np.log(max(rows, 2.0)))


def scored(validator: CrossValidator, shapes: Sequence[Candidate]) -> ScoredCandidate | None:
    """Score an effect in its best shape; None when the model's columns span the effect.

    Among shapes with the same number of parameters, the fit to the other folds decides. Among shapes with different
    numbers of parameters, the held-out data decide. A price in independent samples cannot decide there: while a slow
    effect is not in the model, the residual seems to have hardly any independent samples
    (`CrossValidator.effective_with`), so the shape with the fewest columns would always win.
    """
    sizes = {parameters_of(c) for c in shapes}
    tried = (_scored(validator, [c for c in shapes if parameters_of(c) == size]) for size in sorted(sizes))
    found = [x for x in tried if x is not None]
    if len(found) < 2:
        return found[0] if found else None
    before = validator.base_predictive()
    effective = np.max([validator.effective_with(x.candidate) for x in found], axis=0)
    return max(found, key=lambda x: validator.log_likelihood(before, x.score.predictive, effective) - x.price)


def _scored(validator: CrossValidator, shapes: Sequence[Candidate]) -> ScoredCandidate | None:
    found = validator.score(shapes)
    if found is None:
        return None
    score, candidate = found
    before, after = validator.base_predictive(), score.predictive
    ratio = validator.log_likelihood(before, after, validator.effective)
    if ratio > 0:
        ratio = validator.log_likelihood(before, after, validator.effective_with(candidate))
    explained = validator.explained(before, after)
    return ScoredCandidate(candidate, score, ratio, price(validator, candidate), explained)


def passes(validator: CrossValidator, found: ScoredCandidate, tried: int) -> bool:
    """Whether a candidate is more than chance, explains more than a negligible error, and does so over blocks of time.

    Parameters
    ----------
    tried : int
        Candidates that were tried in all.
    """
    criteria = validator.criteria
    if found.explained < criteria.smallest_error**2 or found.p_value(tried) > criteria.significance:
        return False
    if not found.worth_its_name:
        return False
    return block_test(validator, found.candidate) < criteria.block_p_value


def usable_candidates(
    validator: CrossValidator,
    places: Sequence[Sequence[Effect]],
    progress: Callable[[str], None] = lambda _: None,
    *,
    changed: bool = False,
) -> list[list[Candidate]]:
    """Candidates, shape by shape, that are not yet in the model and whose columns are finite and act on some row.

    A shape that these motions cannot show is left out. So is a coupling of joints where the torque of one is not known:
    half of a coupling is a torque that follows another joint's motion, whatever its cause. Errors of a recorded torque
    are no candidates where the torque was computed from commands. Nor is an effect that differs from one of the model
    only at standstill: whatever it explains there, dry friction may cause. Where the robot changed, the coefficients of
    the model are those from before. So an effect of the model is tried again as a change of itself (`Effect.changed`),
    and an effect may come beside changes of old parameters (`after_change`).

    All places are handled at once, because each call goes through all motions.

    Parameters
    ----------
    places : sequence of sequence of Effect
        Shapes of one effect in one place each.
    progress : callable, optional
    changed : bool
        Whether the robot changed, and the parameters of the model are those from before.
    """
    robot, measured = validator.model.robot, validator.data.cache.channels
    commanded = validator.model.controller is not None
    present, fitted = {c.name for c in validator.data.cache.regressor.columns}, set(validator.joints)

    def fresh(effect: Effect) -> bool:
        if (effect.of_recording and commanded) or not effect.shows_within(validator.data.cache.reach):
            return False
        if known_in_motion(effect, present, robot) and not (changed and effect.after_change):
            return False
        if len(effect.joints or ()) > 1 and not fitted.issuperset(effect.joints or ()):
            return False
        return measured.issuperset(effect.channels(robot)) and not has_names(effect, present, robot)

    tried = [[with_model_width(effect, validator.model.effects) for effect in shapes] for shapes in places]
    if changed:
        tried = [[as_a_change(effect, present, robot) for effect in shapes] for shapes in tried]
    kept = validator.screened([[effect for effect in shapes if fresh(effect)] for shapes in tried])
    found = iter(validator.candidates([effect for effects in kept for effect in effects], progress))
    return [[c for c in itertools.islice(found, len(effects)) if c.columns and c.finite] for effects in kept]


def has_names(effect: Effect, present: Set[str], robot: Robot) -> bool:
    """Whether some columns of an effect have the names of columns that are there already."""
    return not present.isdisjoint(column.name for column in effect.columns(robot))


def as_a_change(effect: Effect, present: Set[str], robot: Robot) -> Effect:
    """An effect, or the next change of it where a model whose columns have some names has the effect already.

    An effect that the model lacks is no change.
    """
    found = replace(effect, changed=0)
    while has_names(found, present, robot) and not isinstance(found, _CHANGES_HAVE_NAMES):
        before, found = found, replace(found, changed=found.changed + 1)
        if found.columns(robot) == before.columns(robot):  # a class that names its columns without `Effect.column`
            return before
    return found


def known_in_motion(effect: Effect, present: Set[str], robot: Robot) -> bool:
    """Whether a model whose columns have some names has an effect that is the same wherever the joint moves."""
    name = type(effect).same_in_motion
    return bool(name) and present >= {column.name for column in EFFECTS[name](joints=effect.joints).columns(robot)}


def with_model_width(effect: Effect, known: Sequence[Effect]) -> Effect:
    """The effect with the friction smoothing (width of tanh) of the model's dry friction, where it has such a width."""
    width = next((e.width for e in known if isinstance(e, Coulomb)), None)
    return effect if width is None else effect.with_sign_width(width)
