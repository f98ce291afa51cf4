"""The first object of an identification: logs that are checked and filtered, and the messages on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from frischid.checks.log_issue import LogIssue
from frischid.core.progress import counter
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion
from frischid.logs.recording import Motions, Recording
from frischid.logs.summary import Data, LogSummary
from frischid.model.identify_options import IdentifyOptions
from frischid.robot.robot import Robot

IDENTIFY_STAGES = (
    "reading the logs",
    "checking the logs",
    "dry friction",
    "regressor and moments",
    "estimate",
    "bounding-box recursion",
    "cross-validation",
    "comparison",
)
"""Stages of an identification, as a progress bar names and counts them."""


@dataclass
class Journal:
    """Messages of the stages to the user."""

    progress: Callable[[str], None]
    """Called with a few words at each stage."""
    notes: list[str] = field(default_factory=list)
    """Changes of the data."""
    warnings: list[str] = field(default_factory=list)
    """Reasons to doubt the result."""
    faults: list[tuple[str, LogIssue]] = field(default_factory=list)
    """Names of logs, and their faults that make a wrong model and can be undone."""
    explained: set[str] = field(default_factory=set)
    """Joints whose torques a fault explains that is named in the warnings."""
    words: str = IDENTIFY_STAGES[0]

    def stage(self, words: str) -> None:
        """Tell that a stage of `IDENTIFY_STAGES` begins."""
        self.words = words
        self.progress(f"{words} ({IDENTIFY_STAGES.index(words) + 1} of {len(IDENTIFY_STAGES)})")

    def passed(self, samples: int, of: int) -> None:
        """Tell how many samples of recordings the present stage has read."""
        counter(self.progress, self.words, of)(samples)


@dataclass(frozen=True, eq=False)
class LogData:
    """Stage 1: the logs, checked and filtered."""

    robot: Robot
    """The robot, with the joints locked that some log does not hold."""
    logs: tuple[Data, ...]
    valid: tuple[Data, ...]
    """`logs`, `valid`: Logs to fit, and logs to measure the error on."""
    joints: tuple[str, ...]
    """Joints whose torque is fitted."""
    summary: LogSummary
    """Filter, samples and seconds of the logs."""
    motions: Iterable[Motion]
    """In memory; motions of recordings are read again in every iteration."""
    preparation: Motions
    """Its notes name the changes of the logs, after the first iteration over the motions."""
    options: IdentifyOptions
    journal: Journal

    @property
    def lowpass(self) -> LowPass:
        """Filter of torque and regressor."""
        return self.summary.lowpass

    @property
    def streamed(self) -> bool:
        """Whether some log is a recording, read anew each time."""
        return any(isinstance(log, Recording) for log in self.logs)

    @property
    def some_motions(self) -> list[Motion]:
        """All motions in memory; of recordings the first few."""
        if isinstance(self.motions, list):
            return self.motions
        return list(islice(self.motions, self.options.criteria.friction_pieces))

    @property
    def independent_rows(self) -> float:
        """Torque rows that are not copies of their neighbours: two per second, hertz of bandwidth and joint."""
        if isinstance(self.motions, list) and all(motion.at_poses for motion in self.motions):
            return float(sum(len(motion.t) for motion in self.motions) * len(self.joints))
        rate = sum(self.summary.samples) / max(self.summary.seconds, 1e-9)
        return 2.0 * min(self.lowpass.cutoff or np.inf, 0.5 * rate) * self.summary.seconds * len(self.joints)
