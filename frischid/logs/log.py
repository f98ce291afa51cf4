"""A log: position, velocity, torque or command of every joint, sample by sample, exactly as measured.

A log is the sequence ``(t_k, q_k, q̇_k, q̈_k, τ_k, i_k)`` of J joints at N instants. It is frozen. An unusable value
(NaN, infinity, uninitialised memory, time running backwards) is an error that names its place; frischid never repairs
such a value silently. `frischid.checks` finds values that are only suspicious: degrees read as radians, stamps of
arrival, a constant torque.

In a table every column has a name: ``t``, ``q_<joint>``, ``v_<joint>``, ``a_<joint>``, ``tau_<joint>``,
``current_<joint>``, ``qcmd_<joint>``, ``vcmd_<joint>``, ``tauff_<joint>``, and any other name for other measurements.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError
from frischid.logs.log_file import LogFile
from frischid.logs.torque_instead import torque_instead

Place = Callable[[int], str]

MEASURED_CHANNELS = ("q", "v", "a", "tau", "current")
COMMANDED_CHANNELS = ("qcmd", "vcmd", "tauff")
CHANNELS = (*MEASURED_CHANNELS, *COMMANDED_CHANNELS)
FEWEST_SAMPLES = 10
GARBAGE = 1e12
"""Largest value in SI units that a robot's channel can have; a larger one is uninitialised memory."""
DEAD_TORQUE = 1e-150
"""N·m or N. A torque that never exceeds this is zero or uninitialised memory: the squares of such numbers vanish. A
robot of a tenth of a millimetre still has torques of 1e-16."""
STANDSTILL_SPAN = 1e-3
"""rad or m. A joint whose position spans less than this has not moved."""


@dataclass(frozen=True, eq=False, repr=False)
class Log:
    """Measurements of N samples of J joints, read-only.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Time stamps [s], strictly increasing.
    joints : tuple of str
        The J joint names, the order of all columns below.
    q : ndarray, shape (N, J)
        Positions [rad or m].
    v, a : ndarray, shape (N, J), or None
        Velocities and accelerations, where measured.
    tau : ndarray, shape (N, J), or None
        Joint-side torques [N·m] or forces [N].
    current : ndarray, shape (N, J), or None
        Motor currents [A], in the joint's positive direction.
    qcmd, vcmd : ndarray, shape (N, J), or None
        Commanded positions [rad or m] and velocities; a controller makes a torque of them
        (`frischid.PDController`).
    tauff : ndarray, shape (N, J), or None
        Commanded feed-forward torques [N·m] or forces [N].
    empty : tuple of str
        Channels of joints whose column was there and held no value: ``tau_<joint>``.
    extra : mapping of str to ndarray, shape (N,)
        Other numeric columns by name, for example ``temperature_<joint>``.
    source : str
        File path or description, the name of this log in messages.
    sha256 : str or None
        Hash of the file that the log was read from, or of a part of it.
    notes : tuple of str
        Conversions, and columns that were left out.
    file : LogFile or None
        The file from which the log can be read again; None for samples of another origin, such as a part of a log.

    Notes
    -----
    If a joint lacks a channel, its column there is NaN (see `has`); a channel that every joint lacks is None.

    Raises
    ------
    InputError
        Shapes or names disagree, the stamps do not increase, or a value is unusable (NaN, infinity, above 1e12).

    Examples
    --------
    >>> import numpy as np
    >>> import frischid as fr
    >>> t = np.arange(0.0, 1.0, 0.01)
    >>> log = fr.Log(t, ("elbow",), q=np.sin(t)[:, None], tau=2 * np.cos(t)[:, None], source="swing")
    >>> log
    Log('swing': 100 samples, 0.99 s at 100 Hz, q, tau of elbow)
    >>> log.has("v"), len(log.slice(20, 50))
    (array([False]), 30)
    """

    t: Array
    joints: tuple[str, ...]
    q: Array
    v: Array | None = None
    a: Array | None = None
    tau: Array | None = None
    current: Array | None = None
    extra: Mapping[str, Array] = field(default_factory=dict)
    source: str = "log"
    sha256: str | None = None
    notes: tuple[str, ...] = ()
    file: LogFile | None = None
    qcmd: Array | None = None
    vcmd: Array | None = None
    tauff: Array | None = None
    empty: tuple[str, ...] = ()

    @cached_property
    def identity(self) -> str:
        """Hash of the log's file, or of its samples if the log was made in memory."""
        if self.sha256 is not None:
            return self.sha256
        digest = hashlib.sha256(repr(self.joints).encode())
        for x in (self.t, *(getattr(self, channel) for channel in MEASURED_CHANNELS)):
            digest.update(b"-" if x is None else np.ascontiguousarray(x).tobytes())
        commanded = {channel: x for channel in COMMANDED_CHANNELS if (x := getattr(self, channel)) is not None}
        for name, x in {**commanded, **self.extra}.items():
            digest.update(repr(name).encode() + np.ascontiguousarray(x).tobytes())
        return digest.hexdigest()

    def __post_init__(self) -> None:
        if self.q is None or self.t is None:
            raise InputError(f"{self.source}: a log needs times t and positions q")
        self._put(joints=tuple(self.joints), notes=tuple(self.notes), t=_read_only(self.t))
        self._put(**{channel: _read_only(x) for channel, x in self._channels().items()})
        self._put(extra=MappingProxyType({name: _read_only(x) for name, x in self.extra.items()}))
        self._check_shapes()
        check_times(self.t, self.source)
        self._put(**{channel: None for channel in self._channels() if not self.has(channel).any()})
        for name, values in self.to_table().items():
            check_values(name, values, self.source)

    def _put(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _channels(self) -> dict[str, Array]:
        return {c: x for c in CHANNELS if (x := getattr(self, c)) is not None}

    def _check_shapes(self) -> None:
        """Check that shapes agree, names are unique, and no extra column has a name that means something else."""
        N, J = self.t.size, len(self.joints)
        columns = {"t": self.t} | {f"extra '{name}'": x for name, x in self.extra.items()}
        for name, values in (columns | self._channels()).items():
            shape = (N,) if name in columns else (N, J)
            if values.shape != shape:
                raise InputError(
                    f"{self.source}: {name} has shape {values.shape}, expected {shape} "
                    f"({N} samples, {J} joints: {', '.join(self.joints)})"
                )
        if J == 0 or len(set(self.joints)) < J:
            raise InputError(f"{self.source}: a log needs one or more joints with different names, got {self.joints}")
        taken = {"t"} | {f"{c}_{joint}" for c in CHANNELS for joint in self.joints}
        if clash := sorted(taken & set(self.extra)):
            raise InputError(f"{self.source}: extra columns may not be called {', '.join(clash)}; rename them")

    def __len__(self) -> int:
        return self.t.size

    def __repr__(self) -> str:
        return (
            f"Log({self.source!r}: {len(self)} samples, {self.duration:.4g} s at {self.rate:.4g} Hz, "
            f"{', '.join(self._channels())} of {', '.join(self.joints)})"
        )

    def __reduce__(self) -> tuple[type[Log], tuple[Any, ...]]:
        """Pickle as a call of the constructor, so that a worker's copy is checked and read-only too."""
        values = {f.name: getattr(self, f.name) for f in fields(self)} | {"extra": dict(self.extra)}
        return Log, tuple(values.values())

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def rate(self) -> float:
        """Sampling rate [Hz] of the median time step."""
        return float(1.0 / np.median(np.diff(self.t)))

    def has(self, channel: str) -> NDArray[np.bool_]:
        """Whether each joint has `channel`.

        Parameters
        ----------
        channel : {"q", "v", "a", "tau", "current", "qcmd", "vcmd", "tauff"}

        Returns
        -------
        ndarray of bool, shape (J,)
        """
        if channel not in CHANNELS:
            raise UnknownNameError("channel", channel, CHANNELS)
        if channel == "q":
            return np.ones(len(self.joints), dtype=bool)
        values: Array | None = getattr(self, channel)
        if values is None:
            return np.zeros(len(self.joints), dtype=bool)
        return np.asarray(~np.isnan(values).all(axis=0))

    def index(self, joints: Iterable[str]) -> list[int]:
        """Column indices of joint names; an unknown name is an `UnknownNameError`."""
        where = {name: j for j, name in enumerate(self.joints)}
        wanted = list(joints)
        for name in wanted:
            if name not in where:
                raise UnknownNameError("joint", name, where, self.source)
        return [where[name] for name in wanted]

    def select(self, joints: Iterable[str]) -> Log:
        """Keep these joints, in this order; extra columns stay."""
        columns = self.index(joints)
        kept: dict[str, Any] = {channel: x[:, columns] for channel, x in self._channels().items()}
        return replace(self, joints=tuple(self.joints[j] for j in columns), **kept)

    def slice(self, start: int | None = None, stop: int | None = None) -> Log:
        """Keep the samples with index ``start <= k < stop``, as Python slices do.

        A part has a hash of its own: two parts of one log are two logs, of which one can be held out.
        """
        rows = slice(start, stop)
        first, last, _ = rows.indices(len(self))
        kept: dict[str, Any] = {channel: x[rows] for channel, x in self._channels().items()}
        if self.sha256 is not None and last - first < len(self):
            kept["sha256"] = hashlib.sha256(f"{self.sha256} {first} {last}".encode()).hexdigest()
        return replace(self, t=self.t[rows], extra={n: x[rows] for n, x in self.extra.items()}, file=None, **kept)

    def to_table(self) -> dict[str, Array]:
        """All columns by name, ``t`` first; a channel that a joint lacks has no column."""
        table = {"t": self.t}
        for channel, values in self._channels().items():
            present = self.has(channel)
            table |= {f"{channel}_{n}": values[:, j] for j, n in enumerate(self.joints) if present[j]}
        return table | dict(self.extra)


def _read_only(values: ArrayLike) -> Array:
    """A contiguous, read-only copy; an array that is already read-only is shared."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.flags.writeable:
        array = array.copy() if np.shares_memory(array, values) else array
        array.flags.writeable = False
    return array


def row_place(row: int) -> str:
    """Place of a sample as text; rows count from 1."""
    return f"row {row + 1}"


def is_usable(values: Array) -> NDArray[np.bool_]:
    """Whether each value is finite and of a plausible size."""
    # NaN compares false and infinity is large, so one comparison finds both.
    return np.asarray(np.abs(values) <= GARBAGE)


def check_values(name: str, values: Array, source: str, place: Place = row_place) -> None:
    """Refuse a column with NaN, infinity or garbage; the `InputError` names the first such row."""
    usable = is_usable(values)
    if usable.all():
        return
    row = int(np.argmin(usable))
    value, count = values[row], int((~usable).sum())
    if name == "t" and np.isfinite(values).all() and (values > GARBAGE).all():
        raise InputError(
            f'{source}: the stamps are {value:g} and more: they are not seconds; say time_unit = "ns" (or us, ms) and '
            "zero_time = true under [file] in a mapping file"
        )
    what = "nan or an empty cell" if np.isnan(value) else f"{value:g}"
    why = f", above {GARBAGE:g} and so not a measurement" if np.isfinite(value) else ""
    raise InputError(
        f"{source}: {place(row)}, column '{name}' holds {what}{why} "
        f"({count} of {values.size} values of the column are unusable); remove those rows or record it again"
    )


def check_times(t: Array, source: str, place: Place = row_place, name: str = "t") -> None:
    """Refuse time stamps that are too few, unusable or not strictly increasing; the error names row and stamps."""
    if t.size < FEWEST_SAMPLES:
        raise InputError(f"{source}: {t.size} samples; a log needs at least {FEWEST_SAMPLES}")
    check_values(name, t, source, place)
    step = np.diff(t)
    wrong = step <= 0
    if not wrong.any():
        return
    row = int(np.argmax(wrong)) + 1
    repeats, backwards = int((step == 0).sum()), int((step < 0).sum())
    raise InputError(
        f"{source}: time does not increase at {place(row)}: '{name}' is {t[row]!s} after {t[row - 1]!s} "
        f"({repeats} repeated stamps, {backwards} steps backwards in all); remove the repeated rows, "
        "or split the log where the clock was set back"
    )


def check_motion(log: Log) -> None:
    """Refuse a log in which every joint's position spans less than `STANDSTILL_SPAN`."""
    span = np.ptp(log.q, axis=0)
    if (span < STANDSTILL_SPAN).all():
        raise InputError(
            f"{log.source}: no joint moves (largest range {span.max():.3g} rad); dynamics need motion: "
            "check the position columns and their unit, or record an exciting trajectory"
        )


def check_torque(log: Log, joints: Sequence[str] | None = None, *, fitted: bool = False) -> None:
    """Refuse a log without any torque to fit.

    Parameters
    ----------
    joints : sequence of str, optional
        Joints that must have a torque, all by default.
    fitted : bool
        Whether the log is for a model that was fitted to torques: such a model has no controller.
    """
    wanted = log.joints if joints is None else tuple(joints)
    present = [j for j in log.index(wanted) if log.has("tau")[j]]
    if log.tau is None or not present:
        columns = list(log.to_table())
        remedy = torque_instead(columns, log.joints, fitted)
        raise InputError(
            f"{log.source}: no torque column (tau_<joint>) for {', '.join(wanted)}; {remedy}; "
            f"the log has {', '.join(columns)}"
        )
    if not log.tau[:, present].any():
        names = ", ".join(f"tau_{log.joints[j]}" for j in present)
        raise InputError(f"{log.source}: the torque is zero throughout in {names}; was it recorded at all?")
