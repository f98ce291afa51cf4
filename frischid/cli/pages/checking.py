"""Data checks as pages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.markup import escape

from frischid.checks import LogIssue, LogReport
from frischid.cli.pages.page import Page, figure, table_of
from frischid.core.text import counted, percent, rounded
from frischid.logs.dataset_list import Dataset
from frischid.logs.log import Log
from frischid.logs.proposal import Proposal

CORRECT_FIRST = ", correct this before you identify"
"""Beside how sure an issue is, where the issue makes a wrong model."""
COLUMNS = {
    "standstill": "standstill",
    "noise_q": "noise q",
    "noise_v": "noise v",
    "noise_tau": "noise τ",
    "noise_current": "noise i",
    "quantum_tau": "step τ",
    "velocity_lag": "lag v",
    "torque_lag": "lag τ",
    "friction_nrmse": "friction only",
    "nominal_nrmse": "URDF + friction",
    "free_nrmse": "free",
}


@dataclass(frozen=True)
class Correction:
    """The mapping file or robot that undoes the faults of logs."""

    mapping: str = ""
    """Text of a mapping file; empty if none can undo a fault."""
    robot: tuple[str, ...] = ()
    """What a corrected URDF changes instead; empty if the URDF's joints are right."""
    output: str | None = None
    """File that was written."""
    as_robot: bool = False
    """Whether the URDF was wanted."""
    missed: str | None = None
    """File that was wanted, and not written: nothing would stand in it."""

    def lines(self) -> list[str]:
        """The correction as text."""
        parts = []
        if self.mapping:
            where = f"written to {self.output}" if self.output and not self.as_robot else "-o FILE writes it"
            parts += ["", f"mapping file that undoes what it can ({where}):", escape(self.mapping)]
        if self.robot:
            where = f"written to {self.output}" if self.output and self.as_robot else "-o FILE.urdf writes it"
            parts += [
                f"or, if the URDF is wrong and not the log, the URDF corrected ({where}; limits stay as they are):"
            ]
            parts += [f"  {escape(sentence)}" for sentence in self.robot]
        if self.missed and self.as_robot:
            parts.append("no URDF written: the faults found are not faults of the URDF's joints")
        elif self.missed:
            parts.append(f"{escape(self.missed)} not written: no fault was found that a mapping file surely undoes")
        return parts


def check(reports: Sequence[LogReport], correction: Correction | None = None) -> Page:
    """Figures and issues of logs, and what undoes those that can be undone."""
    correction = correction or Correction()
    parts: list[Any] = [_verdict(reports)]
    for report in reports:
        parts.append(_headline(report.source, report.facts))
        parts += [line for issue in report.issues for line in lines(issue)]
        parts += ["  nothing suspicious"] * (len(reports) > 1 and not report.issues)
        parts += [f"  {escape(n.removeprefix(f'{report.source}: '))}" for n in report.facts.get("notes", ())]
        parts += [*_clock(report.facts), *_joints(report.joints), *_parameters(report.facts)]
    logs = [
        {
            "log": report.source,
            **report.facts,
            "joint_figures": {name: dict(values) for name, values in report.joints.items()},
            "issues": [issue.to_dict() for issue in report.issues],
            "warnings": list(report.warnings),
            "blocked": report.blocked,
        }
        for report in reports
    ]
    parts += correction.lines()
    criteria = reports[0].criteria.to_dict()
    ok = not any(report.issues for report in reports)
    data = {"logs": logs, "ok": ok, "correction": correction.mapping, "robot_correction": list(correction.robot)}
    return Page({**data, "criteria": criteria}, parts)


def _verdict(reports: Sequence[LogReport]) -> str:
    """All logs in a line: nothing suspicious, or how many logs have which faults."""
    logs = f"{len(reports)} logs" if len(reports) > 1 else "log"
    doubtful = [report for report in reports if report.issues]
    if not doubtful:
        unjudged = next((f"; {r.facts['nominal']}" for r in reports if "nominal" in r.facts), "")
        return f"[bold]Nothing suspicious in the {logs}{unjudged}.[/bold]"
    kinds = ", ".join(dict.fromkeys(issue.kind for report in doubtful for issue in report.issues))
    first = f"{len(doubtful)} of {logs}" if len(reports) > 1 else "The log"
    return f"[bold]{first} need{'s' * (len(doubtful) == 1)} attention: {kinds}.[/bold]"


def lines(issue: LogIssue) -> list[str]:
    """An issue as text: evidence and joints, then the remedy."""
    place = f"{', '.join(issue.where)}: " if issue.where else ""
    colour = "red" if issue.blocks else "yellow"
    return [
        f"[{colour}]{issue.kind}[/{colour}] ({issue.sure}{CORRECT_FIRST * issue.blocks}) {escape(place + issue.what)}",
        f"    → {escape(issue.advice)}",
    ]


def _headline(source: str, facts: Mapping[str, Any]) -> str:
    if "samples" not in facts:
        return f"[bold]{escape(source)}[/bold]: cannot be read as it is"
    channels = ", ".join(("q", *facts.get("channels", ())))
    rate = facts["rate_hz" if facts.get("gaps") or "mean_rate_hz" not in facts else "mean_rate_hz"]
    return (
        f"[bold]{escape(source)}[/bold]: {facts['samples']} samples, {facts['seconds']:.4g} s at "
        f"{rate:.4g} Hz, "
        f"{counted(len(facts.get('joints', ())), 'joint')}, channels {channels}"
    )


def _clock(facts: Mapping[str, Any]) -> list[str]:
    if "steps_ms" not in facts:
        return []
    low, usual, high = facts["steps_ms"]
    least, most, middle = (f"{step:.4g}" for step in (low, high, usual))
    steps = f"every step {middle} ms" if least == most else f"steps {least} to {most} ms (usual {middle} ms)"
    words = f"  mean rate {facts['mean_rate_hz']:.4g} Hz, {steps}"
    if "stamps_follow" in facts:
        words += f", jitter {percent(facts['jitter'], 1)} of a step; the positions follow it by a factor of "
        words += rounded(facts["stamps_follow"], facts["stamps_follow_error"])
        words += " (1: the stamps are the times of measurement)"
    if facts.get("missing_share"):
        words += f"; {percent(facts['missing_share'], 1)} of the samples missing"
    again = facts.get("comes_again_after")
    said = f"  the motion comes again after {again:.4g} s: a diagnosis measures the noise there" if again else ""
    return [words, said] if said else [words]


def _joints(joints: Mapping[str, Mapping[str, float]]) -> list[Any]:
    there = [key for key in COLUMNS if any(key in values for values in joints.values())]
    if not there:
        return []
    table = table_of("joint", *(COLUMNS[key] for key in there))
    for name, values in joints.items():
        table.add_row(name, *(figure(float(f"{values[key]:.2g}")) if key in values else "–" for key in there))
    words = (
        "  standstill: share of the samples in which the joint does not move; noise in the channels' units, lag in s"
    )
    if "nominal_nrmse" in there:
        words += (
            "; the last three columns are NRMSE: of friction alone, of the URDF's links with fitted friction, and of "
            "free parameters (cross-validated: large where the log is short)"
        )
    return [table, words]


def _parameters(facts: Mapping[str, Any]) -> list[str]:
    if "nominal" in facts:
        return [f"  {facts['nominal']}"]
    unseen = facts.get("unseen_parameters")
    if unseen is None:
        return []
    number = facts["rigid_parameters"]
    these = f"{counted(number, 'rigid base parameter')} that {'is' if number == 1 else 'are'} not 0 in the URDF"
    if not unseen:
        every = "" if number == 1 else "all "
        return [f"  this log determines {every}{these}: the standard error of each is below its value there"]
    return [
        f"  of {these}, this log alone does not determine {len(unseen)} (standard error above the URDF's value): "
        f"{', '.join(unseen)}"
    ]


def datasets(known: Mapping[str, Dataset]) -> Page:
    """The data sets that can be fetched."""
    data = [
        {"name": name, "title": x.title, "licence": x.licence, "page": x.page, "files": len(x.files)}
        for name, x in known.items()
    ]
    table = table_of("what", "equation", "licence", "page")
    table.columns[0].header, table.columns[1].header = "data set", "holds"
    for row in data:
        table.add_row(*(escape(str(x)) for x in (row["name"], row["title"], row["licence"], row["page"])))
    return Page(data, [table])


def fetched(name: str, about: str, paths: Sequence[str]) -> Page:
    """A fetched data set: its origin, and the files that were written."""
    return Page(
        {"name": name, "about": about, "logs": list(paths)}, [escape(about.strip()), *(f"written: {p}" for p in paths)]
    )


def cut(part: Log, output: str) -> Page:
    """A part of a log that was written."""
    data = {"output": output, "samples": len(part), "seconds": part.duration}
    return Page(data, [f"{len(part)} samples, {part.duration:.4g} s, written to {output}"])


def proposal(found: Proposal, text: str, output: str | None) -> Page:
    """A proposed mapping file."""
    data = {
        "mapping": found.tables(),
        "reasons": found.reasons,
        "missing": list(found.missing),
        "guesses": found.guesses,
    }
    joints = f"{counted(len(found.joints), 'joint')} found, {len(found.missing)} without a position column"
    if found.guesses:
        joints += f"; {len(found.guesses)} guess{'es' * (len(found.guesses) > 1)} to look at"
    return Page(data, [escape(text), joints, *([f"written to {output}"] if output else [])])
