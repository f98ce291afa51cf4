"""The work bench behind the studio's page: one model, its logs, and the jobs that change it.

It knows nothing of the page. All that is shown is one frozen `State`; a job computes the next one and puts it in place
only when all of it has worked, so a failure leaves everything as it was. Jobs run one at a time: a second one, from
whatever tab, is refused while the first runs, and so is one that was meant for a state that is no longer the present.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from frischid.effects import EFFECTS, Effect, effect_from_dict
from frischid.errors import FrischidError, InputError
from frischid.logs.log import Log
from frischid.model.comparison import Comparison, compare
from frischid.model.model import Model
from frischid.model.prediction import Prediction, predict

if TYPE_CHECKING:  # jobs load what they need: the first picture does not wait for it
    from frischid.diagnosis.diagnosis import Diagnosis
    from frischid.diagnosis.findings import Finding

DIAGNOSIS_DELAY = 1.0  # s before a diagnosis begins in the background


@dataclass(frozen=True, eq=False)
class State:
    """The content of every tab.

    Attributes
    ----------
    revision : int
        Grows with every change of the model.
    model : Model
    prediction : Prediction
        Along all logs.
    comparison : Comparison
        On all logs.
    error : float
        NRMSE on the logs held out, or on all of them when none was.
    diagnosis : Diagnosis or None
        Of this very model; None while it is being made.
    problem : str
        Why there is none, when it failed.
    before : State or None
        What `undo` goes back to at once; None where it has to be computed.
    """

    revision: int
    model: Model
    prediction: Prediction
    comparison: Comparison
    error: float
    diagnosis: Diagnosis | None = None
    problem: str = ""
    before: State | None = None


class SupersededError(Exception):
    """The model was changed while it was being diagnosed."""


class Bench:
    """A model on its logs, open for change.

    Parameters
    ----------
    model : Model
    logs : sequence of Log
        Those the model was fitted to are fitted again when an effect is added, and decide what is missing. The others
        only test. When it was fitted to none of them, all are fitted.
    output : Path
        Where `save` writes; `export` writes beside it.

    Attributes
    ----------
    fit, valid : list of Log
        Those that are fitted again and decide, and those that only test.
    absent : int
        Number of logs that the model was fitted to and that are not here: new effects are fitted without them.
    """

    def __init__(self, model: Model, logs: Sequence[Log], output: Path) -> None:
        self.logs, self.output = list(logs), output
        fitted = [log for log in self.logs if model.made_from(log)]
        self.fit = fitted or self.logs
        self.valid = [log for log in self.logs if fitted and log not in fitted]
        self.absent = max(model.fitted_to - len(fitted), 0) if fitted else 0
        self._turn = threading.Lock()
        self._change = threading.Lock()  # over what the state is; held for no longer than it takes to replace it
        self._doing = ""
        self._looked = -1
        self._listeners: list[Callable[[], None]] = []
        self._progress: Callable[[str, float], None] = lambda _text, _share: None
        self.state = self._state(model, 0)

    # ------------------------------------------------------------------ who listens

    def listen(self, changed: Callable[[], None]) -> Callable[[], None]:
        """Call `changed` after every new state; the function returned ends it."""
        self._listeners.append(changed)
        return lambda: self._listeners.remove(changed)

    def on_progress(self, progress: Callable[[str, float], None]) -> None:
        """Tell `progress` what is being done and the share that is done; an empty text when nothing is."""
        self._progress = progress

    def _put(self, state: State, revision: int) -> None:
        """Show a state made from that of a revision, unless the model has been changed since."""
        with self._change:
            if self.state.revision != revision:
                return
            self.state = state
        for changed in list(self._listeners):
            changed()

    # ------------------------------------------------------------------ jobs

    @contextmanager
    def _job(self, doing: str, revision: int) -> Iterator[State]:
        """Take the turn, or say who has it."""
        if not self._turn.acquire(blocking=False):
            raise InputError(f"busy: {self._doing}; try again when it is done")
        try:
            self._doing = doing
            if revision != self.state.revision:
                raise InputError("the model was changed in another tab; look at what it is now, then try again")
            self._progress(doing, 0.1)
            yield self.state
        finally:
            self._turn.release()
            self._progress("", 1.0)

    def add(self, effects: Sequence[Effect], revision: int, finding: Finding | None = None) -> State:
        """Add effects, refit, and show the new state; then look for what is missing next.

        Raises
        ------
        InputError
            Another job runs, the state is not the present one, or the effects cannot be added.
        """
        from frischid.diagnosis.improvement import add

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
        """Take the last step back: at once, and to what was found missing then, where it was done here."""
        from frischid.diagnosis.improvement import undo

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
        """Write the report on the present model, beside it."""
        from frischid.reports.page import report

        state = self.state
        path = self.output.with_suffix(".html")
        report(
            state.model, [*self.fit, *self.valid], path, diagnosis=state.diagnosis, model_path=self.output.name,
            progress=lambda text: self._progress(f"report: {text}", 0.5),
        )  # fmt: skip
        self._progress("", 1.0)
        return path

    def look(self) -> None:
        """Diagnose in the background, once a state; what comes of it is a new state."""
        state = self.state
        if state.diagnosis is not None or self._looked == state.revision:
            return
        self._looked = state.revision

        def work() -> None:
            if self.state.revision != state.revision:  # it was changed again, and is looked at anew
                return
            try:
                self.diagnose()
            except Exception as error:  # nobody waits for this thread: what went wrong is shown
                self._put(replace(state, problem=message_of(error)), state.revision)

        # First the page draws what is new: the diagnosis would take the processor from it.
        timer = threading.Timer(DIAGNOSIS_DELAY, work)
        timer.daemon = True
        timer.start()

    def diagnose(self) -> None:
        """Find what the present model is missing; given up when the model changes meanwhile."""
        from frischid.diagnosis.diagnosis import diagnose

        state = self.state
        tried: set[str] = set()

        def progress(text: str) -> None:
            if self.state.revision != state.revision:
                raise SupersededError
            name = text.removeprefix("trying ")
            tried.add(name)
            self._progress(f"looking for what is missing: {name}", len(tried & EFFECTS.keys()) / len(EFFECTS))

        try:
            found = diagnose(state.model, self.fit, valid=self.valid, progress=progress)
        except SupersededError:
            return
        finally:
            self._progress("", 1.0)
        self._put(replace(state, diagnosis=found), state.revision)

    def _state(self, model: Model, revision: int) -> State:
        logs = [*self.fit, *self.valid]
        evaluated = [list(model.blocks([log])) for log in logs]
        comparison = compare(model, logs, [b for part in evaluated for b in part])
        held_out = [b for part in evaluated[len(self.fit) :] for b in part]
        error = compare(model, self.valid, held_out).nrmse if self.valid else comparison.nrmse
        return State(revision, model, predict(model, logs, evaluated), comparison, error)


def message_of(error: Exception) -> str:
    """What to tell the user of a failed job."""
    if isinstance(error, FrischidError):
        return str(error)
    return f"{type(error).__name__}: {error}; the model is as it was"
