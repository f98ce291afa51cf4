"""None, effect, contact or unknown: what the findings come to.

Unknown is said where more is left on some joint, with all that pass in the model, than the best finding removes, or
where a stranger to the catalogue describes far more than that finding explains (see `description`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from frischid.core.text import each_of, listed
from frischid.core.types import Array
from frischid.diagnosis.contacts import Contact
from frischid.diagnosis.cross_validation import Evidence
from frischid.diagnosis.findings import ABOVE, HALF, Finding
from frischid.diagnosis.residual_formula import Description, Stranger
from frischid.diagnosis.reversal_residuals import at_rest
from frischid.diagnosis.stepwise_selection import TRIFLE, Ranking

Verdict = Literal["none", "effect", "contact", "unknown"]
Known = Literal["always", "changed"]
LARGE = 0.01  # of a joint's torque: an error below this is not called unexplained
BESIDE = 1.5  # noise floors: the same where a finding acts, and leaves more than it removes
REMAINDER = 4.0  # times what a finding removes: may be left elsewhere, if half is removed where it acts
BEATEN = 1.5  # what a refit must remove over what the best single effect removes


def decided(
    evidence: Evidence,
    floor: Array,
    findings: Sequence[Finding],
    contacts: Sequence[Contact],
    judged: Ranking,
    stranger: Stranger | None,
) -> Verdict:
    """Unknown: more is left on some joint, with all that pass in the model, than the best finding removes.

    A finding that removes half of what is wrong where it acts stands beside a larger remainder elsewhere; what dry
    friction leaves where a joint turns or rests does not count. Or what is a stranger to the catalogue describes far
    more than the best finding explains.
    """
    if contacts:
        return "contact"
    sure = [f for f in findings if f.significant]
    noise = floor / evidence.spread
    left = judged.full.nrmse(judged.full.base_sse())
    left = np.minimum(left, evidence.nrmse(evidence.base_sse()))  # a finding on one joint may cost another a little
    there = _seen(left, noise)
    if sure:
        where = np.array([not sure[0].joints or name in sure[0].joints for name in evidence.joints])
        there |= where & (left > TRIFLE) & (left > BESIDE * noise)
    there &= ~at_rest(judged.full, floor)
    unexplained = float(np.where(there, left**2 - noise**2, 0.0).max())
    if not sure:
        return "unknown" if unexplained > 0 else "none"
    bar = max(f.removed for f in sure) * (REMAINDER if sure[0].share > HALF else 1.0)
    return "unknown" if unexplained > bar or stranger is not None else "effect"


def _seen(left: Array, noise: Array) -> NDArray[np.bool_]:
    """Joints on which so much is left that it has to be explained."""
    return np.asarray((left > LARGE) & (left > ABOVE * noise))


def notes_on(
    evidence: Evidence,
    state: Known,
    verdict: Verdict,
    description: Description | None,
    stranger: Stranger | None,
    judged: Ranking,
    floor: Array,
    findings: Sequence[Finding],
) -> list[str]:
    """What to tell beside the verdict: the situation it is judged in, and what it rests on."""
    notes = [f"taken as a robot that {'changed since it was identified' if state == 'changed' else 'was always so'}"]
    lost = [n for n, error in zip(evidence.joints, evidence.nrmse(evidence.base_sse()), strict=True) if error > 1.0]
    if lost:
        notes.append(
            f"the rest of these logs predicts {listed(lost)} worse than a constant torque would: they are too short or "
            "move too little to judge the model by; take longer ones"
        )
    seen = _seen(judged.full.nrmse(judged.full.base_sse()), floor / judged.full.spread)
    if verdict == "none" and seen.any():  # or it would be unknown: all of it is at rest
        where = each_of([name for name, here in zip(judged.full.joints, seen, strict=True) if here])
        notes.append(f"what is left on {where} is where it turns or rests, where dry friction is anybody's guess")
    withheld = next((f for f in findings if f.sure and f.withheld), None)
    if verdict == "none" and withheld is not None:
        where = listed(withheld.joints) or "the robot"
        notes.append(f"more than chance, yet not called missing: {withheld.effect} on {where}; {withheld.withheld}")
    if judged.full.missed.any():
        notes.append("not the model's own logs: what explains more than was missing on those comes first")
    if description is not None and stranger is not None:
        where, first = judged.full.joints[stranger.row], judged.effects[0].kind.id
        notes.append(f"on {where} {stranger.words} describes far more than {first} explains, so that is not the cause")
    return notes + ([str(description)] if description is not None else [])


def with_refit(verdict: Verdict, findings: list[Finding], refit: Finding) -> tuple[Verdict, list[Finding]]:
    """A refit is the answer only where no effect is one; a refit can swallow any payload into the last link."""
    if not refit.significant:
        return verdict, findings
    best = next((f for f in findings if f.significant), None)
    beaten = best is None or (refit.gain > best.gain and refit.removed > BEATEN * best.removed)
    if verdict != "contact" and refit.share > HALF and (verdict == "unknown" or beaten):
        return "effect", [refit, *findings]
    better = [f for f in findings if f.removed >= refit.removed] or findings[:1]
    return verdict, [*better, refit, *(f for f in findings if f not in better)]


def with_verdict(findings: Sequence[Finding], verdict: Verdict, error: float) -> tuple[Finding, ...]:
    """With contact or unknown the first finding has that id."""
    if verdict not in {"contact", "unknown"}:
        return tuple(findings)
    sentence = {
        "contact": "something touched the robot for a while: these moments are left out, not modelled",
        "unknown": "something is missing that nothing in the catalogue explains",
    }[verdict]
    first = Finding(verdict, (), error, error, 0.0, 0.0, 0.0, 0.0, 1.0, {}, (), sentence, ())
    return (first, *findings)
