"""Which missing effect lets the simulated robot go astray: every finding of a diagnosis is added, and simulated.

With r the torque that the model lacks along the measured motion, the error e = q − q_sim of the simulated motion obeys,
to first order,

    M ë + D ė + K e = r(t),      K = ∂τ/∂q + kp,   D = ∂τ/∂q̇ + kd,

with the controller's gains kp and kd in closed loop, and zero in open loop. So the effects that explain r are those
that explain e, and the search of `frischid.diagnosis.diagnosis` serves both: its ranking and its probabilities need no
simulation. But r and e weigh frequencies and joints differently, and a user of the simulated motion wants to know the
error of the motion. So each finding that adds likelihood is added to the model, the model is fitted again, and both
simulate the logs: over stretches of the same length, from the measured state.

Sources: as `frischid.diagnosis.diagnosis`; Ljung 1999, System Identification, 2nd edition, section 3.2, on errors of
one-step prediction and of simulation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from frischid.core.shown import Shown
from frischid.core.threads import on_one_thread
from frischid.diagnosis.addition import trial
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.result import Diagnosis
from frischid.errors import InputError
from frischid.forward.commanded_motion import follows_commands
from frischid.forward.shooting import OutputErrorOptions, Shooting
from frischid.logs.given import Logs, as_logs
from frischid.logs.log import Log
from frischid.logs.mapping import MappingLike
from frischid.logs.poses import need_motion
from frischid.logs.recording import Recording
from frischid.model.model import Model
from frischid.model.model_argument import check_model

HORIZON = 1.0
"""s. Length of a simulated stretch by default: an arm of a metre swings once."""


@dataclass(frozen=True)
class SimulatedFinding:
    """A finding with the simulated motion of the model that has it.

    Attributes
    ----------
    finding : Finding
    joints : dict of str to float
        Rms error of the simulated positions with the effect added, rad (m); empty where it cannot be simulated.
    change : float
        Mean over the joints of the logarithm of the error with the effect over the error without; 0 where it cannot be
        simulated.
    refused : str
        Why the model with this effect cannot be simulated; empty where it can.
    """

    finding: Finding
    joints: dict[str, float]
    change: float
    refused: str = ""

    @property
    def ratio(self) -> float:
        """Error of the simulated motion with the effect over the error without: geometric mean over the joints."""
        return float(np.exp(self.change))

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        known = None if self.refused else {"joints": self.joints, "ratio": self.ratio}
        return {
            "effect": self.finding.effect,
            "where": list(self.finding.joints),
            "probability": self.finding.probability,
            "simulated": known,
            "refused": self.refused,
        }


@dataclass(frozen=True, eq=False)
class MotionDiagnosis(Shown):
    """Result of `simulate_findings`.

    Attributes
    ----------
    diagnosis : Diagnosis
        Verdict, ranking and probabilities.
    joints : dict of str to float
        Rms error of the positions that the model simulates, rad (m).
    findings : tuple of SimulatedFinding
        The findings that add likelihood, in the diagnosis's order.
    horizon : float
        Length of the simulated stretches, s.
    closed : bool
        Whether the model's controller gave the torque; otherwise the recorded torque did.
    tested : bool
        Whether the simulated logs are test logs; otherwise the logs that the models were fitted to.

    Examples
    --------
    >>> import frischid as fr
    >>> robot, spring = fr.Robot.load("planar2"), fr.parse_effects("joint_spring@joint2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=50, effects=(*fr.BASELINE, *spring),
    ...                   parameters={"ks2": 1.5}, noise=fr.Noise(q=1e-5, tau=0.01))
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> found = fr.simulate_findings(model, fr.diagnose(model, [log], effects=["joint_spring"]), [log])
    >>> found.findings[0].finding.effect, found.findings[0].ratio < 0.5, found.closed
    ('joint_spring', True, False)
    """

    diagnosis: Diagnosis
    joints: dict[str, float]
    findings: tuple[SimulatedFinding, ...]
    horizon: float
    closed: bool
    tested: bool

    def __repr__(self) -> str:
        named = [f"{f.finding.effect}: simulated error x {f.ratio:.2f}" for f in self.findings[:1] if not f.refused]
        return f"MotionDiagnosis({': '.join([self.diagnosis.verdict, *named])})"

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "horizon_s": self.horizon,
            "closed_loop": self.closed,
            "on": "test logs" if self.tested else "fitted logs",
            "joints": self.joints,
            "findings": [f.to_dict() for f in self.findings],
        }


@on_one_thread
def simulate_findings(
    model: Model,
    found: Diagnosis,
    logs: Logs,
    *,
    valid: Logs = (),
    horizon: float = HORIZON,
    progress: Callable[[str], None] = lambda _: None,
    mapping: MappingLike = None,
) -> MotionDiagnosis:
    """Add each finding of a diagnosis to the model, and simulate the motion with it and without it.

    Parameters
    ----------
    model : Model
        With a controller: its commands are simulated in closed loop. Without: the recorded torque, in open loop.
    found : Diagnosis
        Of this model.
    logs : sequence of Log, Recording or data frame, or one data frame
        The logs of the diagnosis; each model with an effect is fitted to them.
    valid : sequence of Log, Recording or data frame, or one data frame
        Test logs: the simulated errors are those on them, and nothing else uses them.
    horizon : float
        Length of a simulated stretch, s.
    progress : callable
        Called with a few words at each stage.
    mapping : LogMap, mapping or path of a TOML file, optional
        Names and units of the columns of data frames.

    Returns
    -------
    MotionDiagnosis

    Raises
    ------
    InputError
        The horizon is not positive, or the model cannot be simulated, or its simulated motion is unstable.

    Examples
    --------
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=50, noise=fr.Noise(q=1e-5, tau=0.01))
    >>> model = fr.identify(robot, [log], recursion="none").model
    >>> found = fr.simulate_findings(model, fr.diagnose(model, [log], effects=["joint_spring"]), [log])
    >>> found.diagnosis.verdict, max(found.joints.values()) < 0.05
    ('none', True)
    """
    check_model(model)
    logs, valid = as_logs(logs, model.robot.joints, mapping), as_logs(valid, model.robot.joints, mapping, "valid")
    options = OutputErrorOptions(horizon=horizon)
    shown = need_motion(list(valid or logs), model.robot.joints)
    progress("simulating the model")
    before = simulated_error(model, shown, options)
    findings = []
    for finding in [f for f in found.findings if f.members and f.gain > 0]:
        progress(f"simulating {finding.effect}")
        findings.append(_simulated(model, found, finding, logs, (shown, options), before))
    closed = all(follows_commands(model.controller, log, model.robot.joints) for log in shown)
    return MotionDiagnosis(found, before, tuple(findings), horizon, closed, bool(valid))


def simulated_error(
    model: Model, logs: Sequence[Log | Recording], options: OutputErrorOptions | None = None
) -> dict[str, float]:
    """Rms error of the simulated positions over stretches of some logs, each from its measured state.

    Parameters
    ----------
    options : OutputErrorOptions, optional
        Length of the stretches, and how many.

    Returns
    -------
    dict of str to float
        Joint -> error, rad (m).

    Raises
    ------
    InputError
        The model cannot be simulated, or its simulated motion is unstable.
    """
    shooting = Shooting(model, logs, options or OutputErrorOptions(horizon=HORIZON))
    error = shooting.errors()
    if not np.isfinite(error).all():
        raise InputError(
            "the simulated motion is unstable: the torque moves the model away within one stretch; give a shorter "
            "horizon, or identify with the URDF as a prior first"
        )
    return dict(zip(model.robot.joints, error.tolist(), strict=True))


def _simulated(
    model: Model,
    found: Diagnosis,
    finding: Finding,
    logs: Sequence[Log | Recording],
    shown: tuple[Sequence[Log | Recording], OutputErrorOptions],
    before: dict[str, float],
) -> SimulatedFinding:
    """A finding of a diagnosis, added to the model and simulated."""
    try:
        model.check(logs)
        added = trial(model, finding.members, logs, found.situation, finding, found.criteria).refit.model
        after = simulated_error(added, *shown)
    except InputError as error:
        return SimulatedFinding(finding, {}, 0.0, str(error))
    least = np.finfo(float).tiny
    change = [np.log(max(after[n], least) / max(before[n], least)) for n in before]
    return SimulatedFinding(finding, after, float(np.mean(change)))
