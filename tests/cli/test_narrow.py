"""No number and no word is broken, however narrow the terminal."""

import io
import re
import shlex

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from test_cli import fitted, logs, run  # noqa: F401 (fixtures)
from widths import assert_whole

from frischid.cli import main, output
from frischid.cli.narrow import Command, Wide
from frischid.cli.narrow import fitted as pieces_of
from frischid.cli.pages.checking import _clock
from frischid.cli.pages.page import figure
from frischid.effects import parse_effects
from frischid.logs.readers import write_log
from frischid.motions.simulation import simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

WORD = st.text("abcdefgh0123456789.-", min_size=1, max_size=9)
CELL = st.lists(WORD, min_size=1, max_size=4).map(" ".join)


def printed(table, width):
    stream = io.StringIO()
    console = Console(file=stream, width=width, highlight=False)
    for piece in pieces_of(table, width):
        console.print(piece)
    return stream.getvalue()


@given(st.integers(2, 7), st.integers(1, 4), st.sampled_from((20, 40, 60, 80, 120)), st.data())
def test_every_word_of_a_table_stays_whole(columns, rows, width, data):
    headings = [f"column{k}" for k in range(columns)]
    droppable = data.draw(st.lists(st.sampled_from(headings[1:]), unique=True))
    table = Wide(*headings, droppable=droppable)
    cells = [[data.draw(CELL) for _ in headings] for _ in range(rows)]
    for row in cells:
        table.add_row(*row)
    text = printed(table, width)
    assert all(cell_len(line) <= width for line in text.splitlines())
    left_out = re.search(r"no room for: ([^;]*);", " ".join(text.split()))
    gone = [] if left_out is None else left_out.group(1).split(", ")
    for row in cells:
        for heading, cell in zip(headings, row, strict=True):
            if heading not in gone:
                assert set(cell.split()) <= set(text.split())
    assert set(gone) <= set(droppable)


def test_a_long_cell_of_a_row_by_row_table_is_no_new_row():
    table = Wide("effect", "stands for", "equation")
    table.add_row("cogging", "ripple", f"{'x' * 30} {'word ' * 12}last")
    first, *others = printed(table, 40).splitlines()
    assert first == "cogging"
    assert len(others) > 2
    assert all(line.startswith("  ") for line in others)
    assert all(line.startswith("    ") for line in others if "stands for" not in line and "equation" not in line)


def test_steps_that_are_all_equal_are_no_range():
    assert _clock({"steps_ms": (5.0, 5.0, 5.0), "mean_rate_hz": 200.0}) == ["  mean rate 200 Hz, every step 5 ms"]
    (jitter,) = _clock({"steps_ms": (7.9, 10.0, 12.1), "mean_rate_hz": 100.0})
    assert jitter == "  mean rate 100 Hz, steps 7.9 to 12.1 ms (usual 10 ms)"


def test_no_zero_has_a_sign():
    assert figure(-0.0) == "0"
    assert figure(-0.5) == "-0.5"


def test_a_table_with_room_is_printed_whole():
    table = Wide("joint", "error", droppable=("error",))
    table.add_row("elbow", "0.1234")
    assert printed(table, 80).split() == ["joint", "error", "elbow", "0.1234"]


@pytest.mark.parametrize("width", [60, 80, 120])
def test_commands_keep_within_the_width(fitted, logs, width):  # noqa: F811
    path = logs / "model.json"
    wide = ["--width", "1000"]
    for command in (
        ["info", "planar2"],
        ["identify", "planar2", logs / "first.parquet", "--bbrf", "none", "--parameters"],
        ["compare", path, logs / "valid.npz"],
        ["check", "planar2", logs / "first.parquet"],
        ["history", path],
        ["effects"],
    ):
        text = run(*command, "--width", width).stdout
        assert all(cell_len(line.rstrip()) <= width for line in text.splitlines()), command
        numbers = set(re.findall(r"(?<![\w./-])-?\d+\.\d+(?![\w./])", text))
        whole = set(re.findall(r"(?<![\w./-])-?\d+\.\d+(?![\w./])", run(*command, *wide).stdout))
        assert numbers <= whole, (command, numbers - whole)  # a broken number is a new number


def test_the_width_may_stand_before_the_command_or_after_it():
    def lines(*arguments):
        return run(*arguments).stdout.splitlines()

    assert lines("--width", 60, "effects") == lines("effects", "--width", 60) != lines("effects", "--width", 100)
    assert lines("--width", 60, "effects", "--width", 100) == lines("effects", "--width", 100)
    assert lines("--quiet", "effects", "--width", 60) == lines("effects", "--width", 60)


EVERY = (
    "info robot.urdf",
    "demo --report demo.html",
    "demo --practice again",
    "doctor",
    "fetch",
    "excite robot.urdf --duration 5 --budget 60 -o motion.csv",
    "excite robot.urdf --duration 5 --budget 60 --home zero -o motion.yaml",
    "simulate robot.urdf --duration 5 -o simulated.csv",
    "map monday.csv robot.urdf -o map.toml",
    "check robot.urdf log.csv",
    "check robot.urdf turned.csv",
    "cut log.csv --until 5 -o part.csv",
    "identify robot.urdf log.csv --valid test.csv --parameters",
    "compare model.json test.csv",
    "compare model.json test.csv --simulate",
    "history model.json",
    "report model.json log.csv test.csv -o page.html",
    "diagnose model.json log.csv",
    "add model.json joint_spring log.csv --joints joint2 -o better.json",
    "improve model.json log.csv --max-steps 1 -o best.json",
    "effects",
    "effects hysteresis",
    "consistent model.json -o links.json",
    "export model.json -o out.urdf",
    "export model.json -o out.c",
    "export model.json -o drives.csv",
    "payload model.json loaded.csv -o tool.json",
    "gains robot.urdf --unloaded unloaded_currents.csv --loaded loaded_currents.csv --payload 2.0",
    "fleet robot.urdf fleet/*/*.parquet --scheduler none",
)
"""One line for each command with tables. `paper` takes a minute, so its tables have a test of their own; `studio`
prints an address; `schema` and `completion` print text for programs."""


@pytest.fixture(scope="module")
def practice(tmp_path_factory):
    folder = tmp_path_factory.mktemp("practice") / "arm"
    run("demo", "--practice", folder)
    return folder


@pytest.mark.parametrize("line", EVERY)
def test_no_command_breaks_a_number_or_a_word(line, practice, monkeypatch):
    """The page is made once, and printed for terminals of several widths."""
    monkeypatch.chdir(practice)
    pages = []
    monkeypatch.setattr(output, "_print", pages.append)
    done = CliRunner().invoke(main, line.split())
    assert done.exit_code in (0, 1), done.output  # an alarm ends with 1
    (page,) = pages
    assert_whole(page)


def test_every_effect_that_a_help_text_shows_is_one_that_can_be_typed():
    found = []
    for name in main.commands:
        shown = CliRunner().invoke(main, [name, "--help"], terminal_width=1000).output
        found += re.findall(r"[\w(=.),@]*\w+\([a-z_]+=[\w.]+\)(?:[\w,]*@\w+)?", shown)
    assert len(found) > 3
    for text in found:
        assert parse_effects(text), text


@pytest.mark.parametrize("width", [60, 80])
def test_the_help_of_every_command_keeps_within_the_width(width):
    for name in main.commands:
        shown = CliRunner().invoke(main, [name, "--help"], terminal_width=width).output
        text = [x for x in shown.splitlines() if ": frischid " not in x]  # a command to copy stays in one line
        assert all(cell_len(x) <= width for x in text), name


def test_a_command_to_copy_continues_over_lines_as_a_shell_reads_it():
    command = "next: frischid diagnose model.json 'a log with a name.csv' another_log.parquet --map map.toml"
    lines = printed(Command(command), 40).splitlines()
    assert all(cell_len(line) <= 40 for line in lines)
    assert all(line.endswith(" \\") for line in lines[:-1])
    assert shlex.split("\n".join(lines).replace("\\\n", "")) == shlex.split(command)
    assert printed(Command(command), 200).splitlines() == [command]


def test_a_long_word_of_a_command_continues_after_a_comma_as_a_shell_reads_it():
    command = f"frischid excite robot.urdf --separate {','.join(f'joint_spring@joint{k}' for k in range(5))} -o a.csv"
    for width in (30, 40, 60):
        lines = printed(Command(command), width).splitlines()
        assert all(cell_len(line) <= width for line in lines)
        assert shlex.split("\n".join(lines).replace("\\\n", "")) == shlex.split(command)


@pytest.mark.parametrize("name", ["cut[old].csv", "run[/red].csv", "[/bold]", "a[1].csv", "[link=x]y"])
def test_brackets_in_a_name_are_no_markup(name):
    table = Wide(f"joint {name}", "value", title=name)
    table.add_row(name, "1")
    for part in (f"written to {name}", f"  written to {name}", f"written to {escape(name)}", table):
        assert printed(part, 120).count(name) == (1 if isinstance(part, str) else 3)
        assert name in printed(part, 20).replace("\n", "")


def test_the_file_that_was_written_is_named_as_it_is(tmp_path):
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 5, seed=1), rate=50)
    write_log(log, tmp_path / "log.csv")
    written = tmp_path / "cut[old].csv"
    result = CliRunner().invoke(main, ["cut", str(tmp_path / "log.csv"), "--until", "4", "-o", str(written)])
    assert "cut[old].csv" in result.output
    assert written.exists()
