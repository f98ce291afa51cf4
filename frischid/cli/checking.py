"""The commands `check`, `map`, `cut` and `fetch`: faults of logs, their columns, parts of them, public data sets."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from frischid.cli.arguments import (
    MapFiles,
    RobotArguments,
    json_option,
    map_option,
    matching,
    robot_options,
    torque_joints_option,
)
from frischid.cli.controllers import ControllerArguments, controller_options
from frischid.cli.group import main
from frischid.cli.inputs import load, names_of
from frischid.cli.output import show_page, working
from frischid.cli.paths import InputPath, OutputFolder, OutputPath, check_found
from frischid.errors import InputError

if TYPE_CHECKING:
    from frischid.checks import LogReport
    from frischid.logs.log import Log


@main.command()
@click.argument("robot", type=InputPath())
@click.argument("logs", type=InputPath(), nargs=-1, required=True)
@robot_options
@map_option
@controller_options
@torque_joints_option
@click.option(
    "-o",
    "--output",
    type=OutputPath(),
    help="Write what undoes the faults here: a mapping file (TOML), or the corrected robot (FILE.urdf).",
)
@json_option
def check(
    robot: str,
    logs: tuple[str, ...],
    mapping: MapFiles,
    torque_joints: str | None,
    output: str | None,
    controller: ControllerArguments,
    as_json: bool,
    **options: Any,
) -> None:
    """Find faults in logs.

    Examples are wrong clocks, dead channels, units, signs, payloads, and the wrong robot. Faults that a mapping file
    can undo (signs, exchanged columns, zeros, units) are printed as such a file, and written with -o. If the URDF is
    wrong instead (a zero, an axis, exchanged joints), -o FILE.urdf writes it corrected.

    Exit code 0: no issue. 1: an issue to look at. 2: a log cannot be used at all.
    """
    from frischid.checks import corrected_urdf, defects
    from frischid.cli.pages import checking as show
    from frischid.core.files import write_text
    from frischid.logs.mapping import LogMap
    from frischid.model.log_examination import check as check_logs

    with working(as_json) as progress:
        progress("reading logs")
        try:
            machine, data = load(robot, RobotArguments(**options), logs, mapping, whole=False, progress=progress)
        except InputError:
            # Reading stops at the first error. If the file has further faults or lines, the page lists them all first.
            form = LogMap.of(mapping)
            broken = [report for path in logs if (report := defects(Path(path), form)) is not None]
            if sum(max(len(report.issues), report.facts.get("bad_lines", 0)) for report in broken) > 1:
                show_page(show.check(broken), as_json)
            raise
        progress("checking")
        reports = check_logs(
            machine,
            data,
            controller=controller.read(names_of(machine)),
            currents=controller.currents(names_of(machine)),
            torque_joints=matching(torque_joints, machine.joints),
            progress=progress,
        )
    try:
        text = _corrections(logs, mapping, data, reports)
    except InputError:  # the logs need different corrections
        if output:
            show_page(show.check(reports), as_json)
            raise
        text = ""
    fixes = {report.fix for report in reports}
    robot_text, moved = corrected_urdf(machine, fixes.pop()) if len(fixes) == 1 else ("", ())
    as_robot = output is not None and Path(output).suffix == ".urdf"
    content = robot_text if as_robot else text
    if output and content:
        write_text(Path(output), content)
    written, missed = (output, None) if content else (None, output)
    show_page(show.check(reports, show.Correction(text, moved, written, as_robot=as_robot, missed=missed)), as_json)
    sys.exit(1 if any(report.issues for report in reports) else 0)


def _corrections(logs: Sequence[str], mapping: MapFiles, data: Sequence[Log], reports: Sequence[LogReport]) -> str:
    """Mapping file that undoes the faults of all logs; empty if there is none that it can undo."""
    from frischid.logs.layouts import layout_of
    from frischid.logs.mapping import LogMap
    from frischid.logs.mapping_fix import together
    from frischid.logs.recording import preview_of

    if not any(report.fix for report in reports):
        return ""
    form = LogMap.of(mapping)
    parts = []
    for path, log, report in zip(logs, data, reports, strict=True):
        parts.append((Path(path).name, layout_of(Path(path), form), report.fix, preview_of(log)))
    return together(parts)


@main.command()
@click.argument("name", required=False)
@click.option("-o", "--output", type=OutputFolder(), help="Folder for the files; the data set's name by default.")
@click.option("--from", "source", type=InputPath(), help="Folder that already holds the files; nothing is downloaded.")
@json_option
def fetch(name: str | None, output: str | None, source: str | None, as_json: bool) -> None:
    """Fetch public logs of real robots; without NAME, list them.

    Files are verified by their checksum. Files without one are put into a folder by hand (--from), and their contents
    are checked.
    """
    from frischid.cli.pages import checking as show
    from frischid.logs import datasets
    from frischid.logs.dataset_list import DATASETS

    if name is None:
        show_page(show.datasets(DATASETS), as_json)
        return
    with working(as_json) as progress:
        dataset, paths = datasets.fetch(name, output or name, source, progress)
    show_page(show.fetched(name, datasets.about(dataset), [str(p) for p in paths]), as_json)


@main.command("map")
@click.argument("log", type=InputPath())
@click.argument("robot", type=InputPath())
@click.option("-o", "--output", type=OutputPath(), help="Write the mapping file here (TOML).")
@click.option("--rate", type=click.FloatRange(min=0, min_open=True), help="Samples per second of a file without time.")
@json_option
def map_columns(log: str, robot: str, output: str | None, rate: float | None, as_json: bool) -> None:
    """Propose a mapping file for the columns of LOG.

    Names, their order, the motion and the URDF's torque decide the column of each of ROBOT's joints.

    Exit code 0: names or motion decide everything. 1: something is guessed, and the file
    names it. 2: nothing fits, and no file is written.
    """
    from frischid.cli.pages import checking as show
    from frischid.core.files import write_text
    from frischid.logs.mapping_guess import propose
    from frischid.robot.robot import Robot

    machine = Robot.load(robot)
    found = propose(log, machine, rate)
    if output:
        write_text(Path(output), found.toml(Path(log).name))
    show_page(show.proposal(found, found.toml(Path(log).name), output), as_json)
    sys.exit(1 if found.guesses else 0)


@main.command()
@click.argument("log", type=InputPath())
@click.option("--from", "start", type=float, help="First second to keep, counted from the log's first sample.")
@click.option("--until", "stop", type=float, help="Second before which the part ends.")
@map_option
@click.option("-o", "--output", type=OutputPath(), required=True, help="Write the part here (.csv, .parquet, .npz).")
@json_option
def cut(log: str, start: float | None, stop: float | None, mapping: MapFiles, output: str, as_json: bool) -> None:
    """Write a part of LOG: a stretch to fit, or one to hold out.

    Two parts of one log are two logs: one is fitted, the other is given to --valid. The columns are written with
    frischid's names, in SI units.
    """
    from frischid.cli.pages import checking as show
    from frischid.logs.mapping import LogMap
    from frischid.logs.readers import read_log, write_log
    from frischid.logs.stretch import stretch

    check_found([log])
    part = stretch(read_log(log, mapping=LogMap.of(mapping)), start, stop)
    write_log(part, output)
    show_page(show.cut(part, output), as_json)
