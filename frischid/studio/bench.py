"""The work bench behind the studio's page: one model, its logs, and the jobs that change the model.

The bench does not depend on the page. The page shows one frozen `State`. A job computes the next state and replaces the
present one only when the whole job has succeeded, so a failure changes nothing. Jobs run one at a time: while one runs,
a second one from any tab is refused. A job that was started for an older state is refused too.

A diagnosis runs in a thread of its own. That thread must end before the interpreter does: a thread that is in compiled
code when Python ends is unwound by force, and Rust and C++ then abort the process. `Bench.close` ends it, and Python
calls `Bench.close` at its own end.
"""

from __future__ import annotations

import atexit
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from frischid.effects import Effect, effect_from_dict
from frischid.errors import FrischidError, InputError
from frischid.logs.log import Log
from frischid.model.comparison import Comparison, compare
from frischid.model.headline import Headline, headline
from frischid.model.model import Model
from frischid.model.prediction import Prediction, predict
from frischid.studio.first_look import first_look
from frischid.studio.watch import Tried, Watch

if TYPE_CHECKING:  # jobs import these modules themselves, so that the first picture does not wait
    from frischid.diagnosis.findings import Finding
    from frischid.diagnosis.result import Diagnosis
    from frischid.diagnosis.roles import Roles
    from frischid.diagnosis.situation import SituationOption
    from frischid.forward.simulated_beside import SimulatedBeside

DIAGNOSIS_DELAY = 0.05  # s before a diagnosis begins in the background


@dataclass(frozen=True, eq=False)
class State:
    """The content of every tab.

    Attributes
    ----------
    revision : int
        Grows with every change of the model.
    prediction : Prediction
        Along all logs.
    comparison : Comparison
        On all logs.
    headline : Headline
        The model's error: on the logs it was not fitted to, or cross-validated without any.
    diagnosis : Diagnosis or None
        Diagnosis of this model; None until it is finished.
    first_look : bool
        Whether the diagnosis is a first look, on a stretch of some logs; the diagnosis on all of them follows.
    problem : str
        Why the diagnosis failed; empty otherwise.
    before : State or None
        State before the last step, for `undo`; None where that state has to be computed.
    beside : SimulatedBeside or None
        Simulated positions along one log, a test log if there is one; None where nothing is simulated.
    """

    revision: int
    model: Model
    prediction: Prediction
    comparison: Comparison
    headline: Headline
    diagnosis: Diagnosis | None = None
    first_look: bool = False
    problem: str = ""
    before: State | None = None
    beside: SimulatedBeside | None = None


class SupersededError(Exception):
    """The model was changed while it was being diagnosed."""


class Bench:
    """A model, its logs, and the jobs that change the model.

    Parameters
    ----------
    logs : sequence of Log
        Logs the model was fitted to are fitted again when an effect is added, and select the missing effects. The
        others only test. The model's own logs that are not given are looked for: see `frischid.diagnosis.roles`.
    output : Path
        File that `save` writes; `export` writes into the same folder.

    Attributes
    ----------
    fit, valid : list of Log
        Logs that are fitted again and select effects, and logs that only test.
    note : str
        Where the logs that select come from, if not from the logs given; otherwise empty.
    absent : int
        Number of logs that the model was fitted to but that were not given: new effects are fitted without them.
    """

    def __init__(self, model: Model, logs: Sequence[Log], output: Path) -> None:
        self.output = output
        self.fit, self.valid, self._given = _by_role(model, logs)
        self.note = "" if self._given is None else self._given.note
        self.logs = [*self.fit, *self.valid]
        fitted = sum(model.made_from(log) for log in self.fit)
        self.absent = max(len(model.fitted_logs) - fitted, 0) if fitted else 0
        self._turn = threading.Lock()
        self._change = threading.Lock()  # guards the state; held only while the state is replaced
        self._doing = ""
        self._looked = -1
        self._first: Diagnosis | None = None  # the last first look: its columns serve the next one
        self._closed = False
        self._looking: list[threading.Timer] = []
        self._listeners: list[Callable[[], None]] = []
        self._progress: Callable[[str, float], None] = lambda _text, _share: None
        self._ranked: Callable[[Sequence[Tried]], None] = lambda _ranking: None
        self.state = self._state(model, 0)

    def close(self) -> None:
        """End the diagnoses in the background, and begin no other."""
        self._closed = True
        for timer in self._looking:
            timer.cancel()
        for timer in self._looking:
            if timer is not threading.current_thread():
                timer.join()
        self._looking.clear()
        atexit.unregister(self.close)

    # ------------------------------------------------------------------ listeners

    def listen(self, changed: Callable[[], None]) -> Callable[[], None]:
        """Call `changed` after every new state, until the returned function is called."""
        self._listeners.append(changed)
        return lambda: self._listeners.remove(changed)

    def on_progress(self, progress: Callable[[str, float], None]) -> None:
        """Call `progress` with the present work and the finished share; with an empty text when no work is done."""
        self._progress = progress

    def on_ranked(self, ranked: Callable[[Sequence[Tried]], None]) -> None:
        """Call `ranked` with the effects tried so far, best first, again and again while a diagnosis runs."""
        self._ranked = ranked

    def _put(self, state: State, revision: int) -> None:
        """Show a new state that was computed from the state of `revision`, unless the model has changed since."""
        with self._change:
            if self.state.revision != revision:
                return
            self.state = state
        for changed in list(self._listeners):
            changed()

    # ------------------------------------------------------------------ jobs

    @contextmanager
    def _job(self, doing: str, revision: int) -> Iterator[State]:
        """Start a job, or raise an error that names the running one."""
        if not self._turn.acquire(blocking=False):
            raise InputError(f"busy: {self._doing}; try again when it is done")
        try:
            self._doing = doing
            if revision != self.state.revision:
                raise InputError("the model was changed in another tab; look at the present model, then try again")
            self._progress(doing, 0.1)
            yield self.state
        finally:
            self._turn.release()
            self._progress("", 1.0)

    def add(self, effects: Sequence[Effect], revision: int, finding: Finding | None = None) -> State:
        """Add effects, refit, show the new state, and then diagnose it.

        Raises
        ------
        InputError
            Another job runs, the revision is not the present one, or the effects cannot be added.
        """
        from frischid.diagnosis.addition import add

        with self._job(f"refitting with {', '.join(dict.fromkeys(e.id for e in effects))}", revision) as now:
            situation = now.diagnosis.situation if now.diagnosis is not None else "auto"
            step = add(now.model, effects, self.fit, valid=self.valid, situation=situation, finding=finding)
            self._progress(self._doing, 0.7)
            state = replace(self._state(step.model, now.revision + 1), before=now)
        self._put(state, now.revision)
        return state

    def add_formula(self, expression: str, joints: Sequence[str] | None, revision: int) -> State:
        """Add an effect of the user's own, on some joints or on all."""
        where = None if joints is None else list(joints)
        return self.add([effect_from_dict({"effect": "formula", "joints": where, "expression": expression})], revision)

    def undo(self, revision: int) -> State:
        """Take the last step back; if the step was done on this bench, the state before comes back at once."""
        from frischid.diagnosis.addition import undo

        with self._job("taking the last step back", revision) as now:
            earlier = undo(now.model)
            state = self._state(earlier, 0) if now.before is None else now.before
            state = replace(state, revision=now.revision + 1)
        self._put(state, now.revision)
        return state

    def save(self) -> Path:
        """Write the present model."""
        self.state.model.save(self.output)
        return self.output

    def export(self) -> Path:
        """Write the report on the present model into the model's folder."""
        from frischid.reports.page import report

        state = self.state
        path = self.output.with_suffix(".html")
        report(
            state.model, [*self.fit, *self.valid], path, diagnosis=None if state.first_look else state.diagnosis,
            model_path=self.output.name,
            progress=lambda text: self._progress(f"report: {text}", 0.5),
        )  # fmt: skip
        self._progress("", 1.0)
        return path

    def look(self, delay: float | None = None) -> None:
        """Diagnose in the background, once per state, after `delay`, s; the result is a new state."""
        state = self.state
        if (state.diagnosis is not None and not state.first_look) or self._looked == state.revision or self._closed:
            return
        self._looked = state.revision

        def work() -> None:
            if self._closed or self.state.revision != state.revision:  # a new state is diagnosed by itself
                return
            try:
                self.diagnose()
            except Exception as error:  # nobody waits for this thread, so the page shows the error
                self._put(replace(state, problem=message_of(error)), state.revision)

        # First the page draws the new state: the diagnosis would take processor time from the drawing.
        timer = threading.Timer(DIAGNOSIS_DELAY if delay is None else delay, work)
        timer.daemon = True  # Python waits for other threads before it calls `close`
        if not self._looking:
            atexit.register(self.close)
        self._looking = [*(t for t in self._looking if t.is_alive()), timer]
        timer.start()

    def diagnose(self) -> None:
        """Find the effects that the present model misses, first along stretches of some logs, then along all.

        The diagnosis is abandoned if the model changes meanwhile.
        """
        from frischid.diagnosis.diagnosis import diagnose
        from frischid.diagnosis.roles import Roles, diagnose_with

        state, given = self.state, self._given or Roles((), (), "auto", "")
        given = given._replace(select=tuple(self.fit), test=tuple(self.valid))
        if state.revision:  # the model is not the one that the roles of the logs were decided for
            note = "" if given.before else given.note
            given = given._replace(situation="auto", note=note, found=None, before=None)
        shown = given.before or state.model

        def proceed() -> None:
            if self._closed or self.state.revision != state.revision:
                raise SupersededError

        def watch() -> Watch:
            say = self._progress
            return Watch(proceed, lambda name, share: say(f"looking for missing effects: {name}", share), self._ranked)

        try:
            if len(self.fit) > 1 and state.diagnosis is None:
                unchanged = all(state.model.made_from(log) for log in self.fit)
                situation: SituationOption = "always" if unchanged else given.situation
                with suppress(InputError):  # of stretches in which nothing moves, for example
                    first = diagnose(shown, self._stretches, situation=situation, progress=watch())
                    self._first = first
                    self._put(replace(state, diagnosis=first, first_look=True), state.revision)
            found = diagnose_with(state.model, given, progress=watch())
        except SupersededError:
            return
        finally:
            self._progress("", 1.0)
        self._put(replace(state, diagnosis=found, first_look=False), state.revision)
        if found.situation == "always":
            self._examine(state)

    @cached_property
    def _stretches(self) -> list[Log]:
        """The logs of the first look: always the same, so that their columns are computed once."""
        return first_look(self.fit, self.state.model.lowpass)

    def _examine(self, state: State) -> None:
        """Examine the logs as the refit after a click will, while the user reads the findings."""
        from frischid.diagnosis.refit import examine

        with suppress(InputError):  # the refit says it, if the user wants one
            if not self._closed and self.state.revision == state.revision:
                examine(state.model, self.fit)

    def _state(self, model: Model, revision: int) -> State:
        logs = [*self.fit, *self.valid]
        evaluated = [list(model.blocks([log])) for log in logs]
        comparison = compare(model, logs, [b for part in evaluated for b in part])
        held_out = [b for part in evaluated[len(self.fit) :] for b in part]
        tested = compare(model, self.valid, held_out) if self.valid else comparison
        error = headline(model, self.valid or self.fit, tested)
        beside = _beside(model, [*self.valid, *self.fit])
        return State(revision, model, predict(model, logs, evaluated), comparison, error, beside=beside)


def _beside(model: Model, logs: Sequence[Log]) -> SimulatedBeside | None:
    """Simulated positions of a model that can be simulated."""
    from frischid.forward.simulated_beside import simulated_beside

    found = simulated_beside(model, logs)
    return None if isinstance(found, str) else found


def _by_role(model: Model, logs: Sequence[Log]) -> tuple[list[Log], list[Log], Roles | None]:
    """Logs that are fitted and select, logs that test, and their roles where others than those given may select."""
    own = [log for log in logs if model.made_from(log)]
    if own and len(own) >= len(model.fitted_logs):  # nothing to look for
        order = [entry.get("sha256") for entry in model.fitted_logs]  # of the fit, whose error is known in this order
        others = [log for log in logs if log not in own]
        return sorted(own, key=lambda log: _place(order, log)), others, None
    from frischid.diagnosis.roles import roles

    given = roles(model, logs)
    fit, valid = ([log for log in part if isinstance(log, Log)] for part in (given.select, given.test))
    return fit, valid, given


def _place(order: Sequence[str | None], log: Log) -> int:
    return order.index(log.identity) if log.identity in order else len(order)


def message_of(error: Exception) -> str:
    """Message to the user on a failed job."""
    if isinstance(error, FrischidError):
        return str(error)
    return f"{type(error).__name__}: {error}; the model has not changed"
