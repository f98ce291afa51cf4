"""Torque per ampere of joints whose log has currents and no torque: tau_j = K_j · i_j.

The gain K_j is a data-sheet value, a weighed one (`frischid.export.drive_gains`), or one that follows from the URDF's
masses (`frischid.model.unknown_gains`). In the last case K_j is doubtful. A quantity of one joint in amperes, such as
its dry friction fc_j / K_j, does not depend on this doubt; the ratio of two joints' torques does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from frischid.core.arguments import is_real
from frischid.core.text import counted, shortened
from frischid.errors import InputError
from frischid.logs.log import GARBAGE, Log


@dataclass(frozen=True)
class CurrentGains:
    """Joint-side torque per ampere of each joint.

    Attributes
    ----------
    gain : mapping of str to float
        Joint -> N·m/A (N/A); negative where a positive current turns the joint backwards.
    doubt : mapping of str to float
        Standard error of a gain that was found, as a share of it; absent: the gain was given.

    Raises
    ------
    InputError
        A gain is zero or not a number, or a doubt is negative.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> t = np.arange(0.0, 1.0, 0.01)
    >>> log = fr.Log(t, ("elbow",), q=np.sin(t)[:, None], current=np.cos(t)[:, None])
    >>> driven = fr.CurrentGains({"elbow": 12.0}).drive(log)
    >>> bool(np.allclose(driven.tau, 12.0 * log.current))
    True
    """

    gain: Mapping[str, float]
    doubt: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for joint, value in self.gain.items():
            if not is_real(value) or not 0 < abs(value) < GARBAGE:
                raise InputError(
                    f"the torque per ampere of {joint} must be a number other than 0, got {shortened(value)}"
                )
        for joint, value in self.doubt.items():
            if not is_real(value) or not 0 <= value < GARBAGE:
                raise InputError(
                    f"the doubt about the torque per ampere of {joint} must be at least 0, got {shortened(value)}"
                )
            if joint not in self.gain:
                raise InputError(
                    f"there is a doubt about the torque per ampere of {joint}, and no gain; give the gain too"
                )
        for name in ("gain", "doubt"):
            object.__setattr__(self, name, {joint: float(x) for joint, x in getattr(self, name).items()})

    def drive(self, log: Log) -> Log:
        """The log with the torque of its currents; a joint whose torque was measured keeps it.

        Parameters
        ----------
        log : Log

        Returns
        -------
        Log
            The same log where no joint needs a torque.
        """
        open_columns = np.flatnonzero(log.has("current") & ~log.has("tau"))
        columns = [j for j in open_columns.tolist() if log.joints[j] in self.gain]
        if not columns or log.current is None:
            return log
        names = [log.joints[j] for j in columns]
        tau = np.full(log.q.shape, np.nan) if log.tau is None else log.tau.copy()
        tau[:, columns] = log.current[:, columns] * [self.gain[n] for n in names]
        guessed = " that follows from the URDF's masses" if any(self.doubt.get(n, 0.0) for n in names) else ""
        said = f"torque of {counted(len(columns), 'joint')} from their currents, by a torque per ampere{guessed}"
        return replace(log, tau=tau, sha256=log.identity, notes=(*log.notes, said))

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {name: dict(values) for name, values in asdict(self).items()}
