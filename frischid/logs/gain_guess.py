"""Torque per ampere of each joint, from the set points of the controller's own torque and current.

Some controllers log the torque that their model asks for, and the current that they send for it (UR's RTDE:
``target_moment_0`` and ``target_current_0``). The current also overcomes friction,

    i_set = τ_set / gain + fv q̇ + fc sgn(q̇) + i_0,

so least squares in amperes gives the gain. The figures are those of the controller's maker: no measured torque takes
part. On eight logs of a UR10e, they lie within 6 % of the known gains on every joint (shoulder lift and elbow: 0.3 %).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from frischid.core.types import Array
from frischid.logs.column_names import set_point, split
from frischid.logs.proposal import Proposal
from frischid.logs.standstill import CREEPING
from frischid.logs.table import Table

LEAST_EXPLAINED = 0.98
"""Share of the current's variance that the equation must explain. On eight logs of a UR10e it explains at least 0.997;
below this share, the two columns are not the two set points of one joint."""


def guess_gains(table: Table, t: Array, found: Proposal) -> None:
    """Propose gains where both set points of every joint with a current are in the log."""
    wanted = {set_point(name): name for name in table.numeric}
    gains: dict[str, float] = {}
    set_points: list[str] = []
    joints = {joint: c for joint, c in found.joints.items() if "current" in c and "tau" not in c}
    for joint, columns in joints.items():
        place = split(columns["current"])[1]
        current, torque = (wanted.get((channel, place)) for channel in ("current", "tau"))
        if current is None or torque is None:
            return
        gain = _gain(table.numeric, columns, current, torque, t)
        if gain is None:
            return
        gains[joint] = gain
        set_points += [torque, current]
    if gains:
        found.gains, found.set_points = gains, set_points
        found.guesses.append(
            f"gains from the controller's set points ({set_points[0]} over {set_points[1]} ...), some per cent wrong; "
            "frischid gains checks them with a weighed payload"
        )


def _gain(columns: Mapping[str, Array], own: Mapping[str, str], current: str, torque: str, t: Array) -> float | None:
    """Torque per ampere of a joint; None where the set points do not belong together."""
    i, tau = (np.asarray(columns[name], dtype=float) for name in (current, torque))
    q = np.asarray(columns[own["q"]], dtype=float)
    v = np.asarray(columns[own["v"]], dtype=float) if "v" in own else np.gradient(q, t)
    A = np.stack([tau, v, np.sign(v), np.ones_like(v)], axis=1)
    good = np.isfinite(A).all(axis=1) & np.isfinite(i) & (np.abs(v) > CREEPING)
    if good.sum() < 2 * A.shape[1] or not i[good].std():
        return None
    theta = np.linalg.lstsq(A[good], i[good], rcond=None)[0]
    residual = i[good] - A[good] @ theta
    if residual.var() > (1 - LEAST_EXPLAINED) * i[good].var() or not theta[0]:
        return None
    return float(f"{1 / theta[0]:.4g}")
