"""Hidden effects of a given size: drawn, scaled, and compared with the part that the baseline model absorbs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from hidden_physics import Array, World, rms
from hidden_shapes import SHAPES, SMALL, Hidden, loaded_joint
from hidden_two_mass import elastic, in_band, loose, reversing, simulated
from hidden_unknown import UNKNOWN

GEARS = ("elasticity", "backlash")
CHANNELS = ("drive_gain", "time_delay")
TRIES = 5
LEAST_VISIBLE = 0.1
"""Share of an effect that the baseline model must not absorb; below this share, another shape is drawn."""


@dataclass(frozen=True, eq=False)
class Part:
    """A hidden effect of a given size.

    Attributes
    ----------
    joints : tuple of int
        Joints the effect acts on; empty for the whole robot.
    torque : list of ndarray, shape (N, J)
        Its torque in every world.
    extra : list of mapping of str to ndarray
        Further channels of every world.
    size, visible : float
        Size as a share of the joint's torque, and size of the part that the baseline model cannot absorb on the motion
        to fit.
    detail : str
        Description for people.
    """

    joints: tuple[int, ...]
    torque: list[Array]
    extra: list[Mapping[str, Array]]
    size: float
    visible: float
    detail: str


def torque_scale(worlds: Sequence[World]) -> Array:
    """Standard deviation of each joint's torque over both logs to diagnose, (J,)."""
    return np.asarray(np.concatenate([w.base for w in worlds if w.number < 2]).std(axis=0))


def acting(torque: Sequence[Array]) -> Array:
    """Rms of a torque over the logs to diagnose in which it acts, (J,)."""
    seen = [x for x in torque[:2] if x.any()]
    return rms(np.concatenate(seen or torque[:1]))


class Baseline:
    """The baseline model (links, viscous and dry friction, offsets, rotors), fitted to a hidden torque below 10 Hz.

    If the effect is a change, the log from before the change is fitted too, which leaves the parameters less freedom.

    Parameters
    ----------
    worlds : sequence of World
    scale : ndarray, shape (J,)
        Standard deviation of each joint's torque.
    every : int
        Every n-th sample is used.
    """

    def __init__(self, worlds: Sequence[World], scale: Array, every: int = 50) -> None:
        self.scale, self.every = scale, every
        used = [w for w in worlds if w.number != 1]
        Y = np.concatenate([_regressor(w, every) for w in used]) / scale[:, None]
        self.shape = Y.shape[:2]
        U, S, _ = np.linalg.svd(Y.reshape(-1, Y.shape[2]), full_matrices=False)
        self.span = U[:, S / S[0] > 1e-7]

    def left(self, torque: Array) -> Array:
        """Part of a torque (N, J) on the motion to fit that is not absorbed, over each joint's torque, (J,)."""
        slow = np.stack([in_band(x) for x in torque.T], axis=1)[:: self.every] / self.scale
        y = np.zeros(self.shape)
        y[: len(slow)] = slow
        left = y.ravel() - self.span @ (self.span.T @ y.ravel())
        return rms(left.reshape(self.shape)[: len(slow)])


def _regressor(w: World, every: int) -> Array:
    """Columns of the baseline model at some samples, (M, J, C)."""
    q, v, a = (x[::every] for x in (w.path.q, w.path.v, w.path.a))
    M, J = q.shape
    rigid = np.empty((M, len(w.robot.columns), J))
    w.robot.regressor(q, v, a, rigid)
    drives = [x[:, :, None] * np.eye(J) for x in (v, np.tanh(v / 0.005), np.ones_like(v), a)]
    return np.concatenate([rigid.transpose(0, 2, 1), *drives], axis=2)


def shape(
    name: str, worlds: Sequence[World], scale: Array, target: float, rng: np.random.Generator, baseline: Baseline
) -> Part:
    """Draw an effect that is a torque along the motion, until the baseline does not absorb too much of it."""
    fit, best = worlds[0], None
    for _ in range(TRIES):
        joint = loaded_joint(rng, fit, scale) if name == "load_friction" else int(rng.integers(len(scale)))
        part = _scaled((SHAPES | UNKNOWN)[name](rng, fit, joint), worlds, scale, target, baseline)
        if best is None or part.visible > best.visible:
            best = part
        if part.visible > LEAST_VISIBLE * target:
            break
    assert best is not None
    return best


def _scaled(hidden: Hidden, worlds: Sequence[World], scale: Array, target: float, baseline: Baseline) -> Part:
    """Scale an effect, and apply it to all logs except those from before the change."""
    counted = [(hidden.size or hidden.torque)(w) for w in worlds[:2]]
    factor = target / float((acting(counted) / scale).max())
    torque = [factor * hidden.torque(w) if w.number < 2 else np.zeros_like(w.base) for w in worlds]
    extra = [hidden.extra(w) if hidden.extra else {} for w in worlds]
    seen = float(baseline.left(torque[0]).max())
    return Part(hidden.joints, torque, extra, target, seen, f"{hidden.detail} × {factor:.3g}")


def gear(
    name: str, worlds: Sequence[World], scale: Array, target: float, rng: np.random.Generator
) -> tuple[list[World], Part]:
    """Put a gear into one joint of a robot whose motions are given."""
    fit = worlds[0]
    j = loaded_joint(rng, fit, scale) if name == "elasticity" else int(rng.choice(reversing(fit, scale)))
    found = (elastic if name == "elasticity" else loose)(worlds[:2], j, target, float(scale[j]))
    made = [simulated(w, j, found) for w in worlds]
    detail = f"k={found.stiffness:.3g}" + (f", gap={found.gap:.3g}" if found.gap else "")
    seen, torque = [w for w, _ in made], [x for _, x in made]
    size = float(rms(np.concatenate([in_band(x[:, j]) for x in torque[:2]]))) / float(scale[j])
    left = float(Baseline(seen, scale).left(torque[0])[j])
    return seen, Part((j,), torque, [{}] * len(worlds), size, left, detail)


def channel(
    name: str,
    worlds: Sequence[World],
    scale: Array,
    target: float,
    rng: np.random.Generator,
    parts: Sequence[Part],
    baseline: Baseline,
) -> Part:
    """Scale one torque channel wrongly, or delay one or all of them."""
    J = len(scale)
    whole = [w.base + sum((p.torque[k] for p in parts), np.zeros(1)) for k, w in enumerate(worlds)]
    j = int(rng.integers(J))
    if name == "drive_gain":
        gain = target * rng.choice([-1.0, 1.0]) / float(acting(whole)[j] / scale[j])
        torque, joints, detail = (
            [w.on(j, gain * x[:, j]) for w, x in zip(worlds, whole, strict=True)],
            (j,),
            f"{gain:+.3f}",
        )
    else:
        joints = (j,) if rng.random() < 0.5 else ()
        rows = np.array(joints or range(J))
        delay = 0.02
        for _ in range(4):
            size = _slow([_late(w, x, rows, delay) for w, x in zip(worlds[:2], whole, strict=False)], scale)
            delay *= float(np.clip(target / size, 0.2, 5.0))
        torque, detail = [_late(w, x, rows, delay) for w, x in zip(worlds, whole, strict=True)], f"{1e3 * delay:.3g} ms"
    torque = [x if w.number < 2 else np.zeros_like(x) for w, x in zip(worlds, torque, strict=True)]
    size = float(acting(torque)[j] / scale[j]) if name == "drive_gain" else _slow(torque[:2], scale)
    return Part(joints, torque, [{}] * len(worlds), size, float(baseline.left(torque[0]).max()), detail)


def _slow(torque: Sequence[Array], scale: Array) -> float:
    """Largest share of a joint's torque, without frequencies above those of any identification."""
    slow = [np.stack([in_band(x) for x in part.T], axis=1) for part in torque]
    return float((acting(slow) / scale).max())


def _late(w: World, torque: Array, joints: Array, delay: float) -> Array:
    """Torque error that a delay of some joints' torque channels causes."""
    out = np.zeros_like(torque)
    for j in joints:
        out[:, j] = np.interp(w.path.t - delay, w.path.t, torque[:, j]) - torque[:, j]
    return out


def background(
    share: float, avoid: Sequence[str], worlds: Sequence[World], scale: Array, rng: np.random.Generator
) -> tuple[list[Array], tuple[str, ...]]:
    """Two to four small effects of other kinds on every joint, together of the given size."""
    total = [np.zeros_like(w.base) for w in worlds]
    if not share:
        return total, ()
    choices = [n for n in [*SMALL, *UNKNOWN] if n not in avoid]
    kinds = tuple(str(n) for n in rng.choice(choices, int(rng.integers(2, 5)), replace=False))
    for j in range(len(scale)):
        column = [np.zeros(len(w.base)) for w in worlds]
        for kind in kinds:
            hidden = (SHAPES | UNKNOWN)[kind](rng, worlds[0], j)
            torque = [hidden.torque(w)[:, j] for w in worlds]
            weight = rng.uniform(0.5, 1.0) / float(acting(torque))
            for k, x in enumerate(torque):
                column[k] += weight * x
        factor = share * scale[j] / float(acting(column))
        for k in range(len(worlds)):
            total[k][:, j] = factor * column[k]
    return total, kinds
