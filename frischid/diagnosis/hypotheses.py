"""The hypotheses of a diagnosis, and the evidence for each in a few numbers.

At least one of these hypotheses is true of the logs:

- *effect*: the robot has an effect of the catalogue, and the model lacks this effect (a hypothesis for each finding);
- *none*: nothing is missing, the error is that of the sensors;
- *several*: several small effects, none of which dominates;
- *outside*: something that is not in the catalogue;
- *contact*: something touched the robot for a while.

The evidence of a hypothesis h is a vector x_h of named numbers, which the stages before have measured. `probability`
turns the evidence of all hypotheses into probabilities that sum to one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.findings import Finding
from frischid.effects import EFFECTS

OTHERS = ("none", "several", "outside", "contact")
"""Hypotheses beside the findings."""
_ROUNDED = 1e-6  # relative difference of two results that is rounding
_LEAST_LOG = -5.0  # log ratio below which a smaller part says nothing more

_OF_KIND = ("searched", "refit")  # numbers of an effect and its shape, not of its fit


@dataclass(frozen=True)
class Evidence:
    """Evidence of every hypothesis."""

    names: tuple[str, ...]
    """The effect of each finding that may be the cause, then `OTHERS`."""
    values: tuple[Mapping[str, float], ...]
    """Numbers of each hypothesis; a number that is absent is zero."""

    def to_dict(self) -> list[dict[str, Any]]:
        """Plain JSON values, hypothesis by hypothesis."""
        return [{"hypothesis": n, **v} for n, v in zip(self.names, self.values, strict=True)]


def possible(findings: Sequence[Finding]) -> list[Finding]:
    """Findings that may be the cause: their evidence is more than its price, and more than the healthy twin has.

    Where a joint sticks as it reverses, many effects explain a part of that error. None of them is its cause: dry
    friction, which every joint has, is undetermined there.
    """
    return [f for f in findings if f.more_than_noise and not f.dry_friction_instead]


def evidence_of(
    findings: Sequence[Finding],
    error: tuple[Array, Array],
    floors: tuple[Array, Array],
    verdict: str,
    *,
    unmodelled: bool,
) -> Evidence:
    """Collect the evidence.

    Parameters
    ----------
    findings : sequence of Finding
        Best first, the refit of all parameters included.
    error : tuple of ndarray, shape (J,)
        Cross-validated NRMSE of each joint, without any finding and with all effects that entered.
    floors : tuple of ndarray, shape (J,)
        NRMSE of the sensor noise, and that of the healthy twin where the latter is larger.
    verdict : str
        Verdict of the rules, with the error of the healthy twin as the floor.
    unmodelled : bool
        Whether a term outside the catalogue explains far more than the first finding.
    """
    before, after = error
    noise, least = floors
    above = float(np.maximum(before**2 - noise**2, 0.0).sum())
    total = max(above, 1e-12)
    left = float(np.maximum(np.minimum(after, before) ** 2 - noise**2, 0.0).sum()) / total
    clear = float(np.log(max(float((before / np.maximum(least, 1e-12)).max()), 1.0)))
    size = float(np.log10(max(float(before.max()), 1e-6)))
    causes = possible(findings)
    own = np.array([f.own for f in causes])
    named = {name for f in causes[:1] for name in f.confused_with}
    values = [
        _of_finding(f, f is causes[0] and f.entered, f.effect in named, float(own.max()), causes, total) for f in causes
    ]
    same = [k for k, f in enumerate(causes) if _same_columns(causes[0], f)]
    for k in same:  # whichever stands first stands there by chance
        values[k] = values[0] | {name: values[k][name] for name in _OF_KIND}
    alike = [v for v in values if v["first"] or v["rival"]]  # the data cannot tell these apart
    for v in alike:  # so the one with fewer shapes to choose from is likelier
        v["more shapes"] = v["searched"] - min(x["searched"] for x in alike)
    for k in same if verdict == "effect" else ():
        values[k]["named"] = 1.0
    best = max((np.log10(1 + f.gain) for f in causes if f.sure), default=0.0)
    dominance = float(own.max() / own.sum()) if own.sum() > 0 else 0.0
    entered = float(sum(f.entered for f in causes))
    common = {"clear": clear, "gain": float(best), "left": left}
    none = {
        "none": 1.0,
        **{f"none {k}": x for k, x in common.items()},
        "none size": size,
        "none verdict": float(verdict == "none"),
    }
    several = {
        "several": 1.0,
        **{f"several {k}": x for k, x in common.items()},
        "several dominance": dominance,
        "several entered": float(np.log1p(entered)),
        "several size": size,
    }
    outside = {"outside": 1.0, **{f"outside {k}": x for k, x in common.items()}, "outside term": float(unmodelled)}
    outside["outside verdict"] = float(verdict == "unknown")
    contact = {"contact": 1.0, "contact found": float(verdict == "contact")}
    return Evidence((*(f.effect for f in causes), *OTHERS), (*values, none, several, outside, contact))


def _same_columns(one: Finding, other: Finding) -> bool:
    """Whether two effects have the same columns on these logs, as a tilt and a zero of a planar arm: same evidence."""
    pairs = ((one.removed, other.removed), (one.gain, other.gain))
    return all(abs(a - b) <= _ROUNDED * max(abs(a), abs(b)) for a, b in pairs)


def _of_finding(
    f: Finding, first: bool, rival: bool, most_own: float, causes: Sequence[Finding], total: float
) -> dict[str, float]:
    most = max(x.removed for x in causes)
    searched = max((int(np.prod([len(v) for v in m.searched.values()], initial=1.0)) for m in f.members), default=1)
    return {
        "effect": 1.0,
        "first": float(first),
        "significant": float(f.beyond_twin),
        "entered": float(f.entered),
        "rival": float(rival),
        "own": _log_ratio(f.own, most_own),
        "alone": _log_ratio(f.removed, most),
        "share": f.share,
        "whole": min(f.removed / total, 1.0),
        "clear": float(np.log(max(f.over_twin, 1.0))),
        "gain": float(np.log10(1 + f.gain)),
        "searched": float(np.log(searched)),
        "refit": float(f.effect not in EFFECTS),
    }


def _log_ratio(part: float, whole: float) -> float:
    return float(np.clip(np.log(part / whole), _LEAST_LOG, 0.0)) if part > 0 and whole > 0 else _LEAST_LOG
