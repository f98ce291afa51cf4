"""Evidence of the torques on a log's positions and signs that holds whatever the links weigh.

A fault undone changes the motion, the torques, or their signs. Parameters are fitted freely to the log as it is, and to
the log with the fault undone, and predict stretches of time that were left out (`excitation.free_fit`). A fault that is
real leaves a smaller or the same error. The error rises where the log was right: then the URDF's links are wrong, and
the fault is only what a wrong URDF looks like. The log as it is must be explained better than URDFs usually are, or its
error says nothing:

    Σ_j log L_j(free, as it is) − Σ_j log L_j(free, undone)  >  log(odds),      e_j(free, as it is) < e_URDF.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import Sketch
from frischid.core.types import Array


@dataclass(frozen=True, eq=False)
class KinematicEvidence:
    """Whether freely fitted parameters speak against a fault."""

    sketch: Sketch
    """The log as it is."""
    free: Callable[[Sketch], Array]
    """Sketch -> cross-validated NRMSE of freely fitted parameters, (R,), NaN where unknown."""

    @cached_property
    def _asis(self) -> Array:
        return self.free(self.sketch)

    def contradicts(self, corrected: Sketch) -> bool:
        """Whether the log with faults undone is explained worse, though the log as it is is explained well."""
        criteria, fits = self.sketch.criteria, RowFits(self.sketch)
        if not (self._asis < criteria.urdf_error).all():  # also where nothing is known
            return False
        undone = self.free(corrected)
        if not np.isfinite(undone).all():
            return False
        return bool(fits.total(self._asis) - fits.total(undone) > np.log(criteria.least_odds))
