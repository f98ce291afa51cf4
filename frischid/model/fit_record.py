"""The record that a model keeps of the logs it was fitted to; a later comparison holds other logs against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from frischid.core.types import Array


@dataclass(frozen=True, eq=False)
class FitRecord:
    """The reach of the fitted logs, and the reference that a model must beat.

    Attributes
    ----------
    velocity, acceleration : ndarray, shape (J,)
        Speed and acceleration of the fitted joints below which 99 % of the samples are, rad/s (m/s), rad/s² (m/s²).
    urdf : ndarray, shape (p,)
        Base parameters of the URDF's links with friction and offsets fitted to the same logs: what a careful user of
        the URDF has. A simulator's damping has no part in it.

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.model.fit_record import FitRecord
    >>> record = FitRecord(np.ones(2), np.ones(2), np.zeros(3))
    >>> FitRecord.from_dict(record.to_dict()).urdf.shape
    (3,)
    """

    velocity: Array
    acceleration: Array
    urdf: Array

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "velocity": [float(x) for x in self.velocity],
            "acceleration": [float(x) for x in self.acceleration],
            "urdf": [float(x) for x in self.urdf],
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Sequence[float]]) -> FitRecord:
        """Inverse of `to_dict`."""
        return cls(*(np.array(data[key], dtype=float) for key in ("velocity", "acceleration", "urdf")))

    def extended(self, count: int) -> FitRecord:
        """The same for a model with further parameters, which the URDF knows nothing of."""
        return FitRecord(self.velocity, self.acceleration, np.append(self.urdf, np.zeros(count)))
