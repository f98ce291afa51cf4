"""Options of an identification, checked when they are made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypedDict

import numpy as np

from frischid.effects.units import is_number
from frischid.errors import InputError, UnknownNameError
from frischid.estimators.urdf_prior import PriorCriteria
from frischid.logs.controller import PDController
from frischid.logs.current_gains import CurrentGains
from frischid.logs.preprocessing import VELOCITIES
from frischid.model.alarms import AlarmCriteria
from frischid.model.identification_criteria import IdentificationCriteria

ESTIMATORS = ("wls", "ols", "frisch", "frisch_squared", "sensorwise", "eiv", "iv")
PRIORS = ("urdf", "none")
RECURSIONS = ("strict", "undo", "calibrated", "none")
Cutoff = float | Literal["auto"] | None
LONGEST_TORQUE_LAG = 1.0
"""s; a channel that is later than this belongs to another log."""


class IdentifyChoices(TypedDict, total=False):
    """Fields of `IdentifyOptions` as keyword arguments of `identify`."""

    torque_joints: Sequence[str] | None
    cutoff: Cutoff
    torque_lag: float | Literal["auto"]
    velocity: str
    estimator: str
    prior: str | None
    recursion: str
    window: int | None
    reference: Mapping[str, float] | None
    force: bool
    controller: PDController | None
    currents: CurrentGains | None
    criteria: IdentificationCriteria
    prior_criteria: PriorCriteria
    alarm_criteria: AlarmCriteria


@dataclass(frozen=True)
class IdentifyOptions:
    """How logs become a model.

    Attributes
    ----------
    torque_joints : sequence of str, optional
        Joints whose torque is fitted; all with a torque channel by default.
    cutoff : float, "auto" or None
        Cut-off of the parallel filter, Hz; None filters nothing.
    torque_lag : float or "auto"
        Time by which the recorded torque is late, s; 0 takes the torque as recorded. ``"auto"``: the lag that the logs
        show is taken back, where all joints agree on a lag that sampling explains (`frischid.model.torque_lag`).
    velocity : {"auto", "measured", "derived"}
        Where velocities come from: the log's own channel, the derivative of the positions, or whichever is less noisy.
    estimator : {"wls", "ols", "frisch", "frisch_squared", "sensorwise", "eiv", "iv"}
        Whose values become the model's. ``"frisch"`` takes the point of the Frisch box by the paper's eq. (24) as
        printed, ``"frisch_squared"`` the box's least-squares point, which depends neither on units nor on the log's
        length (`frischid.estimators.frisch_selection`); ``"sensorwise"`` adds the
        box of `frischid.estimators.sensorwise`, with the sensors' noise limited to the noise seen in the log;
        ``"eiv"`` and ``"iv"`` are errors-in-variables likelihood and instrumental variables.
    prior : {"urdf", "none"}, optional
        ``"urdf"``: the URDF's links are a prior, each as good as the logs say (`frischid.estimators.urdf_prior`); only
        with the estimator ``"wls"``, whose default it is. ``"none"``: the logs alone, the default of all others.
    recursion : {"strict", "undo", "calibrated", "none"}
        Variant of the bounding-box recursion (BBRF).
    window : int, optional
        BBRF window in rows; by default the larger of 1000 and 20 per parameter, at most half the rows.
    reference : mapping of str to float, optional
        Parameter values from which effects that depend on the load take the load; the URDF's own by default.
    force : bool
        Go on in spite of an issue of `frischid.checks` that is certain and makes the logs worthless.
    controller : PDController, optional
        Makes the torque of logs that hold commanded positions and no torque.
    currents : CurrentGains, optional
        Torque per ampere of joints whose logs hold currents and no torque. A gain that is not given is found from the
        URDF's masses (`frischid.model.unknown_gains`).
    criteria : IdentificationCriteria
    prior_criteria : PriorCriteria
    alarm_criteria : AlarmCriteria

    Raises
    ------
    InputError
        An option has no such value, or two options exclude each other.
    """

    torque_joints: Sequence[str] | None = None
    cutoff: Cutoff = "auto"
    torque_lag: float | Literal["auto"] = "auto"
    velocity: str = "auto"
    estimator: str = "wls"
    prior: str | None = None
    recursion: str = "strict"
    window: int | None = None
    reference: Mapping[str, float] | None = None
    force: bool = False
    controller: PDController | None = None
    currents: CurrentGains | None = None
    criteria: IdentificationCriteria = field(default_factory=IdentificationCriteria)
    prior_criteria: PriorCriteria = field(default_factory=PriorCriteria)
    alarm_criteria: AlarmCriteria = field(default_factory=AlarmCriteria)

    def __post_init__(self) -> None:
        for kind, name, known in (
            ("estimator", self.estimator, ESTIMATORS),
            ("recursion", self.recursion, RECURSIONS),
            ("prior", self.prior or "none", PRIORS),
            ("velocity", self.velocity, VELOCITIES),
        ):
            if name not in known:
                raise UnknownNameError(kind, name, known)
        for name in ("cutoff", "torque_lag"):
            if isinstance(x := getattr(self, name), np.number):  # a model file holds Python's numbers
                object.__setattr__(self, name, x.item())
        if isinstance(self.cutoff, bool) or not (self.cutoff in (None, "auto") or isinstance(self.cutoff, int | float)):
            raise InputError(f"cutoff must be a frequency in Hz, 'auto' or None, got {self.cutoff!r}")
        lag = self.torque_lag
        if lag != "auto" and not (is_number(lag) and abs(lag) <= LONGEST_TORQUE_LAG):
            raise InputError(f"torque_lag must be a time in s between -1 and 1, or 'auto', got {lag!r}")
        if self.prior == "urdf" and self.estimator != "wls":
            raise InputError(f"a prior needs the estimator wls, not {self.estimator}; leave one of the two out")

    @property
    def known_torque_lag(self) -> float:
        """The given lag of the torque, s; 0 where the logs are to show one."""
        return 0.0 if self.torque_lag == "auto" else float(self.torque_lag)

    @property
    def with_prior(self) -> bool:
        """Whether the URDF is a prior."""
        return self.estimator == "wls" and self.prior != "none"

    @property
    def criteria_used(self) -> dict[str, object]:
        """The numbers that decide as plain JSON values, for the history of a model."""
        return {
            "identification": self.criteria.to_dict(),
            "prior": self.prior_criteria.to_dict(),
            "alarms": self.alarm_criteria.to_dict(),
        }
