"""The URDF's links, changed to bodies that can exist where they cannot, as the reference of `physical_links`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.robot.inertia import pseudo_inertia

THINNEST = 0.01  # of the robot's length: a nominal link without extension is taken to have this radius of gyration

LIGHTEST = 0.05  # a nominal link without mass is taken to have this share of the mean mass


@dataclass(frozen=True, eq=False)
class Links:
    """Prior and bounds of L links, each about a frame of its own."""

    names: tuple[str, ...]
    """Names for messages."""
    nominal: Array
    """m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz, (L, 10)."""
    boxes: tuple[tuple[Array, Array] | None, ...]
    """Half-spaces ``A c ≤ b`` in which the centre of mass c must lie, m."""
    known: Array
    """Known values, (L, 10); NaN for the others."""
    length: float
    """Length of the robot, m."""


def reference_inertias(links: Links) -> tuple[Array, tuple[str, ...]]:
    """Positive definite pseudo-inertias of the nominal links, (L, 4, 4), and notes on links that had to be changed."""
    masses = links.nominal[:, 0]
    usual = float(masses[masses > 0].mean()) if (masses > 0).any() else 1.0
    out, notes = np.empty((len(masses), 4, 4)), []
    for i, (name, P) in enumerate(zip(links.names, pseudo_inertia(links.nominal), strict=True)):
        m, h = P[3, 3], P[:3, 3]
        if m <= 0:
            notes.append(f"{name}: the URDF gives this link no mass; the prior takes {LIGHTEST * usual:.3g} kg")
            m, h, P = LIGHTEST * usual, np.zeros(3), np.zeros((4, 4))
        spread, axes = np.linalg.eigh(P[:3, :3] - np.outer(h, h) / m)
        least = m * (THINNEST * links.length) ** 2
        if spread[0] < -1e-9 * m and masses[i] > 0:
            notes.append(
                f"{name}: no body can have the URDF's inertia of this link; the prior takes the nearest possible one"
            )
        inner = (axes * np.maximum(spread, least)) @ axes.T + np.outer(h, h) / m
        out[i] = np.block([[inner, h[:, None]], [h[None, :], np.array([[m]])]])
    return out, tuple(notes)
