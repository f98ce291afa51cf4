"""The figures that the paper prints, and nothing that is computed.

Source: S. Massaroli et al., *Frisch Scheme Identification of Robots Dynamic Parameters*, Tables 1 to 4 and section 3.2.
The order of the nine base parameters is that of Tables 3 and 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

LENGTH, RATE, WINDOW, RUNS = 99.0, 50.0, 1000, 250
"""Seconds and samples per second of the motion, rows per BBRF window, and runs of the Monte Carlo study."""
NOISE_AS_PRINTED, NOISE_AS_RUN, TORQUE_NOISE = 1e-2, 1e-3, 1.0
"""Standard deviation of the noise on q (rad) in the text and in the authors' code, and on the torque (N·m). On q̇ and q̈
twice the value of q (rad/s, rad/s²)."""
POINT_LIMITS = (3.0, 5.0, 10.0)
"""Limits of the points: |q|, rad; |q̇|, rad/s; |q̈|, rad/s²."""
COUNTS = {"rank": 9, "identifiable alone": 5, "not identifiable": 14, "identifiable together": 7}


class Search(NamedTuple):
    """A phase of the authors' search for exciting points: its iterations and evaluations, and cost (19) at its end."""

    phase: str
    iterations: int
    evaluations: int
    cost: float


SEARCHES = (Search("particle swarm", 1061, 106_200, 18.0100), Search("pattern search", 1006, 293_471, 13.5739))
TABLE_2 = {"cost (19)": 13.5739, "condition number": 11.1564, "σ_max": 74.5923, "σ_min": 6.6860}


class Spread(NamedTuple):
    """A mean over the runs, and the standard deviation."""

    mean: float
    deviation: float


@dataclass(frozen=True)
class ParameterRow:
    """One row of Tables 3 and 4."""

    symbol: str
    stands_for: str
    unit: str
    reference: float
    lower: Spread
    upper: Spread
    selected: Spread
    error: Spread
    """`lower`, `upper`, `selected`, `error`: The columns θ_min, θ_max (Table 3), θ* and e (Table 4)."""


def _row(symbol: str, stands_for: str, unit: str, reference: float, *values: float) -> ParameterRow:
    spreads = (Spread(*values[k : k + 2]) for k in range(0, 8, 2))
    return ParameterRow(symbol, stands_for, unit, reference, *spreads)


PRINTED_PARAMETERS = (
    _row("β1", "viscous friction, joint 1", "N·m·s/rad", 0.1434,
         -3.4309, 0.4304, 3.1086, 0.1459, 0.1427, 0.0084, 0.0061, 0.0057),
    _row("β2", "viscous friction, joint 2", "N·m·s/rad", 0.1391,
         -2.7838, 0.3448, 2.5173, 0.0955, 0.1397, 0.0052, 0.0041, 0.0032),
    _row("μ1", "Coulomb friction, joint 1", "N·m", 0.3302,
         -7.8714, 2.0704, 17.4337, 1.2847, 0.3281, 0.0318, 0.0209, 0.0240),
    _row("μ2", "Coulomb friction, joint 2", "N·m", 0.3576,
         -7.0842, 1.7640, 16.1686, 0.9681, 0.3563, 0.0221, 0.0176, 0.0134),
    _row("I2m", "rotor inertia of motor 2", "kg·m²", 21.18,
         21.1735, 0.0011, 21.1862, 0.0007, 21.1810, 0.0014, 0.0013, 0.0011),
    _row("θ6", "m1/2 + m2/2 + m1 r1x", "kg·m", 20.75,
         20.7150, 0.0038, 20.7717, 0.0014, 20.7489, 0.0020, 0.0018, 0.0015),
    _row("θ7", "I1z + I1m/100 − m1/4 − m2/4", "kg·m²", -7.1623,
         -7.1677, 0.0010, -7.1548, 0.0006, -7.1620, 0.0005, 0.0005, 0.0004),
    _row("θ8", "m2/2 + m2 r2x", "kg·m", 7.5,
         7.4941, 0.0010, 7.5061, 0.0008, 7.5006, 0.0015, 0.0013, 0.0010),
    _row("θ9", "I2z − m2/4", "kg·m²", -2.2667,
         -2.2883, 0.0036, -2.2398, 0.0019, -2.2691, 0.0028, 0.0029, 0.0022),
)  # fmt: skip
"""Tables 3 and 4. Table 4 as printed repeats μ1's reference, 0.3302, for μ2: a slip for 0.3576."""


class Physical(NamedTuple):
    """A row of Table 1: what it is, as printed, and what reproduces the other tables."""

    quantity: str
    printed: str
    used: str


TABLE_1 = (
    Physical("viscous friction β1, β2, N·m·s/rad", "0.1434, 0.1391", "the same"),
    Physical("Coulomb friction μ1, μ2, N·m", "0.3302, 0.3576", "the same"),
    Physical("masses m1, m2, kg", "21, 10", "the same, but see r1x"),
    Physical("inertias I1z, I2z, kg·m²", "0.4667, 0.2333", "the same, but see r1x"),
    Physical("rotor inertias I1m, I2m, kg·m²", "12.10, 21.18", "the same"),
    Physical("centre of mass r1x, m", "0.25", "0.25 beyond the end of the rod: no body has these values"),
    Physical("link length a, m", "1", "Table 2: 0.5; Tables 3 and 4: 1"),
    Physical("gear ratios", "–", "Table 2: 0.1 and 0.1; Tables 3 and 4: 4 and 2"),
    Physical("noise σ(q), σ(q̇) = σ(q̈)", "1e-2, 2e-2", "1e-3, 2e-3"),
    Physical("noise σ(τ), N·m", "1", "the same"),
)
