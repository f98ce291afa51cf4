"""No command writes over a file that it reads, under whatever name; found by asking click for every command."""

import os
from itertools import product
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from frischid.cli import main
from frischid.cli.paths import InputPath, OutputFolder, OutputPath
from frischid.core.files import check_outputs
from frischid.errors import InputError
from frischid.logs.readers import write_log
from frischid.model.identification import identify
from frischid.motions.simulation import simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

COMMANDS = main.commands
NO_FILES = {
    "effects.name", "fetch.name", "add.effect", "add.joints", "identify.estimator", "identify.bbrf", "diagnose.only",
    "identify.torque_lag", "fleet.torque_lag",
    "simulate.values", "simulate.channels", "excite.family", "excite.criterion", "excite.separate", "excite.floor",
    "schema.name", "gains.carrier", "payload.carrier", "payload.frame", "excite.home",
    "export.box", "consistent.box", "studio.host",
    *(f"{command}.{option}" for command in COMMANDS for option in (
        "joints", "lock", "frames", "known", "effects", "torque_joints", "cutoff", "scheduler", "kp", "kd",
        "effort_limit", "dead_band", "delay", "delay_doubt", "gain")),
}  # fmt: skip
"""Parameters whose text is no name of a file: a new one is put here, or gets the type of a path."""
MADE_UP = {"payload": "1.0", "effect": "viscous", "name": "planar"}


def parameters(kind):
    """Pairs of a command's name and its parameters of a type."""
    return [(n, p) for n, command in sorted(COMMANDS.items()) for p in command.params if isinstance(p.type, kind)]


def written_as(parameter, value):
    """A parameter as it stands on a command line."""
    return [value] if isinstance(parameter, click.Argument) else [parameter.opts[-1], value]


def call(name, given):
    """A whole command line: the parameters that are `given`, and the required ones."""
    arguments = [name]
    for parameter in COMMANDS[name].params:
        if parameter.name in given:
            arguments += written_as(parameter, str(given[parameter.name]))
        elif parameter.required:
            arguments += written_as(parameter, MADE_UP.get(parameter.name, "nothing-of-this-name"))
    return arguments


def test_every_parameter_that_names_a_file_has_a_path_type():
    loose = {f"{n}.{p.name}" for n, p in parameters(click.types.StringParamType)} - NO_FILES
    assert loose == set()
    assert {type(p.type) for _, p in parameters(click.Path)} == {InputPath, OutputPath, OutputFolder}
    written = ("output", "page", "picture", "practice")
    outputs = {f"{n}.{p.name}" for n, p in parameters(click.Path) if p.name in written}
    assert outputs == {f"{n}.{p.name}" for n, p in parameters((OutputPath, OutputFolder))}


FORMS = ("same", "dots", "symlink", "hard link", "folder link")


def renamed(path, form):
    """Another name of a file."""
    folder, other = path.parent, path.parent / f"other{path.suffix}"
    if form == "same":
        return path
    if form == "dots":
        return folder / ".." / folder.name / "." / path.name
    if form == "symlink":
        other.symlink_to(path)
        return other
    if form == "hard link":
        os.link(path, other)
        return other
    link = folder.parent / f"{folder.name}-link"
    link.symlink_to(folder)
    return link / path.name


PAIRS = [
    (name, one.name, two.name)
    for name in sorted(COMMANDS)
    for one, two in product(COMMANDS[name].params, repeat=2)
    if isinstance(one.type, InputPath) and isinstance(two.type, OutputPath)
]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("command", "one", "two"), PAIRS, ids=["-".join(p) for p in PAIRS])
def test_no_command_writes_over_its_input(command, one, two, form, tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    for suffix in (".urdf", ".json", ".csv"):
        path = folder / f"input{suffix}"
        path.write_text("precious")
    output = renamed(path, form)
    result = CliRunner().invoke(main, call(command, {one: path, two: output}))
    assert result.exit_code == 2, result.output
    assert "is read as well: it would be overwritten" in result.stderr
    assert {p.read_text() for p in folder.iterdir()} == {"precious"}


def test_the_pairs_are_all_there():
    assert len(PAIRS) >= 25
    assert {n for n, _, _ in PAIRS} >= {"identify", "report", "export", "improve", "add", "map", "simulate", "studio"}


@pytest.mark.parametrize("command", ["demo", "excite"])
def test_two_outputs_have_two_names(command, tmp_path):
    outputs = [p.name for n, p in parameters(OutputPath) if n == command]
    result = CliRunner().invoke(main, call(command, dict.fromkeys(outputs, tmp_path / "same.html")))
    assert result.exit_code == 2
    assert "two outputs would go to this file" in result.stderr
    assert list(tmp_path.iterdir()) == []


MESH = '<visual><geometry><mesh filename="part.stl"/></geometry></visual>'


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A model, its log, and its URDF with a mesh beside it."""
    folder = tmp_path_factory.mktemp("made")
    source = (Path(__file__).parents[2] / "urdf" / "planar2.urdf").read_text(encoding="utf-8")
    urdf = folder / "arm.urdf"
    urdf.write_text(source.replace('<link name="link1">', f'<link name="link1">{MESH}', 1), encoding="utf-8")
    (folder / "part.stl").write_text("mesh")
    robot = Robot.load(urdf)
    log = simulate(robot, random_fourier(robot, 4.0, seed=0), rate=50.0, channels=())
    write_log(log, folder / "log.csv")
    identify(robot, [log], recursion="none").model.save(folder / "model.json")
    return folder


@pytest.mark.parametrize(
    "line",
    [
        "identify arm.urdf log.csv -o part.stl",
        "simulate arm.urdf -o part.stl",
        "report model.json log.csv -o part.stl",
        "fleet arm.urdf *.csv -o log.csv --scheduler none",
        "identify arm.urdf l*.csv -o log.csv --scheduler none",
    ],
)
def test_files_that_the_work_itself_finds_are_safe_too(made, line, monkeypatch):
    monkeypatch.chdir(made)
    before = {p.name: p.read_bytes() for p in made.iterdir()}
    result = CliRunner().invoke(main, line.split())
    assert result.exit_code == 2, result.output
    assert "is read as well" in result.stderr
    assert {p.name: p.read_bytes() for p in made.iterdir()} == before


def test_the_studio_keeps_its_report_from_its_inputs(made, monkeypatch):
    monkeypatch.chdir(made)
    (made / "model-studio.html").write_text("precious")
    try:
        result = CliRunner().invoke(main, ["studio", "model.json", "log.csv", "model-studio.html"])
        assert (result.exit_code, "is read as well" in result.stderr) == (2, True)
        assert (made / "model-studio.html").read_text() == "precious"
    finally:
        (made / "model-studio.html").unlink()


def test_a_file_within_an_input_folder_is_safe(tmp_path):
    bag = tmp_path / "bag"
    (bag / "deep").mkdir(parents=True)
    (bag / "deep" / "data.mcap").write_text("precious")
    with pytest.raises(InputError, match="read as well"):
        check_outputs([bag / "deep" / "data.mcap"], [bag])
    check_outputs([bag / "model.json"], [bag])
