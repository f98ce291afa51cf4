"""Hypotheses against each other: which few faults explain a log's torques best.

Every hypothesis h is a set of faults. It is scored by a posterior,

    score(h) = Σ_j log L_j(h) − Σ_{faults} cost,        log L_j = −(n_j / 2) log(e_j² + e_URDF²),

where e_j is the error of joint j with the faults undone and friction fitted, n_j the number of independent samples, and
e_URDF the error that URDFs have anyway: below it, a smaller error proves nothing. A fault costs more if there are many
places for it, or if numbers are fitted (Schwarz 1978). The probability of the best hypothesis is
1 / (1 + Σ_r exp(score_r − score)), with its rivals r.

Faults of positions (`position_faults`) and of the robot (`robot_faults`) give other rigid torques. For each of them
the best faults of single torques follow row by row (`torque_faults`). Two such faults together are tried from the best
ones.

A fault of one torque can hide a fault of the robot, and the reverse. So faults of the robot are also fitted beside each
fault of a torque alone (`_alone`), and without each row in turn (`_without_one_row`). An answer is given only if no
other combination without it explains more, and says which of its faults the torques need (`Explanation.needed`). A
fault of positions has one more rival: positions that are right, and links that weigh something else than the URDF says
(`other_links`).

The likeliest hypothesis may hold more faults than can be named. Each part of it is judged by itself (`parts_of`). A
part is named if it explains half of the error of its rows. Fitted numbers and zeros, also those that are off by a
quarter turn, have one more rival: errors of the URDF's links, which every URDF has. These errors are the rival of all
the faults together and of each beside the others (`_lead_over_links`): a spring that is real must not vouch for a zero
that is not. A body, a spring or another zero of one joint explains most of the error of its rows where the links behind
that joint are wrong, and so would the right links.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.checks.faults import Fault, cost
from frischid.checks.hypothesis import POSITION_KINDS, Hypothesis, hypothesis_of, parts_of, separable, without
from frischid.checks.other_links import evidence_of_other_links
from frischid.checks.payload import LEAST_ERROR, evidence
from frischid.checks.position_faults import JOINT_ZERO, joint_faults, merged, position_faults
from frischid.checks.robot_faults import CARRIED_LOAD, robot_faults, shared_errors, shared_faults
from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import Sketch
from frischid.checks.torque_faults import local_fits
from frischid.core.types import Array

SHARED_KINDS = ("mounting", "no gravity", "payload", CARRIED_LOAD)
ROBOT_KINDS = (*SHARED_KINDS, "motor coupling")
LINK_ERRORS = (0.1, 0.2, 0.4, 0.8, 1.6)
"""Errors of links in URDFs (masses, and also centres of mass and inertias), standard deviations as shares of the
link: the likeliest of them is the rival of fitted numbers. So the list must not end before the likeliest one."""
WIDE_BEAM = 6
"""Hypotheses to which faults of the robot are added."""
SHARED_SAMPLES = 100
"""Samples on which hypotheses are compared before faults of the robot are added."""
BEAM = 3
"""Hypotheses from which further faults are tried."""


@dataclass(frozen=True)
class Explanation:
    """The best hypothesis, its probability against its rivals, the best one without all that the torques need.

    Rivals are the runner-up and, for faults whose numbers are fitted, errors of the URDF's links: `links` where these
    are likelier than the runner-up. The needed faults are those of the likeliest part of the best hypothesis with which
    the URDF explains every torque as well as a log must be explained. The others improve a torque that is explained
    already.
    """

    best: Hypothesis
    probability: float
    runner_up: Hypothesis | None
    needed: Hypothesis
    links: bool = False

    def odds(self, said: int) -> str:
        """The probability in words, beside how many faults that are named."""
        if self.links:
            against = "links that weigh something else than the URDF says"
        elif self.runner_up is None or not self.runner_up.faults:
            against = "no fault"
        else:
            against = " and ".join(f"{f.kind} of {', '.join(f.where) or 'the robot'}" for f in self.runner_up.faults)
        odds = f"probability {min(self.probability, 0.99):.2f} against {against}"
        return f"{odds} alone, if the other faults named here are real" if said > 1 else odds


def explain(sketch: Sketch, contradicted: Callable[[Sketch], bool] = lambda corrected: False) -> Explanation | None:
    """The best acceptable hypothesis about a log that the URDF does not explain; None without one.

    Parameters
    ----------
    contradicted : callable, optional
        Whether the torques speak against a log with faults undone, whatever the links weigh (`KinematicEvidence`).
    """
    null = Hypothesis((), RowFits(sketch).total(sketch.asis), sketch.asis, sketch)
    found = _tried(sketch, null)
    likeliest = max([*found, null], key=_score)
    found += [h for h in parts_of(likeliest) if h.faults]
    enough = sorted((h for h in found if h.key <= likeliest.key and _is_enough(h, null)), key=_score, reverse=True)
    fair = enough
    if any(map(_has_position_fault, enough)):
        rival = evidence_of_other_links(sketch) - cost(sketch.criteria, "wrong robot")
        fair = [h for h in enough if h.score > rival or not _has_position_fault(h)]
    best = next((h for h in fair if not contradicted(h.sketch)), None)
    if best is None:
        return None  # what explains the torques best is no fault that can be named: several gains, or too many faults
    others = [h for h in [*found, null] if not h.key >= best.key]
    runner = max(others, key=_score, default=None)
    reached = likeliest.score if best is enough[0] else best.score  # a part of a hypothesis that was refused
    gaps = np.array([np.inf if runner is None else reached - runner.score, _lead_over_links(best, null)])  # of rivals
    parts = [h for h in enough if h.key <= best.key and (h is best or _is_good(h))]
    needed, best = max(parts, key=_fewest_faults), replace(best, faults=_by_evidence(best))
    # One that has all that is named, and only lacks a fault that is not, is no rival to tell the user of.
    told = max((h for h in others if not h.key >= needed.key), key=_score, default=None)
    probability = float(1 / (1 + np.exp(np.clip(-gaps, -50, 50)).sum()))
    return Explanation(best, probability, told, needed, bool(gaps[1] < gaps[0]))


def _tried(sketch: Sketch, null: Hypothesis) -> list[Hypothesis]:
    """All hypotheses that are tried: each fault, and further ones beside the best, where a better one is possible."""
    fits = RowFits(sketch)
    found = _readings(fits, ())
    for item in position_faults(sketch):
        found += _readings(RowFits(item.sketch, fits), (item.fault,))
    starts = [null, *_alone(sketch, found[0]), *_best(found), *_readings(fits, (), simple=True)]
    found += [*_of_the_robot(starts), *_without_one_row(sketch)]
    found += _of_the_robot(h for h in found if len(h.faults) == 1 and h.faults[0].kind in SHARED_KINDS)
    so_far = max([*found, null], key=_score)
    least = min((f.cost for f in so_far.faults), default=0.0)
    if _lead_without_faults(so_far) - least <= np.log(sketch.criteria.least_odds):
        return found  # a single fault that explains everything would be no better
    found += [*_two_of_positions(found, so_far), *(hypothesis_of((x.fault,), x.sketch) for x in joint_faults(sketch))]
    behind = _behind_the_robot(found)
    found += (shared := _of_the_robot([*behind, *_best(h for h in found if _has_robot_fault(h))]))
    found += _of_the_robot(_best(h for h in shared if h.faults[-1].kind in SHARED_KINDS))
    found += _of_the_robot(_best(h for h in found if len(h.faults) == 2 and _has_robot_fault(h)))
    return found


def _two_of_positions(found: Sequence[Hypothesis], so_far: Hypothesis) -> list[Hypothesis]:
    """The best hypotheses with a further fault of positions, where this may give a rival of the likeliest so far."""
    lead, odds = _lead_without_faults(so_far), np.log(so_far.sketch.criteria.least_odds)
    more = []
    for start in _best(found):
        begun = RowFits(start.sketch)
        for item in position_faults(start.sketch):
            faults = (*start.faults, item.fault)
            if (item.fault.kind, item.fault.where) in start.key:
                continue  # undone twice is as it was
            if lead - _price(faults) > -odds or _with_merged(faults, item.sketch) > so_far.score - odds:
                more += _readings(RowFits(item.sketch, begun), faults)
    return more


def _score(hypothesis: Hypothesis) -> float:
    return hypothesis.score


def _fewest_faults(hypothesis: Hypothesis) -> tuple[int, float]:
    return -len(hypothesis.faults), hypothesis.score


def _best(found: Iterable[Hypothesis]) -> list[Hypothesis]:
    """The best few different hypotheses."""
    kept: dict[frozenset[tuple[str, tuple[str, ...]]], Hypothesis] = {}
    for hypothesis in sorted(found, key=_score, reverse=True):
        kept.setdefault(hypothesis.key, hypothesis)
        if len(kept) == BEAM:
            break
    return list(kept.values())


def _behind_the_robot(found: Iterable[Hypothesis]) -> list[Hypothesis]:
    """The best few hypotheses, if gravity and a body on the last link are fitted beside each.

    A fault of the robot may hide how good a fault of the positions is. One fit of all that the rows share shows this.
    """
    kept: dict[frozenset[tuple[str, tuple[str, ...]]], tuple[float, Hypothesis]] = {}
    for hypothesis in sorted(found, key=_score, reverse=True):
        if (
            _has_position_fault(hypothesis)
            and hypothesis.key not in kept
            and not any(f.torque is not None for f in hypothesis.faults)
        ):
            errors = shared_errors(hypothesis.sketch.thinned(SHARED_SAMPLES))
            score = RowFits(hypothesis.sketch).total(errors) - sum(f.cost for f in hypothesis.faults)
            kept[hypothesis.key] = score, hypothesis
    return [h for _, h in sorted(kept.values(), key=lambda x: -x[0])[:WIDE_BEAM]]


def _lead_without_faults(likeliest: Hypothesis) -> float:
    """Score over the likeliest hypothesis, if one without faults explained all that proves anything.

    A row's likelihood rises a little further below the error that URDFs have anyway (`RowFits.value`).
    """
    fits = RowFits(likeliest.sketch)
    explained = fits.total(np.minimum(likeliest.errors, fits.criteria.urdf_error))
    return explained - fits.total(likeliest.errors) + sum(f.cost for f in likeliest.faults)


def _price(faults: Iterable[Fault]) -> float:
    """Cost of faults of which one is of positions: those of the torques may be the same fault."""
    return sum(f.cost for f in faults if f.kind not in ("torque sign", "swapped torques"))


def _with_merged(faults: Sequence[Fault], sketch: Sketch) -> float:
    """Score of some faults that a sketch holds undone, each fault of positions and torques together counted once."""
    return hypothesis_of(tuple(faults), sketch).score + merged(faults, len(sketch.rows), sketch.criteria)[1]


def _has_position_fault(hypothesis: Hypothesis) -> bool:
    return any(f.kind in POSITION_KINDS for f in hypothesis.faults)


def _has_robot_fault(hypothesis: Hypothesis) -> bool:
    return any(f.kind in ROBOT_KINDS for f in hypothesis.faults)


def _readings(fits: RowFits, faults: tuple[Fault, ...], *, simple: bool = False) -> list[Hypothesis]:
    """The best readings of the torques, with some faults undone already."""
    sketch = fits.sketch
    paid = sum(f.cost for f in faults)
    plain = sketch.errors(sketch.nominal)
    found = [Hypothesis(faults, fits.total(plain) - paid, plain, sketch)] if faults else []
    for local in local_fits(fits, simple=simple):
        nominal = sketch.nominal
        if local.springs:
            nominal = nominal.copy()
            for j, torque in local.springs.items():
                nominal[:, j] += torque
        read = replace(sketch, tau=local.tau, given_nominal=nominal)
        together, refund = merged((*faults, *local.faults), len(fits.rows), sketch.criteria)
        found.append(Hypothesis(together, local.score - paid + refund, local.errors, read))
    return found


def _of_the_robot(starts: Iterable[Hypothesis]) -> list[Hypothesis]:
    found = []
    for start in starts:
        for item in robot_faults(start.sketch):
            if item.fault.kind in {f.kind for f in start.faults}:
                continue
            found.append(hypothesis_of((*start.faults, item.fault), item.sketch))
    return found


def _alone(sketch: Sketch, reading: Hypothesis) -> list[Hypothesis]:
    """Each fault of a reading of the torques without the others, which may be taking up a fault of the robot."""
    rows = dict(zip(sketch.names, sketch.rows, strict=True))
    found, springs = [], reading.sketch.nominal - sketch.nominal
    for fault in reading.faults:
        columns = [rows[name] for name in fault.where if name in rows]
        tau, nominal = sketch.tau.copy(), sketch.nominal.copy()
        tau[:, columns] = reading.sketch.tau[:, columns]
        nominal[:, columns] += springs[:, columns]
        found.append(hypothesis_of((fault,), replace(sketch, tau=tau, given_nominal=nominal)))
    return found


def _by_evidence(hypothesis: Hypothesis) -> tuple[Fault, ...]:
    """Its faults, first those without fitted numbers, then those without which the torques are explained worst."""
    scores = {frozenset(h.key): h.score for h in parts_of(hypothesis)}

    def left(fault: Fault) -> float:
        return scores.get(hypothesis.key - {(fault.kind, fault.where)}, -np.inf)

    return tuple(sorted(hypothesis.faults, key=left))


def _without_one_row(sketch: Sketch) -> list[Hypothesis]:
    """Faults of the whole robot as the torques of all joints but one show them; then the best reading of all torques.

    A spring hides a payload, and a payload a spring. But one wrong torque cannot hide what all others show.
    """
    found: list[Hypothesis] = []
    for left_out in sketch.rows if len(sketch.rows) > 2 else ():
        for item in shared_faults(RowFits(replace(sketch, rows=sketch.rows[sketch.rows != left_out]))):
            found += _readings(RowFits(replace(item.sketch, rows=sketch.rows)), (item.fault,))
    return found


def _is_enough(hypothesis: Hypothesis, null: Hypothesis) -> bool:
    """Whether a hypothesis explains most of the error of the rows that it changes, and is worth its cost."""
    criteria = null.sketch.criteria
    if not hypothesis.faults or hypothesis.score - null.score < np.log(criteria.least_odds):
        return False
    if sum(fault.kind == "torque scale" for fault in hypothesis.faults) > 1:
        return False  # several factors are a mistake of another kind
    if sum(fault.kind != "torque sign" for fault in hypothesis.faults) > criteria.most_faults:
        return False  # so many faults explain anything
    before, after = (np.minimum(x, criteria.nrmse_cap) for x in (null.errors, hypothesis.errors))
    if len(before) != len(after):
        return False
    changed = np.abs(before - after) > criteria.changed_nrmse
    removed = 1 - float(np.sum(after[changed] ** 2)) / max(float(np.sum(before[changed] ** 2)), 1e-12)
    if not changed.any() or removed <= criteria.discrete_share:
        return False
    return _lead_over_links(hypothesis, null) > math.log(criteria.least_odds)


def _lead_over_links(hypothesis: Hypothesis, null: Hypothesis) -> float:
    """Least score of a hypothesis over fewer of its faults, if the URDF's links have errors in both cases.

    Fewer are none, and all but one of those that these logs can show beside the others (`separable`). Infinite for
    faults without a fitted number.
    """
    if all(f.discrete and f.kind != JOINT_ZERO for f in hypothesis.faults):
        return np.inf
    fitted = [f for f in separable(hypothesis) if not f.discrete or f.kind == JOINT_ZERO]
    fewer = [null, *(without(hypothesis, [f]) for f in fitted if len(hypothesis.faults) > 1)]
    noise = np.maximum(hypothesis.errors, LEAST_ERROR)
    best = _evidence_with_links(hypothesis, noise)
    return min(best - _evidence_with_links(rival, noise) for rival in fewer)


def _evidence_with_links(hypothesis: Hypothesis, noise: Array) -> float:
    """Evidence of a hypothesis beside errors of the links; of their sizes the likeliest counts (empirical Bayes).

    Parameters
    ----------
    noise : ndarray, shape (R,)
        NRMSE of the rows' own noise.
    """
    sketch, weight = hypothesis.sketch, RowFits(hypothesis.sketch).weight
    likeliest = max(evidence(sketch, noise, weight, s, sketch.criteria.nrmse_cap) for s in LINK_ERRORS)
    return likeliest - sum(f.cost for f in hypothesis.faults)


def _is_good(hypothesis: Hypothesis) -> bool:
    return bool((hypothesis.errors < hypothesis.sketch.criteria.bad_nrmse).all())
