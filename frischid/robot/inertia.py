"""A rigid body as a distribution of mass, and as ten numbers.

    P = [[Σ, h], [hᵀ, m]] = ∫ [r; 1] [r; 1]ᵀ dm,        Σ = ½ tr(I) 1 − I

is linear in the ten parameters m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz, and a change of frame H acts as
``P' = H P Hᵀ``. A body can exist if and only if P is positive semidefinite (Wensing, Kim and Slotine 2018, IEEE
Robotics and Automation Letters 3(1)).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array


def pseudo_inertia(theta: Array) -> Array:
    """P of one body (10,) or several (..., 10): shape (..., 4, 4)."""
    theta = np.asarray(theta, dtype=float)
    m, mx, my, mz, xx, xy, yy, xz, yz, zz = np.moveaxis(theta, -1, 0)
    half = 0.5 * (xx + yy + zz)
    rows = [[half - xx, -xy, -xz, mx], [-xy, half - yy, -yz, my], [-xz, -yz, half - zz, mz], [mx, my, mz, m]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def dynamic_parameters(P: Array) -> Array:
    """Inverse of `pseudo_inertia`: (..., 4, 4) -> (..., 10)."""
    S, h, m = P[..., :3, :3], P[..., :3, 3], P[..., 3, 3]
    xx, yy, zz = S[..., 0, 0], S[..., 1, 1], S[..., 2, 2]
    inertia = [yy + zz, -S[..., 0, 1], xx + zz, -S[..., 0, 2], -S[..., 1, 2], xx + yy]
    return np.stack([m, h[..., 0], h[..., 1], h[..., 2], *inertia], axis=-1)


def parameter_transform(H: Array) -> Array:
    """T with θ_joint = T θ_frame, shape (10, 10), for a frame at the pose H (4, 4) in the joint frame."""
    return dynamic_parameters(H @ pseudo_inertia(np.eye(10)) @ H.T).T


def is_physical(theta: Array) -> NDArray[np.bool_]:
    """Whether each of several bodies (..., 10) could exist: P is positive semidefinite up to rounding."""
    P = pseudo_inertia(theta)
    size = np.maximum(np.trace(P, axis1=-2, axis2=-1), 0.0)
    return np.asarray(np.linalg.eigvalsh(P)[..., 0] >= -1e-9 * size)


def redistributed(parts: Array, whole: Array, main: int) -> Array:
    """Change the parts of a body so that together they have the inertia of another body.

    One affine map is applied to every part: the map that carries the old distribution of mass to the new one with the
    least work (optimal transport of Gaussians). So parts keep their shares, and stay physical if they were. Inertia
    that no map of a flat old body can give is added to the main part; if the old body has no mass, the main part gets
    all.

    Parameters
    ----------
    parts : ndarray, shape (n, 4, 4)
        Pseudo-inertias in one frame.
    whole : ndarray, shape (4, 4)
        Their new sum.

    Returns
    -------
    ndarray, shape (n, 4, 4)
    """
    old = parts.sum(axis=0)
    out = np.zeros_like(parts)
    if old[3, 3] > 0 and whole[3, 3] > 0 and len(parts) > 1:
        A = _transport(old, whole)
        out = A @ parts @ A.T
    out[main] += whole - out.sum(axis=0)
    return out


def _transport(old: Array, new: Array) -> Array:
    (m, c, C), (n, d, D) = _moments(old), _moments(new)
    values, axes = np.linalg.eigh(C)
    # a flat old body is thickened by a tenth of a millimetre, only to compute the map
    half = _root((axes * np.maximum(values, 1e-8 + 1e-6 * values[-1])) @ axes.T)
    inverse = np.linalg.inv(half)
    R = inverse @ _root(half @ D @ half) @ inverse
    return np.asarray(np.sqrt(n / m) * np.block([[R, (d - R @ c)[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))


def _moments(P: Array) -> tuple[float, Array, Array]:
    """Mass, centre, and covariance of the distribution of mass."""
    c = P[:3, 3] / P[3, 3]
    return float(P[3, 3]), c, P[:3, :3] / P[3, 3] - np.outer(c, c)


def _root(C: Array) -> Array:
    values, axes = np.linalg.eigh((C + C.T) / 2)
    return np.asarray((axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T)
