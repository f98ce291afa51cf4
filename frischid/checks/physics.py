"""Whether the torques are those of this robot: wrong signs, exchanged columns, degrees, payloads, another robot.

A log is accepted when the nominal URDF with fitted friction explains its torques. Otherwise each simple mistake in the
log is corrected in turn, on the `Sketch`. The simplest mistake whose correction explains nearly all of the error is
named. A payload, or a missing hand, is an additional or missing body on the last link (`frischid.checks.payload`). If
no mistake explains the error, the URDF may be that of another robot: then the URDF's rigid part predicts nothing, while
freely fitted parameters of the same joints predict the torque.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from frischid.checks.log_issue import Notebook, span
from frischid.checks.payload import check_payload, payload_errors
from frischid.checks.sketch import Sketch, shared_fit
from frischid.core.types import Array
from frischid.robot.robot import Robot

_MILD_KINDS = ("torque scale", "mounting")  # an identification is still useful in spite of these mistakes


@dataclass(frozen=True)
class Fix:
    """A possible mistake in the log, and the log with this mistake corrected.

    Attributes
    ----------
    kind, what, where, advice
        As in `LogIssue`.
    sketch : Sketch
        The log with the mistake corrected.
    touched : ndarray of bool, shape (R,), or None
        The judged joints whose error the mistake can change; None: all.
    order : int
        Rank of the mistake; simpler mistakes have lower ranks.
    """

    kind: str
    what: str
    where: tuple[str, ...]
    advice: str
    sketch: Sketch
    touched: NDArray[np.bool_] | None
    order: int

    def removes(self, before: Array) -> float:
        """Share of the touched joints' squared error that the correction explains."""
        touched = np.ones(len(before), bool) if self.touched is None else self.touched
        cap = self.sketch.criteria.nrmse_cap
        old, new = squared(before[touched], cap), squared(self.sketch.asis[touched], cap)
        return float(1 - new / max(old, 1e-12))


def squared(errors: Array, cap: float) -> float:
    """Sum of squared NRMSEs; an NRMSE above the cap counts as the cap."""
    return float(np.sum(np.minimum(errors, cap) ** 2))


def _error(sketch: Sketch) -> float:
    """Squared error of the URDF with fitted friction, summed over all judged joints."""
    return squared(sketch.asis, sketch.criteria.nrmse_cap)


def check_physics(sketch: Sketch, free: Callable[[], Array], notes: Notebook) -> Sketch:
    """Compare the torques with the nominal URDF, and name the mistakes that explain a bad fit.

    Parameters
    ----------
    sketch : Sketch
    free : callable
        Returns the NRMSE of freely fitted base parameters on the judged joints, (R,), NaN where unknown; called only
        when needed.
    notes : Notebook

    Returns
    -------
    Sketch
        The log, reduced to the joints whose torques the URDF explains.
    """
    if not sketch.robot.nominal.any():
        notes.facts["nominal"] = "the URDF has no inertials: torques cannot be compared with it"
        return sketch
    few = sketch.thinned(sketch.criteria.few_samples)
    fixes = explanation(few) if (sketch.excess > notes.criteria.bad_nrmse).any() else []
    removed = 1 - _error(fixes[-1].sketch) / _error(few) if fixes else 0.0
    equal = notes.criteria.equal_share
    odds = -equal if any(fix.kind == "torque scale" for fix in fixes) else equal
    if not fixes or payload_errors(few).removed >= removed + odds:
        if not check_payload(sketch, notes):
            _unexplained(sketch, free, notes)
        return sketch
    for fix in fixes:
        notes.add(fix.kind, fix.what, fix.where, "likely", fix.advice, blocks=fix.kind not in _MILD_KINDS)
    if not check_payload(fixes[-1].sketch, notes):
        _unexplained(fixes[-1].sketch, free, notes)
    wrong = {name for fix in fixes for name in (sketch.names if fix.touched is None else fix.where)}
    return sketch.with_(
        rows=np.array([j for j, n in zip(sketch.rows, sketch.names, strict=True) if n not in wrong], int)
    )


def explanation(sketch: Sketch) -> list[Fix]:
    """Fewest mistakes that explain the error of the nominal URDF; each is searched with all earlier ones corrected."""
    before, criteria = sketch.asis, sketch.criteria
    enough, limit = criteria.explained_share, criteria.bad_nrmse
    whole = [fix for fix in global_fixes(sketch) if fix.removes(before) > enough]
    local: list[Fix] = []
    done = sketch
    while len(local) < len(before):
        now = done.asis
        found = [
            fix
            for fix in local_fixes(done, np.flatnonzero(done.excess > limit))
            if fix.removes(now) > enough and (fix.sketch.excess[fix.touched] < limit).all()
        ]
        if not found:
            break
        local.append(_simplest(found, now))
        done = local[-1].sketch
    # Several torques with different factors are a mistake of another kind, which stays unexplained here.
    if sum(fix.kind == "torque scale" for fix in local) > 1:
        local, done = [], sketch
    if not whole:
        return local
    best = _simplest(whole, before)
    odds = 1 if len(local) == 1 else -1  # two mistakes must explain more than one
    better = _error(done) < _error(best.sketch) + odds * criteria.equal_share * _error(sketch)
    return local if local and better else [best]


def _simplest(fixes: Sequence[Fix], before: Array) -> Fix:
    """The simplest of the fixes that are nearly as good as the best."""
    criteria = fixes[0].sketch.criteria
    whole = squared(before, criteria.nrmse_cap)
    removed = [whole - _error(fix.sketch) for fix in fixes]
    near = max(removed) - criteria.equal_share * whole
    return min(
        (fix for fix, share in zip(fixes, removed, strict=True) if share >= near),
        key=lambda fix: (fix.order, _error(fix.sketch)),
    )


def local_fixes(sketch: Sketch, bad: Sequence[int] | NDArray[np.intp]) -> Iterator[Fix]:
    """Correct mistakes in the torques of one joint or two: a sign, an exchange, a scale."""
    names = sketch.names

    def touched(*ks: int) -> NDArray[np.bool_]:
        return np.isin(np.arange(len(names)), ks)

    for k in map(int, bad):
        tau = sketch.tau.copy()
        tau[:, sketch.rows[k]] *= -1
        advice = "set torque_sign = -1 for it in a mapping file, or check the sign of its current gain"
        what = "the torque has the wrong sign: with the sign changed, the model explains the torque"
        yield Fix("torque sign", what, (names[k],), advice, sketch.with_(tau=tau), touched(k), 0)
    for k, m in combinations(map(int, bad), 2):
        tau = sketch.tau.copy()
        tau[:, sketch.rows[[k, m]]] = sketch.tau[:, sketch.rows[[m, k]]]
        what = "their torques are exchanged: the model of each joint explains the torque of the other"
        advice = "exchange the two torque columns in the mapping file"
        yield Fix("swapped torques", what, (names[k], names[m]), advice, sketch.with_(tau=tau), touched(k, m), 1)
    for k in map(int, bad):
        scale = _scale(sketch, int(sketch.rows[k]))
        tau = sketch.tau.copy()
        tau[:, sketch.rows[k]] = tau[:, sketch.rows[k]] / max(scale, 1e-6)
        what = f"the load in its torque is {scale:.3g} times that of the URDF, while the friction fits"
        advice = "check its unit and its current gain; without a usable unit leave its torque row out (--torque-joints)"
        yield Fix("torque scale", what, (names[k],), advice, _rescaled(sketch, k, scale), touched(k), 3)


def _scale(sketch: Sketch, j: int) -> float:
    """Least-squares factor of the nominal torque in a joint's measured torque, fitted together with its friction."""
    use = sketch.used[:, j]
    X = np.column_stack([sketch.nominal[:, j], sketch.friction(j)])[use]
    return float(nnls(X, sketch.tau[use, j])[0][0])


def _rescaled(sketch: Sketch, k: int, scale: float) -> Sketch:
    """The sketch with one joint's nominal torque scaled, as if the sensor had that scale."""
    nominal = sketch.nominal.copy()
    nominal[:, sketch.rows[k]] *= scale
    return sketch.with_(given_nominal=nominal)


def global_fixes(sketch: Sketch) -> Iterator[Fix]:
    """Correct mistakes that concern all torques: turned or exchanged joints, gravity, scale, degrees."""
    robot, J = sketch.robot, len(sketch.robot.joints)
    for j in range(J):
        turn = np.where(np.arange(J) == j, -1.0, 1.0)
        for both in (True, False):
            what = f"its positions{' and torques' * both} have the wrong sign: with it changed, the model fits"
            advice = f"set sign = -1{'' if both else ' and torque_sign = -1'} for it in a mapping file"
            yield Fix("position sign", what, (robot.joints[j],), advice, _moved(sketch, turn, None, both), None, 1)
    for i, j in combinations(range(J), 2):
        order = np.arange(J)
        order[[i, j]] = j, i
        pair = (robot.joints[i], robot.joints[j])
        for both in (True, False):
            kind = "swapped joints" if both else "swapped positions"
            what = (
                f"their positions{' and torques' * both} are exchanged: with the columns exchanged back, the model "
                "explains the torques"
            )
            yield Fix(
                kind, what, pair, "exchange the columns in the mapping file", _moved(sketch, None, order, both), None, 2
            )
    gravity = _gravity(sketch)
    length = float(np.linalg.norm(robot.gravity))
    # The fit leaves the length of the vector free: a direction is accepted when the length is that of gravity.
    if length and abs(np.linalg.norm(gravity) / length - 1) < sketch.criteria.gravity_tolerance:
        turned = gravity / np.linalg.norm(gravity) * length
        other = Robot.from_dict({**robot.to_dict(), "gravity": turned.tolist()})
        at = ", ".join(f"{x:.3g}" for x in np.round(turned, 2) + 0.0)
        advice = "state how the base is mounted (--base-rpy or --gravity)"
        what = f"gravity points along ({at}) m/s² in the base frame: with this gravity the model explains the torques"
        yield Fix("mounting", what, (), advice, replace(sketch, robot=other), None, 3)
    scales = [_scale(sketch, int(j)) for j in sketch.rows]
    heard = [x for x, k in zip(scales, sketch.without > sketch.criteria.bad_nrmse, strict=True) if k and x > 0]
    if len(heard) > 1:
        common = float(np.median(heard))
        what = f"all torques are about {common:.3g} times those that the URDF predicts"
        advice = "check their unit and the current gains, or whether the URDF is of a smaller or larger robot"
        yield Fix("torque scale", what, sketch.names, advice, sketch.with_(tau=sketch.tau / common), None, 1)
    degrees = _moved(sketch, np.where(robot.prismatic, 1.0, np.deg2rad(1.0)), None, False)
    what = "the positions are in degrees: in radians the model explains the torques"
    yield Fix("degrees", what, robot.joints, 'set angle_unit = "deg" under [file] in a mapping file', degrees, None, 0)


def _moved(sketch: Sketch, factor: Array | None, order: NDArray[np.intp] | None, torque: bool) -> Sketch:
    """The sketch with motions scaled and reordered; if `torque`, the torques change sign and order with them."""
    J = sketch.q.shape[1]
    take = np.arange(J) if order is None else order
    by = np.ones(J) if factor is None else factor
    changes = {name: getattr(sketch, name)[:, take] * by for name in ("q", "v", "a")}
    changes |= {"sign": sketch.sign[:, take] * np.sign(by), "used": sketch.used[:, take]}
    if torque:
        changes["tau"] = sketch.tau[:, take] * np.sign(by)
    return sketch.with_(**changes)


def _gravity(sketch: Sketch) -> Array:
    """Gravity in the base frame that fits best together with friction, for the nominal inertias, m/s²."""
    few = sketch.thinned(sketch.criteria.few_samples)
    zero = np.zeros_like(few.q)
    pull = []
    for axis in np.eye(3):
        robot = Robot.from_dict({**few.robot.to_dict(), "gravity": axis.tolist()})
        pull.append(robot.inverse_dynamics(few.q, zero, zero))
    own = np.einsum("i,inj->nj", few.robot.gravity, np.array(pull))
    columns = {int(j): np.column_stack([x[:, j] for x in pull]) for j in few.rows}
    return shared_fit(few, columns, few.tau - (few.nominal - own))[:3]


def _unexplained(sketch: Sketch, free_errors: Callable[[], Array], notes: Notebook) -> None:
    """Report joints whose torque neither the URDF nor a simple mistake explains."""
    criteria, cap = sketch.criteria, sketch.criteria.nrmse_cap
    bad = sketch.excess > criteria.bad_nrmse
    if not bad.any():
        return
    free = free_errors()
    before, nominal, best = squared(sketch.without, cap), _error(sketch), squared(np.fmin(free, cap), cap)
    names = tuple(n for n, yes in zip(sketch.names, bad, strict=True) if yes)
    figures = (
        f"NRMSE {span(sketch.asis[bad])} with the URDF's inertials and fitted friction, "
        f"{span(sketch.without[bad])} with "
    )
    figures += f"friction alone, {span(free[bad])} with free parameters"
    rigid = before - min(best, before)
    share = (before - nominal) / rigid if rigid > criteria.rigid_share * before else 1.0
    other = squared(free[bad], cap) < criteria.free_ratio * squared(sketch.asis[bad], cap)
    if np.isfinite(free).all() and other and share < criteria.wrong_robot_share:
        notes.add(
            "wrong robot",
            f"the URDF's inertials explain {max(share, 0):.0%} of the error that freely fitted parameters explain: "
            f"{figures}",
            names,
            "likely" if share < criteria.likely_wrong_share else "possible",
            "is it the URDF of the robot that was measured (model, hand, mounting: --base-rpy), and are the "
            "current gains right? "
            "Identification replaces the inertials, not the kinematics",
        )
    else:
        notes.add(
            "unexplained torque",
            f"the model hardly explains the torque: {figures}",
            names,
            "possible",
            "check the columns of these joints, their signs and units, and whether something touched the robot",
        )
