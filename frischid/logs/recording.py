"""Logs of any length: read chunk by chunk, as often as needed, and never in memory as a whole.

A `Recording` represents a log that is too long for memory. All sums over samples work on its chunks. A filter of length
n needs n samples for one output, so the last samples of a chunk are carried into the next chunk. No sample is lost or
counted twice:

    chunk k:   … a b c d e f           filters see d, but not yet e and f
    chunk k+1:         c d e f g h …   begins where the last complete output ended

A log in memory has one chunk, itself. Three decisions depend on the samples and are made once per chunk: the grid's
step, whether the measured velocity is used, and the samples at standstill.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from frischid.core.remembered import Remembered
from frischid.errors import InputError
from frischid.logs.filters import LowPass
from frischid.logs.log import CHANNELS, FEWEST_SAMPLES, STANDSTILL_SPAN, Log
from frischid.logs.log_file import LogFile
from frischid.logs.mapping import LogMap, MappingLike
from frischid.logs.preprocessing import Motion, Prepared, ends_of, prepare
from frischid.logs.time_grid import breaks_of

RECORDING_CHUNK = 30_000
"""Samples in memory at once: half a minute at 1 kHz, 1.4 MB per channel of a six-joint arm."""
PREVIEW_SAMPLES = 256
"""Samples that are read to find the joints and channels of a recording."""
NOTES_SHOWN = 5
"""Notes of one recording that are printed; of further notes only the number is printed."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A log that is read chunk by chunk.

    Attributes
    ----------
    source : str
        File path or description, its name in messages.
    read : callable
        Takes a number of samples, and returns a new iterator over consecutive `Log` chunks of about that length.
    digest : callable, optional
        Computes the hash of the recording's file.
    file : LogFile, optional
        That file.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import frischid as fr
    >>> robot = fr.Robot.load("planar2")
    >>> log = fr.simulate(robot, fr.random_fourier(robot, 3.0, seed=0), rate=100.0)
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "log.parquet"
    ...     fr.write_log(log, path)
    ...     recording = fr.Recording.open(path, robot.joints)
    ...     [len(chunk) for chunk in recording.chunks(samples=150)], recording.preview().joints
    ([150, 151], ('joint1', 'joint2'))
    """

    source: str
    read: Callable[[int], Iterator[Log]]
    digest: Callable[[], str] | None = None
    file: LogFile | None = None

    @cached_property
    def identity(self) -> str | None:
        """Hash of the file, computed when first asked for."""
        return None if self.digest is None else self.digest()

    @classmethod
    def open(
        cls,
        path: str | Path,
        joints: Sequence[str] | None = None,
        mapping: MappingLike = None,
    ) -> Recording:
        """Recording of a file; arguments as for `frischid.logs.readers.read_chunks`, which reads the file."""
        from frischid.logs.layouts import layout_of
        from frischid.logs.readers import digest_of, file_behind, read_chunks

        form = LogMap.of(mapping)

        def read(samples: int) -> Iterator[Log]:
            return read_chunks(path, joints, form, samples=samples)

        # a missing file is an error when read
        file = file_behind(Path(path), layout_of(Path(path), form)) if Path(path).exists() else None
        return cls(str(path), read, lambda: digest_of(Path(path)), file)

    def chunks(self, samples: int | None = None) -> Iterator[Log]:
        """Read from the beginning, about `samples` samples (`RECORDING_CHUNK` by default) at a time."""
        return self.read(RECORDING_CHUNK if samples is None else samples)

    def preview(self) -> Log:
        """The first samples, which show the joints and channels of the recording."""
        for chunk in self.read(PREVIEW_SAMPLES):
            return chunk
        raise InputError(f"{self.source}: the recording holds no samples")


def chunks_of(log: Log | Recording) -> Iterator[Log]:
    """The chunks of a recording; a log is its own single chunk."""
    return iter((log,)) if isinstance(log, Log) else log.chunks()


def preview_of(log: Log | Recording) -> Log:
    """A log that has the joints and channels of a log or recording."""
    return log if isinstance(log, Log) else log.preview()


def moving_part(log: Log | Recording, joints: Iterable[str]) -> Log:
    """The first chunk in which all these joints move; the one in which most of them do where there is none."""
    names, found, most = list(joints), None, -1
    for chunk in chunks_of(log):
        moving = int((np.ptp(chunk.select(names).q, axis=0) >= STANDSTILL_SPAN).sum())
        if moving > most:
            found, most = chunk, moving
        if most == len(names):
            break
    if found is None:
        raise InputError(f"{log.source}: the recording holds no samples")
    return found


_PREPARED = Remembered[Prepared]()
"""Motions of logs in memory, by joints, cut-off, lag of the torque and choice of the velocity."""


class Motions:
    """Motions of logs and recordings, one at a time; every iteration reads the recordings anew.

    Parameters
    ----------
    joints : sequence of str
        The robot's joints, in its order.
    velocity : {"auto", "measured", "derived"}
    told : callable, optional
        Called with the number of samples that an iteration has read so far, after each log or chunk.

    Attributes
    ----------
    notes : list of str
        Changes made to the logs; complete after the first iteration.
    """

    def __init__(
        self,
        logs: Sequence[Log | Recording],
        joints: Sequence[str],
        lowpass: LowPass,
        velocity: str = "auto",
        told: Callable[[int], None] = lambda _: None,
    ) -> None:
        self.logs, self.joints, self.lowpass, self.velocity = tuple(logs), tuple(joints), lowpass, velocity
        self.told, self._passed = told, 0
        self.notes: list[str] = []

    def __iter__(self) -> Iterator[Motion]:
        notes: list[str] = []
        self._passed = 0
        for log in self.logs:
            said: list[str] = []
            yield from self._of(log, said)
            notes += brief(said, log.source)
        self.notes = notes

    def of(self, log: Log | Recording) -> Iterator[Motion]:
        """The motions of one of the logs."""
        return iter(Motions((log,), self.joints, self.lowpass, self.velocity))

    def _pass(self, chunk: Log) -> None:
        self._passed += len(chunk)
        self.told(self._passed)

    def _of(self, log: Log | Recording, notes: list[str]) -> Iterator[Motion]:
        if isinstance(log, Log):
            key = (self.joints, self.lowpass.cutoff, self.lowpass.torque_lag, self.velocity)
            prepared = _PREPARED.of(log, key, lambda: self._whole(log))
            notes += [*log.notes, *prepared.notes]
            yield from prepared.motions
            self._pass(log)
            return
        tail: tuple[Log, int] | None = None
        begin, found, at_end = None, False, ""
        for chunk in chunks_of(log):
            self._pass(chunk)
            begin = float(chunk.t[0]) if begin is None else begin
            chosen = chunk.select(self.joints)
            whole = chosen if tail is None else joined(*tail, chosen)
            notes += chunk.notes
            try:
                prepared = prepare(whole, self.lowpass, velocity=self.velocity, begin=begin, whole=False)
            except InputError as error:  # a chunk without a usable stretch is skipped
                notes.append(str(error))
                at_end = ""
                tail = _end(whole, int(breaks_of(whole, self.lowpass)[-1]))
                continue
            found, at_end = True, prepared.at_end
            notes += prepared.notes
            yield from prepared.motions
            tail = _end(whole, _resume(whole, prepared.motions[-1], self.lowpass))
        if not found:
            raise InputError(f"{log.source}: {notes[-1] if notes else 'no samples'}")
        notes += [at_end] if at_end else []

    def _whole(self, log: Log) -> Prepared:
        """The motions of a log in memory; nobody may write into them."""
        prepared = prepare(log.select(self.joints), self.lowpass, velocity=self.velocity)
        for motion in prepared.motions:
            for x in (motion.t, motion.q, motion.v, motion.a, motion.tau, motion.standstill, *motion.extra.values()):
                x.setflags(write=False)
        return prepared


def joined(first: Log, skip: int, second: Log) -> Log:
    """Two consecutive chunks as one log, without the first `skip` samples; only the second where channels differ."""
    same = first.joints == second.joints and set(first.extra) == set(second.extra)
    if not (same and all((first.has(c) == second.has(c)).all() for c in CHANNELS)):
        return second
    present = [c for c in CHANNELS if second.has(c).any()]
    channels: dict[str, Any] = {c: np.concatenate([getattr(first, c)[skip:], getattr(second, c)]) for c in present}
    extra = {name: np.concatenate([x[skip:], second.extra[name]]) for name, x in first.extra.items()}
    return replace(second, t=np.concatenate([first.t[skip:], second.t]), extra=extra, **channels)


def _resume(log: Log, motion: Motion, lowpass: LowPass) -> int:
    """Index of the first sample that the filter's next output needs."""
    taps, every = len(lowpass.taps(motion.step)), lowpass.decimation(motion.step)
    outputs = max(0, (len(motion.t) - taps) // every + 1)
    resume = motion.t[0] + (outputs * every - ends_of(motion.step, lowpass)[0]) * motion.step
    return max(int(np.searchsorted(log.t, resume - 1e-3 * motion.step)), int(breaks_of(log, lowpass)[-1]))


def _end(log: Log, first: int) -> tuple[Log, int]:
    """At least the samples from `first` on, and the number of earlier ones; a log has at least `FEWEST_SAMPLES`."""
    start = max(0, min(first, len(log) - FEWEST_SAMPLES))
    return log.slice(start), first - start


def brief(notes: Iterable[str], source: str) -> list[str]:
    """Each note once; of a log only the first few, and the number of the others."""
    kept = list(dict.fromkeys(notes))
    if len(kept) <= NOTES_SHOWN + 1:
        return kept
    return [*kept[:NOTES_SHOWN], f"{source}: {len(kept) - NOTES_SHOWN} more notes on this log"]


def check_logs(logs: Sequence[Log | Recording], valid: Sequence[Log | Recording]) -> None:
    """Refuse a log that is both fitted and held out, or that is named twice.

    Raises
    ------
    InputError
        A log is in both lists, or twice in one of them: its noise would count as two independent measurements.
    """
    for several in (logs, valid):
        for one, other in combinations(several, 2):
            if one is other or (one.identity is not None and one.identity == other.identity):
                names = one.source if one.source == other.source else f"{one.source} and {other.source}"
                raise InputError(f"{names}: the same log is given twice, and would count twice; leave one out")
    for held in valid:
        for log in logs:
            if held is log or _same(held, log):
                raise InputError(
                    f"{held.source} is both fitted and held out (--valid), so its error says nothing about new data; "
                    "leave one out"
                )


def _same(one: Log | Recording, other: Log | Recording) -> bool:
    """Whether two logs hold the same samples of all channels that both have; simulations repeat positions exactly."""
    if isinstance(one, Log) and isinstance(other, Log):
        channels = ((getattr(one, name), getattr(other, name)) for name in CHANNELS)
        both = [(x, y) for x, y in channels if x is not None and y is not None]
        return np.array_equal(one.t, other.t) and all(np.array_equal(x, y, equal_nan=True) for x, y in both)
    return one.identity is not None and one.identity == other.identity
