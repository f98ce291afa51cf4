"""The findings of a search: each scored effect, and the refit of all parameters, with the error they explain.

With E_j and E'_j the cross-validated NRMSE of joint j without and with the effect, and n_j that of the sensor noise, a
finding explains the share

    Σ_j (E_j² − E'_j²)  /  Σ_j (E_j² − n_j²)

of the error above the noise, over the joints j on which the effect acts. A refit of all parameters
is a finding too: it says that the identified parameters no longer hold.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from frischid.core.text import listed
from frischid.core.types import Array
from frischid.diagnosis.change_prior import weak_urdf_prior
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.effect_ranking import Ranking, ScoredEffect, ranking
from frischid.diagnosis.findings import OLD_PARAMETERS, Finding, joints_of, said_of, shape_of
from frischid.diagnosis.floor import Floor
from frischid.diagnosis.healthy_twin import HealthyTwin
from frischid.diagnosis.reversal_residuals import absent_in_motion, only_at_reversals
from frischid.effects import EFFECTS


class FoundEffects(NamedTuple):
    """What a search for missing effects found."""

    findings: list[Finding]
    """Best first."""
    ranking: Ranking
    noise: Array
    """Floor of each joint where the model with all effects that entered is known, N·m (N), (J,)."""


def find_effects(
    validator: CrossValidator,
    floor: Floor,
    situation: str,
    only: Sequence[str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> FoundEffects:
    """Score every effect that can act on this robot.

    Parameters
    ----------
    situation : {"always", "changed"}
        Effects that can only come later (a payload) are tried only where the robot changed.
    only : sequence of str, optional
        Identifiers to try, the whole catalogue by default.
    progress : callable, optional
    """
    kinds = [
        kind
        for name, kind in EFFECTS.items()
        if (only is None or name in only) and not (kind.change and situation == "always")
    ]
    ranked = ranking(validator, kinds, progress, changed=situation == "changed")
    noise = floor.under(ranked.full, ranked.entered)
    moving = ~only_at_reversals(validator, noise)
    floors = noise, floor.without_effects(noise)
    # The twin has the noise of the positions alone: what smooths nothing there smooths another error here.
    ranked = replace(ranked, smoothing=tuple(c for c in ranked.smoothing if floor.twin.explained([c.effect]) > 0))
    findings = [_finding(validator, floors, moving, effect, floor.twin) for effect in ranked.effects]
    return FoundEffects(findings, ranked, noise)


def _finding(
    validator: CrossValidator,
    floors: tuple[Array, Array],
    moving: NDArray[np.bool_],
    effect: ScoredEffect,
    twin: HealthyTwin,
) -> Finding:
    """A finding; `floors`: sensor noise of each joint, and the error of a perfect model's fit, N·m (N)."""
    before, after = validator.predictive_nrmse(), validator.nrmse(effect.score.predictive)
    noise, least = (floor / validator.spread for floor in floors)
    rows = list(effect.together.columns)
    seen = [row for row in rows if moving[row]]
    members = tuple(e for place in effect.places for e in place.candidate.effects)
    joints = joints_of(members)
    names = [c.name for e in members for c in e.columns(validator.model.robot)]
    shapes = {
        f"{k}_{n}" if len(effect.places) > 1 else k: v
        for n, place in enumerate(effect.places, 1)
        for k, v in shape_of(place.effect).items()
    }
    said = said_of(members)
    if effect.elsewhere:
        said += f". On {listed(effect.elsewhere, 'or')} instead, the same effect explains these logs nearly as well"
    return Finding(
        effect=effect.kind.id,
        joints=joints,
        error_before=float(before.mean()),
        error_after=float(after.mean()),
        gain=effect.gain,
        removed=effect.explained,
        share=explained_share(before[rows], after[rows], noise[rows], validator.criteria),
        floors=in_floors(before[seen], noise[seen]),
        over_twin=in_floors(before[seen or rows], least[seen or rows]),
        twin_removed=twin.explained(members) if effect.gain > 0 and (effect.entered or effect.rivals) else 0.0,
        p_value=effect.p_value,
        parameters=dict(zip(names, map(float, effect.score.beta), strict=True)) | shapes,
        confused_with=effect.rivals,
        sentence=said,
        members=members,
        criteria=validator.criteria,
        entered=effect.entered,
        own=effect.own.unique,
        elsewhere=effect.elsewhere,
        negligible=negligible(before[rows], noise[rows], validator.criteria),
        absent_in_motion=not seen and effect.gain > 0 and absent_in_motion(validator, effect.together, rows),
    )


def refit_finding(validator: CrossValidator, floor: Array) -> Finding:
    """The finding that the identified parameters no longer hold: all parameters are fitted to these logs alone.

    Parameters
    ----------
    validator : CrossValidator
        Fit with the identification as prior.
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N).
    """
    model, criteria = validator.model, validator.criteria
    refit = validator.with_prior(weak_urdf_prior(model, criteria))
    before, after = validator.base_predictive(), refit.base_predictive()
    ratio = validator.log_likelihood(before, after, np.maximum(validator.effective, refit.effective))
    parameters = len(model.base)
    gain = ratio - 0.5 * parameters * float(np.log(max(float(validator.counts.sum()), 2.0)))
    errors = validator.nrmse(before), validator.nrmse(after)
    noise = floor / validator.spread
    return Finding(
        effect=OLD_PARAMETERS,
        joints=(),
        error_before=float(errors[0].mean()),
        error_after=float(errors[1].mean()),
        gain=gain,
        removed=float((errors[0] ** 2 - errors[1] ** 2).sum()),
        share=explained_share(*errors, noise, criteria),
        floors=in_floors(errors[0], noise),
        over_twin=in_floors(errors[0], noise),
        twin_removed=0.0,
        p_value=float(special.chdtrc(parameters, 2 * ratio)) if gain > 0 else 1.0,
        parameters={},
        confused_with=(),
        sentence=(
            "the identified parameters no longer hold, and no single effect explains the change: several links or the "
            "friction changed; identify the robot again"
        ),
        members=(),
        criteria=criteria,
        negligible=negligible(errors[0], noise, criteria),
    )


def explained_share(before: Array, after: Array, noise: Array, criteria: DiagnosisCriteria) -> float:
    """Explained share of the squared error above the noise; zero where that error is negligible."""
    if negligible(before, noise, criteria):
        return 0.0
    return float(np.clip((before**2 - after**2).sum() / _above(before, noise), 0.0, 1.0))


def negligible(error: Array, noise: Array, criteria: DiagnosisCriteria) -> bool:
    """Whether the error above the noise is too small to be worth a parameter."""
    return _above(error, noise) <= criteria.smallest_error**2


def in_floors(error: Array, noise: Array) -> float:
    """The error in multiples of the noise."""
    return float(np.linalg.norm(error)) / max(float(np.linalg.norm(noise)), 1e-12)


def _above(error: Array, noise: Array) -> float:
    """Summed squared error above the noise."""
    return float((error**2 - np.minimum(noise, error) ** 2).sum())
