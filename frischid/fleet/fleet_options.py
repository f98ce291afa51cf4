"""Options of the identification of a fleet, checked when they are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from frischid.effects import BASELINE, Effect
from frischid.errors import UnknownNameError
from frischid.logs.mapping import LogMap
from frischid.model.identify_options import PRIORS


@dataclass(frozen=True)
class FleetOptions:
    """Options of the identification of a fleet.

    Attributes
    ----------
    effects, torque_joints, cutoff, velocity
        As for `frischid.model.identification.identify`.
    torque_lag : float or "auto"
        As for `identify`; ``"auto"`` takes the lag that `identify` finds on five logs, spread evenly over the fleet.
    mapping : LogMap or None
        Meaning of the logs' columns.
    strict : bool
        Whether to stop at a log that cannot be used instead of skipping it.
    diagnosed : int
        Most robots to diagnose for effects that the model lacks, of those that differ.
    prior : {"urdf", "none"}
        As for `frischid.model.identification.identify`: the URDF's links are a prior, or the logs alone decide.
    """

    effects: tuple[Effect, ...] = BASELINE
    torque_joints: tuple[str, ...] | None = None
    cutoff: float | Literal["auto"] | None = "auto"
    torque_lag: float | Literal["auto"] = "auto"
    velocity: str = "auto"
    mapping: LogMap | None = None
    strict: bool = False
    diagnosed: int = 20
    prior: Literal["urdf", "none"] = "urdf"

    def __post_init__(self) -> None:
        if self.prior not in PRIORS:
            raise UnknownNameError("prior", self.prior, PRIORS)
