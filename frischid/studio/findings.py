"""The list of findings in one tab: each with a button that adds it, and one that shows its shape on the residual.

The list is rebuilt with every step, because the findings change. While they are computed, the list says what is being
tried. A finding's shape is the change of the model's torque by the effect (`frischid.diagnosis.effect_curves`); its
joints light up in the scene.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from frischid import figures
from frischid.core.text import listed, sentence
from frischid.effects import EFFECTS
from frischid.studio.bench import Bench, State
from frischid.studio.watch import Tried
from frischid.studio.words import plain

if TYPE_CHECKING:
    from frischid.diagnosis.findings import Finding

FINDINGS_IN_PANEL = 6
NUMBERS = "On the buttons: change of the cross-validated error with the effect."
SO_FAR = "Tried so far, each effect alone, by its evidence:"
ASPECT = 0.66  # height of a shape's figure over its width


class Findings:
    """The findings of one tab.

    Parameters
    ----------
    folder : handle
        Where the list stands.
    add : callable
        Called with the effects of a finding, the revision and the finding, when its button is clicked.
    attempt : callable
        Runs a job, and shows its error.
    lit : callable
        Called with the joints that a shown finding acts on, and the joint that its shape is drawn for.
    """

    def __init__(
        self,
        gui: Any,
        folder: Any,
        bench: Bench,
        add: Callable[[Finding, int], None],
        attempt: Callable[[Callable[[], Any]], bool],
        lit: Callable[[Sequence[str], str], None],
    ) -> None:
        self.gui, self.folder, self.bench = gui, folder, bench
        self._add, self._attempt, self._lit = add, attempt, lit
        self._listed: list[Any] = []
        self._waiting: Any = None
        self._so_far: Any = None
        self._drawn: Any = None
        self._lock = threading.Lock()
        self._shown: State | None = None

    def show(self, state: State) -> None:
        """Show the findings of a state, or what is done to find them; a diagnosis in another thread may call this."""
        with self._lock:
            if state is not self._shown:
                self._shown = state
                self._list(state)

    def _list(self, state: State) -> None:
        for handle in [*self._listed, *([] if self._drawn is None else [self._drawn])]:
            handle.remove()
        self._listed, self._waiting, self._so_far, self._drawn = [], None, None, None
        with self.folder:
            if state.diagnosis is None:
                text = state.problem or self._plan()
                self._listed = [self.gui.add_markdown(plain(text))]
                if not state.problem:
                    self._waiting = self._listed[0]
                    self._rank()
                return
            from frischid.diagnosis.clause import missing
            from frischid.diagnosis.rivals import HOW_RANKED

            passing = [f for f in state.diagnosis.findings if f.significant and f.members]
            first = (
                f"A first look, at a part of the logs; all {len(self.bench.fit)} logs decide in a few seconds."
                if state.first_look
                else ""
            )
            told = [
                first,
                f"{missing(state.diagnosis)}.",
                NUMBERS if passing else "",
                HOW_RANKED if len(passing) > 1 else "",
            ]
            self._listed.append(self.gui.add_markdown(plain(" ".join(filter(None, told)))))
            for finding in passing[:FINDINGS_IN_PANEL]:
                self._offer(finding, state)
            if state.first_look:
                self._rank()

    def _rank(self) -> None:
        """Make the place of the ranking that grows while a diagnosis runs: below all buttons, so that none moves."""
        self._so_far = self.gui.add_markdown("")
        self._listed.append(self._so_far)

    def ranked(self, ranking: Sequence[Tried]) -> None:
        """Show the effects tried so far, best first."""
        if self._so_far is not None and ranking:
            lines = [f"{k}. {plain(tried.words)}" for k, tried in enumerate(ranking, start=1)]
            self._so_far.content = f"{plain(SO_FAR)}\n\n" + "\n".join(lines)

    def progress(self, text: str) -> None:
        """Say what is being tried, while the findings are computed."""
        if self._waiting is not None and text:
            self._waiting.content = plain(f"{self._plan()} Now: {text.rpartition(': ')[2]}.")

    def _plan(self) -> str:
        logs, joints = len(self.bench.fit), len(self.bench.state.model.joints)
        return (
            f"Looking for missing effects: each of {len(EFFECTS)} effects is tried on {joints} "
            f"joint{'s' * (joints > 1)} and cross-validated on {logs} log{'s' * (logs > 1)}. The most probable "
            "effect will stand first, with a button that adds it."
        )

    def _offer(self, finding: Finding, state: State) -> None:
        add = self.gui.add_button(f"Add {finding.effect}: error {finding.change}")
        add.on_click(lambda _: self._add(finding, state.revision))
        confused = f" Could also be {listed(finding.confused_with)}." if finding.confused_with else ""
        text = self.gui.add_markdown(
            plain(
                f"{sentence(finding.sentence, finding.joints)}. Probability that this is the cause: "
                f"{100 * finding.probability:.0f} %. To be sure, {EFFECTS[finding.effect].confirmed_by}.{confused}"
            )
        )
        shape = self.gui.add_button(f"Show {finding.effect} on the residual", color="gray")
        shape.on_click(lambda _: self._attempt(lambda: self._shape(finding, state, shape.order)))
        self._listed += [add, text, shape]

    def _shape(self, finding: Finding, state: State, order: float) -> None:
        """Draw the finding below its button, in the place of the one drawn before."""
        from frischid.diagnosis.effect_curves import shape_of

        assert state.diagnosis is not None
        shape = shape_of(state.diagnosis, finding, state.prediction)
        if self._drawn is not None:
            self._drawn.remove()
            self._drawn = None
        robot = state.model.robot
        joint = shape.joint if shape is not None else str(state.model.joints[0])
        self._lit(finding.joints or state.model.joints, joint)
        if shape is None:
            return
        sliding = bool(robot.prismatic[robot.joints.index(joint)])
        drawn = figures.shape(shape, EFFECTS[finding.effect].title, sliding)
        figure = drawn.figure.update_layout(height=None, margin={"t": 44})
        with self.folder:
            self._drawn = self.gui.add_plotly(
                figure, aspect=ASPECT, config={"displayModeBar": False}, order=order + 1e-3
            )
