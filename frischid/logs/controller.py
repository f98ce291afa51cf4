"""A joint's controller as a torque sensor: commanded and measured positions become the torque of the drive.

    τ_j(t) = clip( kp_j dead(q_cmd,j(t − d) − q_j) + kd_j (v_cmd,j(t − d) − q̇_j) + τ_ff,j(t − d),  ±limit_j )

dead(e) is e outside of a dead band ±b and moved by b towards zero, and zero inside of it. A log without commanded
velocities has v_cmd = 0: the drive damps the joint's own velocity, as most position servos do. d is the delay of the
command. The log then has a torque like that of a sensor, and every later stage is the same for both.

The measured q̇ is used where the log has one, otherwise the slope of the cubic spline through the positions. Noise in
this slope does no harm: the parallel filter that follows is linear, and it filters torque and regressor alike.

Source: Franklin, Powell and Emami-Naeini 2019, Feedback Control of Dynamic Systems, 8th edition, Pearson; Gautier and
Janot 2013 use the same law to know the torque of a simulated loop, IEEE Trans. Control Systems Technology 21(2).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from frischid.core.files import read_toml
from frischid.core.text import counted, shortened
from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError
from frischid.logs.command_checks import check_commands, check_delay
from frischid.logs.controller_values import check_limits, check_value, opened, shown_value
from frischid.logs.delayed_commands import delayed, velocity_of
from frischid.logs.log import Log
from frischid.logs.wraps import commands_unwrapped

PUSH_RATE = "controller_push_rate_"
"""Channel of a joint in a driven log: rate of the torque that follows from commands alone, N·m/s (N/s)."""
REST = "controller_rest_"
"""Channel of a joint in a driven log: torque that the position error does not cause, N·m (N)."""
VELOCITY_COMMAND = "controller_velocity_command_"
"""Channel of a joint whose kd is open, in a driven log: commanded velocity as it acts, rad/s (m/s); 0 without one."""
Gains = float | Mapping[str, float]
"""One value for all joints, or a value for each joint named."""
_ROUNDED_STEP = 1e-3  # of a step
SPLINE_SAMPLES = 20
"""Samples beyond which a cubic spline's slope no longer depends on a sample: its influence falls by 0.27 a sample."""


@dataclass(frozen=True)
class PDController:
    """A proportional-derivative position controller, or a position servo, of each joint.

    Attributes
    ----------
    kp : float, mapping of str to float, or None
        Torque per position error, N·m/rad (N/m); None: unknown, `frischid.identify` finds it.
    kd : float, mapping of str to float or None, or None
        Torque per velocity error, N·m·s/rad (N·s/m); None: unknown, `frischid.identify` finds it, or its sum with the
        joint's viscous friction. The torque that `drive` computes lacks this part.
    limit : float or mapping of str to float, optional
        Largest torque, N·m (N); None: no limit.
    dead_band : float or mapping of str to float
        Position error below which the servo does not push, rad (m).
    delay : float, mapping of str to float, or None
        Age of a command when it acts, s; None: unknown, `frischid.identify` finds one delay of all joints.
    kp_doubt : float or mapping of str to float
        Standard error of a kp that was found, as a share of it; 0: the kp was given.
    delay_doubt : float or mapping of str to float
        Standard error of the delay, s; 0: the delay is exact.
    kd_near : float or mapping of str to float
        Where kd is open, its value in the torque that a doubtful delay shifts, N·m·s/rad (N·s/m); `frischid.identify`
        finds it.
    delay_told : float, optional
        The delay that the user named, s, where `frischid.identify` found that the logs put a doubtful delay elsewhere.
    held : bool
        Whether the drive keeps each command until the next one, over a step of the log. The delay is then that of the
        moment at which a command begins to act.

    Raises
    ------
    InputError
        A gain has the wrong sign, or is not a number.

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> controller = fr.PDController(kp=20.0, kd=1.5, limit={"elbow": 23.0})
    >>> t = np.arange(0.0, 1.0, 0.01)
    >>> log = fr.Log(t, ("elbow",), q=np.zeros((100, 1)), qcmd=0.1 * np.sin(t)[:, None])
    >>> driven = controller.drive(log)
    >>> bool(np.allclose(driven.tau, 20.0 * log.qcmd))
    True
    """

    kp: Gains | None = None
    kd: float | Mapping[str, float | None] | None = 0.0
    limit: Gains | None = None
    dead_band: Gains = 0.0
    delay: Gains | None = 0.0
    kp_doubt: Gains = 0.0
    delay_doubt: Gains = 0.0
    kd_near: Gains = 0.0
    delay_told: float | None = None
    held: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.held, bool):
            raise InputError(f"the controller's held must be true or false, got {shortened(self.held)}")
        for rule in _numbers():
            given = getattr(self, rule.name)
            if given is None and rule.name in ("kp", "kd", "limit", "delay", "delay_told"):
                continue
            values = dict(given) if isinstance(given, Mapping) else {"": given}
            for joint, value in values.items():
                if value is not None or rule.name != "kd":
                    check_value(rule.name, joint, value)
            plain = {joint: None if x is None else float(x) for joint, x in values.items()}
            object.__setattr__(self, rule.name, plain if isinstance(given, Mapping) else plain[""])

    def __str__(self) -> str:
        """The controller as the command line writes it."""
        unsaid = ("held", "kp_doubt", "delay_doubt", "kd_near", "delay_told")
        known = {name: x for name, x in self.to_dict().items() if name not in unsaid}
        shown = [f"{name} {shown_value(x)}" for name, x in known.items()] + ["held commands"] * self.held
        return f"pd({', '.join(shown)})"

    def knows_gain(self, joint: str) -> bool:
        """Whether the kp of a joint is known, so that its commands become torques."""
        return self.kp is not None and (not isinstance(self.kp, Mapping) or joint in self.kp)

    def knows_damping(self, joint: str) -> bool:
        """Whether the kd of a joint is known; a joint that a mapping does not name has the kd 0."""
        return self.kd is not None and (not isinstance(self.kd, Mapping) or self.kd.get(joint, 0.0) is not None)

    def gain(self, joint: str) -> float:
        """The kp of a joint, N·m/rad (N/m)."""
        return float(self.values("kp", [joint])[0])

    def gain_doubt(self, joint: str) -> float:
        """Standard error of a joint's kp, as a share of it; 0 where the kp was given."""
        return float(self.values("kp_doubt", [joint])[0])

    def check_joints(self, joints: Iterable[str]) -> None:
        """Refuse a value of a joint that the robot does not have.

        Raises
        ------
        UnknownNameError
            A gain, a limit or a delay names another joint; the message lists the robot's joints.
        """
        valid = list(joints)
        for rule in _numbers():
            given = getattr(self, rule.name)
            for name in given if isinstance(given, Mapping) else ():
                if name not in valid:
                    raise UnknownNameError("joint", name, valid, f"the controller's {rule.name}")

    def values(self, name: str, joints: Sequence[str]) -> Array:
        """One quantity of the controller for these joints, (J,).

        Parameters
        ----------
        name : {"kp", "kd", "limit", "dead_band", "delay", "kp_doubt", "delay_doubt", "kd_near"}
        joints : sequence of str

        Raises
        ------
        InputError
            kp is not known, or not known of one of the joints; or the delay is not known. A kd that is not known is 0.
        """
        given, missing = getattr(self, name), {"limit": np.inf}.get(name, 0.0)
        if given is None and name == "delay":
            raise InputError("the controller's delay is not known: identify finds it (--delay auto), or give it in s")
        if given is None:
            given = {}
        if not isinstance(given, Mapping):
            return np.full(len(joints), float(given))
        absent = [j for j in joints if j not in given]
        if name == "kp" and absent:
            raise InputError(
                f"the controller's kp of {', '.join(absent)} is not known: give --kp JOINT=VALUE (kp={{...}}) for each "
                "joint that takes commands, or one value for all"
            )
        found = [missing if (x := given.get(j, missing)) is None else float(x) for j in joints]
        return np.array(found)

    def drive(self, log: Log, *, whole: bool = True) -> Log:
        """The log with the torque that the controller gives.

        A joint whose torque was measured keeps it, and so does a joint without commands. Samples before the first
        command acts are left out: the commands that act there were not recorded.

        Parameters
        ----------
        log : Log
        whole : bool
            Whether the log is no chunk of a longer one. In a chunk, no command needs to move.

        Returns
        -------
        Log
            The same log where no joint needs a torque.

        Raises
        ------
        InputError
            The commands never change, or the delay is longer than `MOST_DELAY_STEPS` steps; or a joint has an effort
            limit and an unknown kd.
        """
        unmoved = self._unmoved_by_delay(log) if isinstance(log, Log) else {}
        columns = commanded(log) if isinstance(log, Log) else []
        if not columns:
            return replace(log, extra={**log.extra, **unmoved}, sha256=log.identity) if unmoved else log
        turning = commands_unwrapped(log)
        check_commands(turning, whole=whole)
        tau = np.full(log.q.shape, np.nan) if log.tau is None else log.tau.copy()
        tau[:, columns], extra = self._torque(turning, columns)
        said = f"torque of {counted(len(columns), 'joint')} from their commands by the controller {self}"
        late = float(self.values("delay", [log.joints[j] for j in columns]).max()) + self.held / log.rate
        early = log.t - late < log.t[0] - _ROUNDED_STEP / log.rate  # the commands that act there were not recorded
        found = replace(log, tau=tau, extra={**log.extra, **unmoved, **extra}, notes=(*log.notes, said))
        # the file gives these samples again
        return replace(found.slice(int(early.sum())), file=log.file, sha256=log.identity)

    def _unmoved_by_delay(self, log: Log) -> dict[str, Array]:
        """Channels of joints whose torque was measured: a delay of commands, where it is in doubt, changes nothing."""
        doubts = self.values("delay_doubt", log.joints)
        measured = [n for n, tau, s in zip(log.joints, log.has("tau"), doubts, strict=True) if tau and s > 0]
        return {PUSH_RATE + n: np.zeros(len(log)) for n in measured if PUSH_RATE + n not in log.extra}

    def _torque(self, log: Log, columns: list[int]) -> tuple[Array, dict[str, Array]]:
        """Torque of the joints with these indices, and their channels for `frischid.effects.commands`."""
        joints = [log.joints[j] for j in columns]
        delay = self.values("delay", joints)
        check_delay(delay, joints, log)

        def command(channel: str) -> Array:
            x = getattr(log, channel)
            if x is None:
                return np.zeros((len(log), len(columns)))
            known = np.nan_to_num(x[:, columns])  # a joint without this channel has NaN there
            late = [delayed(log.t, known[:, k], d, self.held) for k, d in enumerate(delay)]
            return np.column_stack(late)

        goal = command("qcmd")
        error = goal - log.q[:, columns]
        band = self.values("dead_band", joints)
        error = np.sign(error) * np.maximum(np.abs(error) - band, 0.0)
        kp, kd, ahead = self.values("kp", joints), self.values("kd", joints), command("tauff")
        rest, push = ahead, kp * goal + ahead
        if kd.any():
            wanted = kd * command("vcmd")
            rest, push = rest + wanted - kd * velocity_of(log)[:, columns], push + wanted
        limit = self.values("limit", joints)
        extra = {f"{REST}{j}": rest[:, k] for k, j in enumerate(joints)}
        open_damping = [k for k, j in enumerate(joints) if not self.knows_damping(j)]
        if open_damping:
            wanted = command("vcmd")
            extra |= {f"{VELOCITY_COMMAND}{joints[k]}": wanted[:, k] for k in open_damping}
            check_limits(limit[open_damping], [joints[k] for k in open_damping])
            push = push + self.values("kd_near", joints) * wanted
        rate = np.gradient(push, log.t, axis=0)
        extra |= {f"{PUSH_RATE}{j}": rate[:, k] for k, j in enumerate(joints)}
        return np.asarray(np.clip(kp * error + rest, -limit, limit)), extra

    def to_dict(self) -> dict[str, Any]:
        """The quantities that are not at their defaults, as plain JSON values."""
        return {f.name: x for f in fields(self) if (x := getattr(self, f.name)) not in (f.default, {})}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "controller") -> PDController:
        """Inverse of `to_dict`.

        Raises
        ------
        InputError
            A key is unknown, or a value is not usable.
        """
        known = [f.name for f in fields(cls)]
        for key in data:
            if key not in known:
                raise UnknownNameError("key", key, known, source)
        values = {key: opened(key, value) for key, value in data.items()}
        for key, value in values.items():
            if isinstance(value, str | list) or (isinstance(value, bool) and key != "held"):
                raise InputError(
                    f"{source}: {key} = {shortened(value)}, expected a number, or a table with a number per joint"
                )
        return cls(**values)

    @classmethod
    def load(cls, path: str | Path) -> PDController:
        """Read a controller from a TOML file: ``kp = 20.0``, or a table ``[kp]`` with a line per joint.

        ``kd = "auto"`` leaves kd open, and so does ``joint1 = "auto"`` in a table ``[kd]``.

        Raises
        ------
        InputError
            The file cannot be read, or is not such a file.
        """
        return cls.from_dict(read_toml(path, "controller")[0], str(path))


def commanded(log: Log) -> list[int]:
    """Indices of the joints of a log whose torque follows from commands."""
    return [int(j) for j in np.flatnonzero(log.has("qcmd") & ~log.has("tau"))]


def _numbers() -> list[Field[Any]]:
    """The quantities that are numbers, of all joints or by joint."""
    return [rule for rule in fields(PDController) if rule.name != "held"]
