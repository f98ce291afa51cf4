"""All motions of some logs, kept for a diagnosis, and the columns of candidate effects over these motions.

The logs are read once, motion by motion. For each motion the cache keeps the state, from which effects make their
columns, and the filtered rows [Y_j τ_j] of each joint j, without the columns that cannot act on the joint. So no stage
reads a log again, and memory does not grow with the logs (`frischid.core.array_store`).

The columns of a candidate depend on the motion, the filter and the reference parameters, and not on the effects or the
parameters of the model. After an effect was added, the next diagnosis of the same logs needs the same columns again. So
columns are shared by their content, as long as any diagnosis of these motions lives.
"""

from __future__ import annotations

import hashlib
import weakref
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from frischid.core.array_store import Series, Store
from frischid.core.parallel import Here, Workers
from frischid.core.types import Array
from frischid.diagnosis.cached_motion import CachedMotion, JointData, stored_state
from frischid.diagnosis.candidate_columns import Candidate, ColumnTask, GatheredColumns, filtered_columns, sampled
from frischid.diagnosis.change_prior import load_reference
from frischid.diagnosis.criteria import DIAGNOSIS_CRITERIA, DiagnosisCriteria
from frischid.effects import Effect, State
from frischid.estimators.held_out import MOST_OF_A_JOINT
from frischid.logs.filters import decimate, decimating_filter
from frischid.logs.log import Log
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Recording
from frischid.model.model import Model
from frischid.model.model_parts import robot_text
from frischid.model.noise_floor import variance_of_jumps
from frischid.regression.joint_rows import JointRows
from frischid.regression.regressor import CHUNK_SAMPLES, Regressor

UNLIKE_THE_OTHERS = 1.5
"""Share of a joint's rows in one log over that of the average joint, above which the joints move in different logs."""
FEW_ELSEWHERE = 0.5
"""Share of a joint's rows outside one log over that of the average joint, below which they do, too. Where most joints
rest in the other logs, the average joint's share in this one is near 1, and no share is 1.5 times as large."""


class MotionCache:
    """Motions of some logs, prepared (filtered, decimated) like the model's training logs.

    Parameters
    ----------
    logs : sequence of Log or Recording
        Each log is one fold, up to ``criteria.max_folds``; each motion of a single log is cut into folds, and so are
        those of logs of which each moves other joints.
    workers : Workers, optional
        Processes that compute columns of candidates, this process by default.
    seen : callable, optional
        Motion -> the motion that takes its place.

    Attributes
    ----------
    active : list of ndarray of int
        For each fitted joint, the base parameters whose columns act on it.
    blocks : int
        Blocks of time of all motions.
    folds : int
        Parts of the data for cross-validation.
    """

    def __init__(
        self,
        model: Model,
        logs: Sequence[Log | Recording],
        criteria: DiagnosisCriteria = DIAGNOSIS_CRITERIA,
        workers: Workers | None = None,
        seen: Callable[[Motion], Motion] = lambda motion: motion,
    ) -> None:
        self.logs = logs
        self.model, self.criteria, self.workers = model, criteria, workers or Here()
        self.regressor = Regressor(model.robot, model.effects, load_reference(model, criteria))
        self.prepared = model.motions(logs)
        self.store = Store()
        self.position = {j: row for row, j in enumerate(model.torque_index)}
        self._rows = JointRows.of(self.regressor, model.joints, model.base)
        self.active = [ends[:-1] for ends in self._rows.ends]
        self.motions: list[CachedMotion] = []
        self.blocks = 0
        most = criteria.max_folds
        for number, log in enumerate(logs):
            fold = None if len(logs) == 1 else number * most // max(len(logs), most)
            for motion in model.motions([log]):
                self.motions.append(self._cached(seen(motion), fold))
                self.blocks += self.motions[-1].blocks
        if _one_joint_a_fold(self.motions):
            self.motions = [replace(motion, fold=None) for motion in self.motions]
        self.folds = self._folds()

    def _folds(self) -> int:
        joints = (self.joint(row, n) for row in range(len(self.active)) for n in range(len(self.motions)))
        return 1 + max((fold for joint in joints for fold, _ in joint.folds), default=0)

    def cut_anew(self) -> MotionCache:
        """The same motions, each cut into the folds of a single log; columns of candidates hold for both."""
        other = copy(self)
        other.motions = [replace(motion, fold=None) for motion in self.motions]
        other.folds = other._folds()
        return other

    def _cached(self, motion: Motion, fold: int | None) -> CachedMotion:
        index, lowpass, criteria = self.model.torque_index, self.model.lowpass, self.criteria
        times: list[Array] = []
        used: list[NDArray[np.bool_]] = []
        Z: list[list[Array]] = [[] for _ in index]
        for t, rows, counts in self._rows.chunks(motion, lowpass, CHUNK_SAMPLES):
            times.append(t)
            used.append(counts)
            for parts, own in zip(Z, self._rows.of_joints(rows, counts), strict=True):
                parts.append(own[:, :-1].copy())
        moving, known = np.concatenate(used), self._known_torque(motion)
        jumps = variance_of_jumps(motion.tau[:, index], motion.direction[:, index], motion.step, lowpass)
        return CachedMotion(
            number=len(self.motions),
            source=motion.source,
            start=motion.start,
            extra=tuple(motion.extra),
            raw=len(motion.t),
            step=motion.step,
            fold=fold,
            cuts=criteria.folds_of_one_log,
            block=self.blocks,
            seconds=max(criteria.block_seconds, criteria.block_periods / (lowpass.cutoff or criteria.block_periods)),
            counts=[int(n) for n in moving[:, index].sum(axis=0)],
            t=self.store.put(np.concatenate(times)),
            Z=[self.store.put(np.concatenate(parts)) for parts in Z],
            known=[] if known is None else [self.store.put(known[moving[:, j], j]) for j in index],
            jumps=[self.store.put(x[moving[:, j]]) for j, x in zip(index, jumps.T, strict=True)],
            picked=[self.store.put(np.flatnonzero(moving[:, j]).astype(np.int32)) for j in index],
            state=stored_state(self.regressor.state(motion), self.store),
        )

    def _known_torque(self, motion: Motion) -> Array | None:
        """Filtered torque of known parameters, (M, J); None where there is none."""
        torque = self.model.robot.known_torque(motion.q, motion.v, motion.a)
        if torque is None:
            return None
        lowpass = self.model.lowpass
        return decimate(lowpass.taps(motion.step), torque, lowpass.decimation(motion.step))

    def state(self, motion: CachedMotion) -> State:
        """Unfiltered state of a motion."""
        if isinstance(motion.state, State):
            return motion.state
        arrays = {name: stored.read() for name, stored in motion.state.items()}
        extra = {name: arrays.pop(f"extra {name}") for name in motion.extra}
        rigid = self.regressor.reference[: len(self.model.robot.columns)]
        return State(
            self.model.robot, **arrays, start=motion.start, extra=extra, reference=rigid, dry=self.regressor.dry
        )

    def sampled_states(self) -> Iterator[State]:
        """State of each motion at its filtered samples."""
        for motion in self.motions:
            yield sampled(self.state(motion), motion.t.read())

    @cached_property
    def reach(self) -> dict[str, float]:
        """Range of each joint over all motions, rad (m)."""
        ends = [(q.min(axis=0), q.max(axis=0)) for q in (self.state(motion).q for motion in self.motions)]
        low, high = np.min([x for x, _ in ends], axis=0), np.max([x for _, x in ends], axis=0)
        return dict(zip(self.model.robot.joints, (high - low).tolist(), strict=True))

    @property
    def channels(self) -> set[str]:
        """Further channels that every log has."""
        return set.intersection(*(set(motion.extra) for motion in self.motions))

    # ------------------------------------------------------------------ candidates

    def candidates(
        self, effects: Sequence[Effect], progress: Callable[[str], None] = lambda _: None
    ) -> list[Candidate]:
        """Filtered columns of candidate effects over all motions, computed once for each effect."""
        known, names = self._known.candidates, [(type(effect), str(effect)) for effect in effects]
        unknown = {name: e for name, e in zip(names, effects, strict=True) if name not in known}
        fresh = list(unknown.values())
        groups = [list(group) for _, group in groupby(fresh, lambda effect: effect.id)]
        gathered = [GatheredColumns(self._known.store) for _ in fresh]
        lowpass = self.model.lowpass
        for number, motion in enumerate(self.motions if fresh else ()):
            F = decimating_filter(lowpass.taps(motion.step), motion.raw, lowpass.decimation(motion.step))
            task = ColumnTask(self.state(motion), F, self.position, [picked.read() for picked in motion.picked])
            (there,) = self.workers.map(_same, [task])
            parts = []
            for k, group in enumerate(groups, start=1 + number * len(groups)):
                progress(f"trying {group[0].id} ({k} of {len(groups) * len(self.motions)})")
                parts += self.workers.map(filtered_columns, [group], there)
            done = [columns for part in self.workers.gather(parts) for columns in part]
            for found, columns in zip(gathered, done, strict=True):
                found.add(columns, self.motions[: number + 1])
        for (name, effect), found in zip(unknown.items(), gathered, strict=True):
            known[name] = Candidate(effect, found.series, found.signs, found.finite)
        return [known[name] for name in names]

    @cached_property
    def _known(self) -> KnownColumns:
        """Columns that an earlier diagnosis of the same motions may have computed."""
        return known_columns(fingerprint(self._columns_depend_on()), self.store)

    def _columns_depend_on(self) -> Iterator[Hashable | Array | State]:
        yield from (robot_text(self.model.robot), self.model.lowpass, *self.position.items())
        for motion in self.motions:
            yield from (motion.step, motion.raw, self.state(motion), *(picked.read() for picked in motion.picked))

    def given(self, effect: Effect, row: int, values: Sequence[Array]) -> Candidate:
        """Make a candidate on one joint from the values of its column at each motion's filtered samples."""
        series = Series(self.store)
        for motion, x in zip(self.motions, values, strict=True):
            series.append(x[motion.picked[row].read(), None])
        return Candidate(effect, {row: series}, (0,))

    def joined(self, parts: Sequence[Candidate]) -> Candidate:
        """Several places of an effect as one candidate."""
        columns: dict[int, Series] = {}
        for row in sorted({row for p in parts for row in p.columns}):
            columns[row] = Series(self.store)
            for number, motion in enumerate(self.motions):
                none = [np.zeros((motion.counts[row], len(p.signs))) for p in parts]
                found = [p.columns[row][number] if row in p.columns else x for p, x in zip(parts, none, strict=True)]
                columns[row].append(np.column_stack(found))
        return Candidate(parts[0].effect, columns, tuple(s for p in parts for s in p.signs))

    def halved(self, a: Candidate, b: Candidate, sign: float) -> Candidate:
        """Half the sum (sign 1) or half the difference (sign −1) of two candidates' columns on the same joints."""
        columns = {row: Series(self.store) for row in a.columns}
        for row, series in columns.items():
            for number in range(len(self.motions)):
                series.append((a.columns[row][number] + sign * b.columns[row][number]) / 2)
        return Candidate(a.effect, columns, a.signs)

    def joint(self, row: int, number: int, left_out: Sequence[tuple[str, float, float]] = ()) -> JointData:
        """Rows of a joint over one motion, without some stretches of time."""
        return JointData(self.motions[number], row, left_out)


def _one_joint_a_fold(motions: Sequence[CachedMotion]) -> bool:
    """Whether most rows of some joint are in one fold, so that the other folds cannot predict this joint."""
    if any(motion.fold is None for motion in motions):
        return False
    counts = np.zeros((1 + max((m.fold or 0 for m in motions), default=0), len(motions[0].counts) if motions else 0))
    for motion in motions:
        counts[motion.fold or 0] += motion.counts
    share = counts / np.maximum(counts.sum(axis=0), 1.0)
    usual = share.mean(axis=1, keepdims=True)  # of a long log beside a short one the share of all joints is large
    unlike = (share > UNLIKE_THE_OTHERS * usual) | (1 - share < FEW_ELSEWHERE * (1 - usual))
    return bool(((share > MOST_OF_A_JOINT) & unlike).any())


def _same(task: ColumnTask) -> ColumnTask:
    return task


class KnownColumns:
    """Candidates by the class and the text of their effect, and the store of their columns."""

    def __init__(self, store: Store) -> None:
        self.store = store
        self.candidates: dict[tuple[type[Effect], str], Candidate] = {}


_LIVING: weakref.WeakValueDictionary[str, KnownColumns] = weakref.WeakValueDictionary()


def known_columns(key: str, store: Store) -> KnownColumns:
    """Columns of candidates of motions with the same fingerprint; new ones are put into `store`."""
    return _LIVING.setdefault(key, KnownColumns(store))


def fingerprint(parts: Iterable[Hashable | Array | State]) -> str:
    """Hash of numbers, names, arrays, and all that an effect reads of a state."""
    digest = hashlib.blake2b()
    for part in parts:
        if isinstance(part, State):
            arrays = (part.t, part.q, part.v, part.a, part.load, part.torque, part.reference, part.dry)
            inner = fingerprint([*arrays, part.start, *(x for pair in part.extra.items() for x in pair)])
            digest.update(inner.encode())
        elif isinstance(part, np.ndarray):
            digest.update(repr((part.shape, part.dtype.str)).encode())
            digest.update(np.ascontiguousarray(part).view(np.uint8).data if part.size else b"")
        else:
            digest.update(repr(part).encode())
    return digest.hexdigest()
