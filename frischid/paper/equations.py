"""The paper's equations and theorems in their order: what each claims, what is found, and whether it holds.

Equations have the paper's numbers where the numbers are known here. Each line is a computation of this run, not a
quotation: the reduction is that of the URDF's arm, and the shares of runs are those of the Monte Carlo study.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from frischid.core.types import Array
from frischid.paper.author_points import AuthorPoints
from frischid.paper.monte_carlo import StudyRun
from frischid.paper.paper_tables import CORRECTED, PUBLISHED, PaperTable
from frischid.paper.planar_arm import PlanarArm, points_arm, reduction, regrouping_error, study_arm
from frischid.paper.printed import COUNTS
from frischid.regression.regressor import nominal_parameters

_SAME_TORQUE = 1e-9
"""Share of the largest torque below which two torques count as equal."""


def equation_table(points: AuthorPoints, published: Sequence[StudyRun], corrected: Sequence[StudyRun]) -> PaperTable:
    """Check every equation at the points and over the runs.

    Parameters
    ----------
    published, corrected : sequence of StudyRun
        Either may be empty; its claims are then left out.
    """
    arm = points_arm(as_published=False)
    studies = [(PUBLISHED, study_arm(as_published=True), published), (CORRECTED, arm, corrected)]
    held = [(name, its, runs) for name, its, runs in studies if runs]
    rows = [
        _linear(arm, points),
        *(_theorem_1(name, runs) for name, _, runs in held),
        _counts(arm),
        *(_regrouping(points, printed=each) for each in (True, False)),
        _choice(arm),
        ("(19)", "cost of exciting points: λ1 cond + λ2 / σ_min + ψ", "Table 2", "see there"),
        *(_algorithm_1(name, its, runs) for name, its, runs in held),
        *(_selection(name, its, runs) for name, its, runs in held),
        *(_squared(name, its, runs) for name, its, runs in held),
    ]
    notes = (
        "Eq. (16) fails because the relations of the second decomposition already account for the dependent columns: "
        "Γ_l2 = Γ_l1 B, so Γ θ = Γ_l1 (θ_l1 + B θ_l2), and Γ_d = Γ_l1.",
        "Theorem 1 is right, but what it asks for, ten solutions in one orthant, does not happen: friction is too weak "
        "against the noise. Its box is then no guarantee.",
        "Algorithm 1 takes moments of a window for exact. They are samples, and the worst of thousands of windows "
        "decides.",
    )
    numbers = {"rows": [dict(zip(("equation", "says", "found", "holds"), row, strict=True)) for row in rows]}
    return PaperTable("Equations", ("", "claim", "found", "holds"), tuple(rows), 4, notes, numbers)


def _linear(arm: PlanarArm, points: AuthorPoints) -> tuple[str, ...]:
    robot = arm.regressor.robot
    rigid = [column.effect == "rigid" for column in arm.regressor.columns]
    Y = arm.regressor(points.t, points.q, points.v, points.a)[:, rigid]
    theta = nominal_parameters(robot, arm.regressor.effects)[rigid]
    direct = robot.inverse_dynamics(points.q, points.v, points.a)
    error = float(np.abs(np.einsum("ncj,c->nj", Y, theta) - direct).max() / np.abs(direct).max())
    found = f"apart by {error:.0e} of the torque"
    return ("τ = Γ θ", "torque is linear in the parameters", found, _yes(error < _SAME_TORQUE))


def _theorem_1(name: str, runs: Sequence[StudyRun]) -> tuple[str, ...]:
    backed, n = sum(run.same_orthant for run in runs), len(runs)
    claim = f"Frisch: p + 1 solutions in one orthant ({name})"
    holds = "its condition never does" if not backed else f"its condition does in {100 * backed / n:.0f} %"
    return ("Theorem 1", claim, f"one orthant in {backed} of {n} runs", holds)


def _counts(arm: PlanarArm) -> tuple[str, ...]:
    found = reduction(arm)
    known = len(arm.regressor.robot.known)
    ours = {
        "rank": found.rank,
        "identifiable alone": len(found.absolute),
        "not identifiable": len(found.none) + known,
        "identifiable together": len(found.linear),
    }
    claim = ", ".join(f"{name} {count}" for name, count in COUNTS.items())
    return ("(11) to (15)", claim, ", ".join(map(str, ours.values())), _yes(ours == COUNTS))


def _regrouping(points: AuthorPoints, *, printed: bool) -> tuple[str, ...]:
    error = regrouping_error(points_arm(as_published=printed), points.t, points.q, points.v, points.a)
    claim = "Γ_d = Γ_l1 − Γ_l2 (V21 V22⁻¹)ᵀ" if printed else "Γ_d = Γ_l1"
    number = f"(16) {PUBLISHED if printed else CORRECTED}"
    found = f"torque wrong by {error:.0%}" if printed else f"torque apart by {error:.0e}"
    return (number, claim, found, _yes(error < _SAME_TORQUE))


def _choice(arm: PlanarArm) -> tuple[str, ...]:
    found = reduction(arm)
    names = {found.columns[i].name for i in found.dependent}
    claim = "dependent columns by α1 cond V22 + α2 / |det V22|: m1, m2, I1m"
    return ("(17)", claim, f"found {', '.join(sorted(names))}", _yes(names == set(arm.dependent)))


def _algorithm_1(name: str, arm: PlanarArm, runs: Sequence[StudyRun]) -> tuple[str, ...]:
    empty, right, n = sum(r.contradicted for r in runs), sum(r.last.contains(arm.theta) for r in runs), len(runs)
    how = "steps undone" if name == PUBLISHED else "calibrated"
    found = f"bounds cross in {empty} of {n} runs; {how}, the box holds the truth in {right}"
    return ("Algorithm 1", f"BBRF: the bounds close in on the truth ({name})", found, _yes(empty == 0 and right == n))


def _selection(name: str, arm: PlanarArm, runs: Sequence[StudyRun]) -> tuple[str, ...]:
    ratio = _ratio(arm, runs, "selected", "least_squares")
    claim = f"min ‖Wθ − τ‖ + ‖θ‖ in the box ({name})"
    return ("(24)", claim, f"error {ratio:.2f} × that of least squares", "better" if ratio < 1 else "not better")


def _squared(name: str, arm: PlanarArm, runs: Sequence[StudyRun]) -> tuple[str, ...]:
    ratio = _ratio(arm, runs, "squared", "selected")
    claim = f"ours in its place: min ‖Wθ − τ‖² in the box ({name})"
    verdict = "better" if ratio < 0.995 else "worse" if ratio > 1.005 else "the same"
    return ("(24), squared", claim, f"error {ratio:.3f} × that of (24)", verdict)


def _ratio(arm: PlanarArm, runs: Sequence[StudyRun], ours: str, other: str) -> float:
    """Geometric mean over the parameters of the ratio of root mean square errors."""
    kept = [run for run in runs if not run.discarded] or list(runs)
    first, second = (_rms(np.array([getattr(run, name) for run in kept]) - arm.theta) for name in (ours, other))
    return float(np.exp(np.log(first / second).mean()))


def _rms(error: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(error**2, axis=0)))


def _yes(holds: bool) -> str:
    return "yes" if holds else "no"
