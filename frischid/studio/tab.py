"""One browser tab: it shows the state of the bench, and its buttons start the bench's jobs.

Every tab has its own time, chosen joint and play button; the model is the bench's and the same in all tabs. A button
knows the revision of the model that it was made for, so that a click on an outdated finding changes nothing.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from frischid import figures
from frischid.figures import Drawing
from frischid.figures.torque import TIME_MARGIN, side_by_side
from frischid.studio.bench import Bench, State, message_of
from frischid.studio.colours import legend
from frischid.studio.cursor import line
from frischid.studio.findings import Findings
from frischid.studio.frame import WIDTH, Frame
from frischid.studio.headline_text import error_text, origin_text, verdict_errors
from frischid.studio.track import Track
from frischid.studio.words import plain

if TYPE_CHECKING:
    from frischid.diagnosis.findings import Finding
    from frischid.studio.stage import Stage

VARIABLE_CHOICES = {"position": "q", "velocity": "v", "acceleration": "a", "load": "load", "time": "t"}
EVERY = "every joint"
ALL = "all logs"
BLINK, STORAGE_TIMEOUT = 0.05, 3.0  # s
HIGH, HIGH_ON_PHONE = 0.95, 1.2  # height of a figure over its height in the report: in a panel, and in a phone's sheet


@dataclass(eq=False)
class _Place:
    """The place of a figure: text above and below, and the figure itself."""

    within: Any
    title: Any
    reading: Any
    figure: Any = None


class Tab:
    """The content of one browser tab.

    Parameters
    ----------
    frame : Frame
        The frame that holds the content.
    """

    def __init__(self, frame: Frame, bench: Bench, track: Track) -> None:
        self.frame, self.client, self.bench, self.track = frame, frame.client, bench, track
        self._lock = threading.RLock()
        self._drawn = bench.state
        self.stage: Stage | None = None  # drawn last
        joints = list(bench.state.comparison.joints.names)
        errors = verdict_errors(bench.state)
        worst = max(joints, key=lambda name: errors[name])
        gui = self.client.gui
        gui.set_panel_label(f"frischid: {bench.state.model.robot.name}")
        with self._lock:  # a control that is used at once waits until the others are there
            self._curves(gui, joints, worst)
            self._work(gui, joints)
            self._headline(self._drawn)
            self.findings.show(self._drawn)

    def draw(self) -> None:
        """Draw curves and robot; findings that come meanwhile are shown at once."""
        with self._lock:
            # First text, then curves, then the robot, which takes longer without a GPU.
            self._torque()
            self.frame.primer.remove()
            self._come()
            from frischid.studio.stage import Stage  # loads while the browser draws the curves

            self.stage = Stage(self.client, self.bench, self.track, self._choose, self.frame.free)
            self.pose()
            self._stairs(self._drawn)

    def _come(self) -> None:
        """Wait until the browser has read the data sent so far, and for a moment in which it may draw them."""
        with contextlib.suppress(RuntimeError, TimeoutError):  # the tab is closed, has no storage, or is too busy
            self.client.local_storage.get_item("frischid", timeout=STORAGE_TIMEOUT)
        time.sleep(BLINK)

    # ------------------------------------------------------------------ content of the page

    def _curves(self, gui: Any, joints: Sequence[str], worst: str) -> None:
        """Left panel: motion, the joint's torque, the history of errors."""
        with self.frame.motion as motion:
            self.play = gui.add_button("Play")
            end = round(float(self.track.x[-1]), 2)
            self.time = gui.add_slider("Time, s", 0.0, end, 0.01, 0.0)
            names = [f"{k}: {Path(x).name}" for k, x in enumerate(self._drawn.prediction.sources, start=1)]
            self.log = gui.add_dropdown("Log", (ALL, *names), visible=len(names) > 1)
            ends = {"min": (0.0, 0.0), "max": (end, end), "step": 0.1}
            self.stretch = gui.add_vector2("Shown, from and to, s", (0.0, end), **ends)
            self.joint = gui.add_dropdown("Joint", tuple(joints), initial_value=worst)
            self.colouring = gui.add_dropdown("Colours show the error", ("of the verdict", "at this moment"))
            self.legend = gui.add_html("")
            self.before = gui.add_checkbox("Before the step too", True, visible=False)
            self.torque = self._figure(gui, motion)
            self.cursor = gui.add_html("", order=self.torque.reading.order - 1e-4)
            self.stairs = self._figure(gui, motion)
        self.playing = False
        self.play.on_click(self._toggle)
        self.time.on_update(lambda event: self.pose() if event.client is not None else None)
        self.log.on_update(lambda _: self._log_chosen())
        self.stretch.on_update(lambda event: self._zoomed() if event.client is not None else None)
        self.before.on_update(lambda _: self._zoomed())
        self.joint.on_update(lambda _: self._joint_changed())
        self.colouring.on_update(lambda _: self.pose())

    def _work(self, gui: Any, joints: Sequence[str]) -> None:
        """Right panel: the verdict, the findings, where the model fails, and the buttons that save."""
        self.doing = gui.add_markdown("", visible=False)
        self.bar = gui.add_progress_bar(0.0, visible=False)  # not animated: moving stripes load two cores without a GPU
        group = gui.add_tab_group()
        with group.add_tab("Missing"):
            self.undo = gui.add_button("Undo the last step", color="gray")
            folder = gui.add_folder("Findings")
            with gui.add_folder("A formula of your own"):
                self.formula = gui.add_text(
                    "τ =  c ·", "sin(q)", hint="q, v, a, load, t, or of a joint: v2; sin(3*q2)*v1"
                )
                self.where = gui.add_dropdown("On", (EVERY, *joints))
                self.use = gui.add_button("Add this formula", color="gray")
        with group.add_tab("Where it fails") as fails:
            self.matrix = self._figure(gui, fails)
            self.variable = gui.add_dropdown("Residual against", tuple(VARIABLE_CHOICES), initial_value="velocity")
            self.against = self._figure(gui, fails)
            self.moved = self._figure(gui, fails)
        with group.add_tab("Keep"):
            self.save = gui.add_button("Save the model")
            self.export = gui.add_button("Download the report", color="gray")
            self.kept = gui.add_markdown("")
        self.findings = Findings(gui, folder, self.bench, self._add, self._attempt, self._light)
        self.undo.on_click(lambda _: self._change(lambda: self.bench.undo(self._revision())))
        self.use.on_click(lambda _: self._change(self._formula))
        self.variable.on_update(lambda _: self._residual())
        self.save.on_click(lambda _: self._attempt(lambda: self._said("Model", self.bench.save())))
        self.export.on_click(lambda _: self._attempt(self._download))

    def _figure(self, gui: Any, within: Any) -> _Place:
        """A title and a text that explains the figure; the figure goes between them."""
        return _Place(within, gui.add_markdown(""), gui.add_markdown(""))

    # ------------------------------------------------------------------ showing

    def refresh(self) -> None:
        """Show the bench's state, as far as it differs from the one shown."""
        self.findings.show(self.bench.state)
        with self._lock:
            state, before = self.bench.state, self._drawn
            self._drawn = state
            if before.revision != state.revision:
                if self.stage is not None:
                    self.stage.lit = frozenset()
                self._headline(state)
                self._torque()
                self._stairs(state)
                self.pose()
            # Figures behind the first tab of the panel must not delay the first findings.
            looked = state.diagnosis is not None or state.problem != ""
            if before.revision != state.revision or (looked and self.matrix.figure is None):
                self._elsewhere(state)

    def _stairs(self, state: State) -> None:
        self._show(self.stairs, figures.staircase(state.model, state.headline))

    def _elsewhere(self, state: State) -> None:
        """Update the panel's tabs behind the first one."""
        self._show(self.matrix, figures.matrix(state.comparison))
        self._residual()
        if state.beside is not None:
            self._show(self.moved, figures.position_error(state.beside, state.model.robot))
        else:
            self._hide(self.moved)

    def progress(self, text: str, share: float) -> None:
        """Show the present work of the bench; an empty text when no work is done."""
        self.doing.visible = self.bar.visible = bool(text)
        self.doing.content = plain(f"{text[:1].upper()}{text[1:]} …")
        self.bar.value = 100 * share
        self.findings.progress(text)

    def pose(self) -> None:
        """Move the robot, once it is drawn, to its pose at the slider's time."""
        if self.stage is not None:
            self.stage.pose(float(self.time.value), str(self.joint.value), self.colouring.value)
            self.legend.content = legend(self.stage.top, bool(self.stage.lit))
        first, last = self.stretch.value
        share = (float(self.time.value) - first) / max(last - first, 1e-9)
        share = (share + TIME_MARGIN) / (1 + 2 * TIME_MARGIN)  # the axis has empty ends
        self.cursor.content = "" if self.torque.figure is None else line(share, float(self.torque.figure.aspect))

    def step(self, seconds: float) -> None:
        """Advance the time, if the tab plays."""
        if self.playing:
            after = float(self.time.value) + seconds
            first, last = self.stretch.value
            self.time.value = after if first <= after < last else first
            self.pose()

    def _headline(self, state: State) -> None:
        self.frame.headline.content = f"{error_text(state)}{origin_text(self.bench)}"
        self.undo.disabled = state.model.previous is None

    def _torque(self) -> None:
        state, joint = self.bench.state, str(self.joint.value)
        left_out = {} if state.diagnosis is None else state.diagnosis.left_out(joint)
        self.before.visible = state.before is not None
        before = state.before if self.before.value else None
        ghosts = [] if before is None else [figures.Overlay("before", before.prediction)]
        drawn = figures.measured(
            state.prediction, state.comparison, joint, left_out, self._sliding(joint), self.stretch.value, ghosts
        )
        drawn.figure.update_layout(dragmode=False)  # the cursor knows only the stretch between the two numbers
        self._show(self.torque, drawn)

    def _residual(self) -> None:
        joint, variable = str(self.joint.value), VARIABLE_CHOICES[str(self.variable.value)]
        self._show(self.against, figures.against(self.bench.state.prediction, joint, variable, self._sliding(joint)))

    def _show(self, place: _Place, drawing: Drawing) -> None:
        place.title.content = f"**{plain(drawing.title)}**"
        # In a narrow panel the legend needs two lines.
        aspect = (HIGH_ON_PHONE if self.frame.phone else HIGH) * drawing.height / WIDTH
        figure = drawing.figure.update_layout(height=None, margin={"t": 44} if drawing.legend else {})
        if place.figure is None:
            between = (place.title.order + place.reading.order) / 2
            with place.within:
                place.figure = self.client.gui.add_plotly(
                    figure, aspect=aspect, config={"displayModeBar": False}, order=between
                )
        else:
            place.figure.figure, place.figure.aspect = figure, aspect
            place.figure.visible = True
        place.reading.content = plain(drawing.reading)

    def _hide(self, place: _Place) -> None:
        place.title.content = place.reading.content = ""
        if place.figure is not None:
            place.figure.visible = False

    # ------------------------------------------------------------------ doing

    def _revision(self) -> int:
        """Revision of the state that this tab shows; a click is meant for this state."""
        return self._drawn.revision

    def _change(self, job: Callable[[], Any]) -> None:
        """Change the model, then diagnose it again."""
        if self._attempt(job):
            self.bench.look()

    def _attempt(self, job: Callable[[], Any]) -> bool:
        """Do a job; if it fails, show the reason."""
        try:
            job()
        except Exception as error:  # the page must survive any failure, and shows it
            self.client.add_notification("Not done", message_of(error), color="red", auto_close_seconds=20.0)
            return False
        return True

    def _formula(self) -> None:
        where = None if self.where.value == EVERY else [str(self.where.value)]
        self.bench.add_formula(str(self.formula.value), where, self._revision())

    def _said(self, what: str, path: Any) -> None:
        self.kept.content = plain(f"{what} written to {path}.")

    def _add(self, finding: Finding, revision: int) -> None:
        self._change(lambda: self.bench.add(finding.members, revision, finding))

    def _download(self) -> None:
        path = self.bench.export()
        self.client.send_file_download(path.name, path.read_bytes(), save_immediately=True)
        self.kept.content = plain(f"Report downloaded, and written to {path}.")

    def _light(self, joints: Sequence[str], joint: str) -> None:
        """Light up the joints of a finding, and show the curves of one of them."""
        if self.stage is not None:
            self.stage.lit = frozenset(joints)
        self._choose(joint)

    def _log_chosen(self) -> None:
        """Show one log alone, or all again."""
        chosen, prediction = str(self.log.value), self.bench.state.prediction
        if chosen == ALL:
            first, last = 0.0, float(self.time.max)
        else:
            k = int(chosen.partition(":")[0]) - 1
            first = float(side_by_side(prediction)[0][k])
            last = first + float(prediction.t[prediction.log == k].max(initial=0.1))
        self.stretch.value = (round(first, 2), round(min(last, float(self.time.max)), 2))
        self.time.value = max(round(first, 2), 0.0)
        self._zoomed()

    def _zoomed(self) -> None:
        """Draw the curves of the stretch between the two numbers."""
        first, last = self.stretch.value
        if last <= first:
            self.stretch.value = (0.0, float(self.time.max))
        with self._lock:
            self._torque()
        self.pose()

    def _toggle(self, _: Any) -> None:
        self.playing = not self.playing
        self.play.label = "Pause" if self.playing else "Play"

    def _choose(self, joint: str) -> None:
        self.joint.value = joint
        self._joint_changed()

    def _joint_changed(self) -> None:
        with self._lock:
            self._torque()
            self._residual()
        self.pose()

    def _sliding(self, joint: str) -> bool:
        robot = self.bench.state.model.robot
        return bool(robot.prismatic[robot.joints.index(joint)])
