"""Every number that decides what a comparison says, of the noise floor and of the structure of the residual error."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class ComparisonCriteria:
    """Numbers that decide in `frischid.compare`.

    Attributes
    ----------
    condition_samples : int
        Samples inside and outside of a condition below which its error is not stated: a mean square of fewer scatters
        by a third and more.
    dependence_samples : int
        Independent samples below which no dependence is stated. Chatterjee's test errs on the safe side there.
    reversal_seconds : float
        s. Time before and after a reversal that counts as near it.
    quarter : float
        Share of the samples that is the slowest, the fastest, the strongest accelerated or the most loaded.
    beginning : float
        Share of a log that is its beginning, and its end.
    white_ratio : float
        Correlation time, over that of filtered white noise, up to which a residual counts as white.
    noise_samples : int
        Samples of one motion, from its middle, on which noise is drawn for the floor: enough for the floor's first two
        digits at bounded cost.
    full_motions : int
        Motions that are all looked at for the floor; of later ones the 32nd, 64th, ... stand for the rest.
    sharp_width : float
        rad/s (m/s). Width of dry friction's sign that is as good as a step.
    octaves : int
        Octaves above the cut-off in which the torque's noise is looked at.
    noise_stretch : float
        s. Stretches of a log that are each as noisy as they are.
    noise_stretch_samples : int
        Samples of such a stretch, at least.
    octave_top : float
        Frequency, over the middle of an octave, above which noise is not looked at.
    corners : tuple of float
        Hz. Corner frequencies tried for noise with a memory; slower noise may be physics.
    """

    condition_samples: int = 20
    dependence_samples: int = 10
    reversal_seconds: float = 0.2
    quarter: float = 0.25
    beginning: float = 0.2
    white_ratio: float = 1.5
    noise_samples: int = 12_000
    full_motions: int = 16
    sharp_width: float = 1e-4
    octaves: int = 4
    noise_stretch: float = 0.5
    noise_stretch_samples: int = 32
    octave_top: float = 1.5
    corners: tuple[float, ...] = (80.0, 56.0, 40.0, 28.0, 20.0, 14.0, 10.0)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self) | {"corners": list(self.corners)}


COMPARISON_CRITERIA = ComparisonCriteria()
"""The numbers in use."""
