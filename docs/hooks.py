"""What the site makes while it is built: pages of files in the root, the command line, and an offline search.

MkDocs calls the functions `on_...`; their names and arguments are MkDocs'.
"""

from __future__ import annotations

import html
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from frischid.cli import main

ROOT = Path(__file__).parents[1]
SHOWN = {"project/contributing.md": "CONTRIBUTING.md", "project/changelog.md": "CHANGELOG.md"}
COMMANDS, NAMES = "<!-- commands -->", "<!-- names -->"
TITLES = {
    "robot": "Robots",
    "logs": "Logs",
    "model": "Models",
    "forward": "Simulated motion",
    "effects": "Effects",
    "diagnosis": "Diagnosis",
    "motions": "Motions",
    "export": "Physical links, export, drives",
    "reports": "Pages",
    "core": "Progress",
    "paper": "The paper",
    "errors": "Errors",
}
"""Folder of the package -> title of its names; other folders have their own name."""
RESULTS = (
    "model.identify_options.IdentifyOptions",
    "model.parameters.Parameter",
    "estimators.least_squares.Estimate",
    "estimators.frisch.Box",
    "regression.base_parameters.Reduction",
    "model.joint_fit.JointFit",
    "model.alarms.Alarm",
    "model.alarms.AlarmCriteria",
    "model.drive_parameters.DriveParameter",
    "model.own_logs.OwnLogs",
    "checks.log_issue.LogReport",
    "checks.log_issue.LogIssue",
    "diagnosis.findings.Finding",
    "diagnosis.step.Step",
    "diagnosis.contacts.Contact",
    "diagnosis.criteria.DiagnosisCriteria",
    "diagnosis.motion_space.SimulatedFinding",
    "effects.state.State",
    "effects.state.Term",
    "forward.forward_dynamics.SimulatedMotion",
    "forward.motion_error.HorizonError",
    "motions.limits.MotionLimits",
    "reports.study.Study",
    "errors.UnknownNameError",
    "errors.IdentifiabilityError",
)
"""Objects that public functions take and return, by module."""
SHIM = "https://unpkg.com/iframe-worker/shim"  # Material's search from the disk; docs/assets holds a copy


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Put the text of a root's file, and the help of all commands, into their pages."""
    name = SHOWN.get(page.file.src_uri)
    if name is not None:
        text = (ROOT / name).read_text(encoding="utf-8")
        return f"{text.replace('](docs/', '](../')}\n{markdown}"
    for mark, lines in ((COMMANDS, command_lines), (NAMES, name_lines)):
        if mark in markdown:
            markdown = markdown.replace(mark, "\n".join(lines()))
    return markdown


def on_post_page(output: str, *, page: Any, **_: Any) -> str:
    """No page needs another address than its own."""
    return output.replace(SHIM, f"{'../' * page.url.count('/')}assets/iframe-worker.js")


def on_post_template(output: str, **_: Any) -> str:
    """Nor does the page for an address that does not exist, whose own addresses begin at the site's root."""
    return output.replace(SHIM, "/assets/iframe-worker.js")


def command_lines() -> Iterator[str]:
    """Every command's help, as Markdown."""
    for name, command in sorted(main.commands.items()):
        context = click.Context(command, info_name=f"frischid {name}")
        yield f"## frischid {name}\n"
        yield f"    {' '.join(command.get_usage(context).removeprefix('Usage: ').split())}\n"
        yield f"{escaped(inspect.cleandoc(command.help or ''))}\n"
        yield "| option | meaning |\n|---|---|"
        for parameter in command.get_params(context):
            record = parameter.get_help_record(context)
            if record is not None and isinstance(parameter, click.Option):
                yield f"| <code>{escaped(record[0])}</code> | {escaped(record[1])} |"
        yield ""


def name_lines() -> Iterator[str]:
    """Every public name, as `frischid/__init__.pyi` lists them, with a line for mkdocstrings."""
    stub = (ROOT / "frischid" / "__init__.pyi").read_text(encoding="utf-8")
    names = re.findall(r"^from \.([\w.]+) import (\w+) as", stub, flags=re.MULTILINE)
    found = [(module, name) for module, name in names if name != "__version__"]
    folders = {module.split(".")[0] for module, _ in found}
    for folder in sorted(folders, key=lambda f: [*TITLES, f].index(f)):
        yield f"## {TITLES.get(folder, folder.capitalize())}\n"
        yield from (f"::: frischid.{m}.{name}\n" for m, name in found if m.split(".")[0] == folder)
    yield "## Results and options\n"
    yield "Objects that the functions above return or take. They are read, or imported from the module that is shown.\n"
    for path in RESULTS:
        yield f"::: frischid.{path}\n    options: {{show_root_full_path: true}}\n"


def escaped(text: str) -> str:
    """Text in which Markdown and tables see no marks."""
    return html.escape(text).replace("|", "&#124;").replace("*", "&#42;").replace("_", "&#95;")
