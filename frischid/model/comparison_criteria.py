"""Every number that decides a comparison: its noise floor, and the structure of the residual error."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class ComparisonCriteria:
    """Numbers that decide in `frischid.compare`."""

    condition_samples: int = 20
    """Samples inside and outside of a condition. With fewer, its error is not stated, because a mean square of so few
    samples varies by a third and more."""
    telling_ratio: float = 1.25
    """Error under a condition over the joint's own error, from which a sentence names the condition. A smaller rise may
    be more than chance, and does not say where a model fails."""
    dependence_samples: int = 10
    """Independent samples. With fewer, no dependence is stated. At this number Chatterjee's test is on the safe side.
    """
    reversal_seconds: float = 0.2
    """s. Time before and after a reversal that counts as near the reversal."""
    quarter: float = 0.25
    """Share of the samples that counts as the slowest, the fastest, the most accelerated or the most loaded."""
    beginning: float = 0.2
    """Share of a log that counts as its beginning, and as its end."""
    white_ratio: float = 1.5
    """Correlation time, over that of filtered white noise, up to which a residual counts as white."""
    noise_samples: int = 12_000
    """Samples from the middle of a motion on which noise is drawn for the floor: enough for the first two digits of the
    floor at bounded cost."""
    draws: int = 3
    """Draws of the noise for the floor: one alone may be twice the median at a joint that reverses slowly."""
    full_motions: int = 16
    """Number of first motions that all count for the floor; of later ones only the 32nd, 64th, ... count."""
    sharp_width: float = 1e-4
    """rad/s (m/s). Width of dry friction's sign that is as good as a step."""
    octaves: int = 4
    """Number of octaves above the cut-off in which the torque's noise is measured."""
    noise_stretch: float = 0.5
    """s. Length of the stretches of a log in which the noise level is measured."""
    noise_stretch_samples: int = 32
    """Least samples of such a stretch."""
    octave_top: float = 1.5
    """Highest frequency of an octave in which noise is measured, over the octave's middle."""
    step_rounding: float = 0.01
    """Share of an encoder's step. Where all changes of a position are whole steps to within this, the encoder rounds.
    """
    corners: tuple[float, ...] = (80.0, 56.0, 40.0, 28.0, 20.0, 14.0, 10.0)
    """Hz. Corner frequencies that are tried for noise with a memory; slower noise may be physics."""

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self) | {"corners": list(self.corners)}


COMPARISON_CRITERIA = ComparisonCriteria()
"""The numbers in use."""
