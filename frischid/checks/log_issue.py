"""Results of data checks: one issue, and the report on one log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from frischid.checks.check_criteria import DEFAULT_CRITERIA, CheckCriteria
from frischid.checks.faults import Fix
from frischid.core.types import Array

Sureness = Literal["certain", "likely", "possible"]
EXPLANATIONS = ("payload", "missing hand", "wrong robot")
"""Issues that explain a torque and are found outside `frischid.checks.explanation`."""

UNDONE = ("standstill", "wrapped angle")
"""Issues that ask for nothing: every command undoes them, and a note says so. They are no warning beside a model."""


@dataclass(frozen=True)
class LogIssue:
    """A fault, or a likely fault, in a log.

    Attributes
    ----------
    kind : str
        Name of the issue, two or three fixed words: ``"late velocity"``.
    what : str
        The evidence, with figures.
    where : tuple of str
        The joints concerned; empty when the issue concerns the whole log.
    sure : {"certain", "likely", "possible"}
        Certain: no other cause gives this evidence. Likely: only a rare cause does. Possible: the reader must judge.
    advice : str
        The remedy.
    blocks : bool
        Whether an identification from this log would be worthless.
    """

    kind: str
    what: str
    where: tuple[str, ...]
    sure: Sureness
    advice: str
    blocks: bool = False

    def __str__(self) -> str:
        return f"{self.short}; {self.advice}"

    @property
    def short(self) -> str:
        """The issue without the advice, for the output of other commands."""
        place = f"{', '.join(self.where)}: " if self.where else ""
        return f"{place}{self.what} ({self.kind}, {self.sure})"

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {**vars(self), "where": list(self.where)}


@dataclass(frozen=True, repr=False)
class LogReport:
    """Result of `frischid.checks.inspect`: the issues and figures of one log. Printed, it lists the issues.

    Attributes
    ----------
    source : str
        The log.
    facts : mapping of str to object
        Figures of the whole log, for example ``rate_hz``.
    joints : mapping of str to mapping of str to float
        Figures of each joint, for example ``noise_q``; a figure that could not be measured is missing.
    issues : tuple of LogIssue
        Those that block an identification first, then the most certain.
    criteria : CheckCriteria
        The numbers that decided.
    fix : tuple of (str, str, object)
        Joint, key and value of the entries of a mapping file that undo the faults.
    """

    source: str
    facts: Mapping[str, Any]
    joints: Mapping[str, Mapping[str, float]]
    issues: tuple[LogIssue, ...]
    criteria: CheckCriteria = DEFAULT_CRITERIA
    fix: tuple[Fix, ...] = ()

    def __repr__(self) -> str:
        kinds = ", ".join(issue.kind for issue in self.issues) or "no issue"
        return f"LogReport({self.source!r}: {kinds})"

    def __str__(self) -> str:
        """The log, and each issue with its remedy."""
        lines = [line for issue in self.issues for line in (f"  {issue.short}", f"    → {issue.advice}")]
        return "\n".join([f"{self.source}:" if lines else f"{self.source}: nothing suspicious in the log", *lines])

    @property
    def blocked(self) -> bool:
        """Whether an identification from this log would be worthless."""
        return any(issue.blocks for issue in self.issues)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The issues as sentences."""
        return tuple(map(str, self.issues))

    def explained(self, joints: Sequence[str]) -> set[str]:
        """Those of the robot's joints whose torques an issue explains; an issue without joints concerns all of them."""
        named = {fault["kind"] for fault in self.facts.get("explanation", {"faults": ()})["faults"]}
        told = [x for x in self.issues if x.blocks or x.kind in named or x.kind in EXPLANATIONS]
        return {name for issue in told for name in issue.where or joints}

    def with_issue(self, issue: LogIssue) -> LogReport:
        """The report with one more issue."""
        return replace(self, issues=_ordered([*self.issues, issue]))


@dataclass
class Notebook:
    """Collects the issues and figures that the checks find; `report` turns them into a `LogReport`."""

    names: Sequence[str]
    criteria: CheckCriteria = DEFAULT_CRITERIA
    facts: dict[str, Any] = field(default_factory=dict)
    joints: dict[str, dict[str, float]] = field(default_factory=dict)
    issues: list[LogIssue] = field(default_factory=list)
    fix: tuple[Fix, ...] = ()

    def per_joint(self, quantity: str, values: Array) -> None:
        """Note a figure of every joint, (J,); values that are not finite are left out."""
        for name, value in zip(self.names, values, strict=True):
            if np.isfinite(value):
                self.joints.setdefault(name, {})[quantity] = float(value)

    def add(
        self, kind: str, what: str, where: Iterable[str], sure: Sureness, advice: str, *, blocks: bool = False
    ) -> None:
        """Add an issue; if it differs from an earlier issue only in the joints, the joints join the earlier one."""
        new = LogIssue(kind, what, tuple(where), sure, advice, blocks)
        for k, old in enumerate(self.issues):
            if new.where and replace(old, where=new.where) == new:
                joints = {*old.where, *new.where}
                self.issues[k] = replace(old, where=tuple(n for n in self.names if n in joints))
                return
        self.issues.append(new)

    def which(self, chosen: NDArray[np.bool_]) -> tuple[str, ...]:
        """Names of the chosen joints, (J,)."""
        return tuple(name for name, yes in zip(self.names, chosen, strict=True) if yes)

    def report(self, source: str) -> LogReport:
        """The report of everything noted, the most severe issue first."""
        return LogReport(source, self.facts, self.joints, _ordered(self.issues), self.criteria, self.fix)


def _ordered(issues: Iterable[LogIssue]) -> tuple[LogIssue, ...]:
    """Issues that block an identification first, then the most certain."""
    order = {"certain": 0, "likely": 1, "possible": 2}
    return tuple(sorted(issues, key=lambda f: (not f.blocks, order[f.sure])))


def span(values: Array, unit: str = "") -> str:
    """The smallest and largest value as text, ``0.1 to 0.3 s``."""
    low, high = f"{np.min(values):.3g}", f"{np.max(values):.3g}"
    return f"{low}{unit}" if low == high else f"{low} to {high}{unit}"
