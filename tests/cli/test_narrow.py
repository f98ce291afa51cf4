"""No number and no word is broken, however narrow the terminal."""

import io
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console
from test_cli import fitted, logs, run  # noqa: F401 (fixtures)

from frischid.cli.narrow import Wide
from frischid.cli.narrow import fitted as pieces_of

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
