"""How much of an error an effect explains, beside the sensors' noise that no effect explains.

    share = Σ_j (E_j² − E'_j²)  /  Σ_j (E_j² − n_j²)

with E_j and E'_j the NRMSE of joint j without and with the effect, and n_j that of the noise.
"""

from __future__ import annotations

import numpy as np

from frischid.core.types import Array
from frischid.diagnosis.criteria import DiagnosisCriteria


def explained_share(before: Array, after: Array, noise: Array, criteria: DiagnosisCriteria) -> float:
    """Explained share of the squared error above the noise; zero where that error is negligible."""
    if negligible(before, noise, criteria):
        return 0.0
    return float(np.clip((before**2 - after**2).sum() / _above(before, noise), 0.0, 1.0))


def negligible(error: Array, noise: Array, criteria: DiagnosisCriteria) -> bool:
    """Whether the error above the noise is too small to be worth a parameter."""
    return _above(error, noise) <= criteria.smallest_error**2


def in_floors(error: Array, noise: Array) -> float:
    """The error in multiples of the noise."""
    return float(np.linalg.norm(error)) / max(float(np.linalg.norm(noise)), 1e-12)


def _above(error: Array, noise: Array) -> float:
    """Summed squared error above the noise."""
    return float((error**2 - np.minimum(noise, error) ** 2).sum())
