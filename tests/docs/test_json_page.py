"""The page on JSON lists every key that a command prints, and no other."""

import json
import re
import shlex

import pytest
from click.testing import CliRunner
from fences import DOCS, text_of

from frischid.cli import main

LINES = {
    "info ROBOT": "info robot.urdf",
    "map": "map log.csv robot.urdf",
    "check": "check robot.urdf log.csv",
    "cut": "cut log.csv --until 10 -o part.csv",
    "identify": "identify robot.urdf log.csv --valid test.csv --bbrf none",
    "compare": "compare model.json test.csv",
    "diagnose": "diagnose model.json log.csv --try joint_spring",
    "add": "add model.json joint_spring@joint2 log.csv -o better.json",
    "improve": "improve model.json log.csv --max-steps 1 -o best.json",
    "history": "history model.json",
    "report": "report model.json test.csv -o r.html",
    "excite": "excite robot.urdf -o m.csv --duration 5 --budget 50",
    "simulate": "simulate robot.urdf -o s.csv --duration 5",
    "payload": "payload model.json loaded.csv",
    "gains": "gains robot.urdf --unloaded unloaded_currents.csv --loaded loaded_currents.csv --payload 2.0",
    "consistent": "consistent model.json -o p.json",
    "export": "export model.json -o x.urdf",
    "fleet": "fleet robot.urdf 'fleet/**/*.parquet' --scheduler none",
    "effects NAME": "effects joint_spring",
    "paper": "paper --own-motion --runs 2",
    "doctor": "doctor",
}
LISTS = ("info", "fetch", "effects")
ELSEWHERE = {"demo", "studio", "completion"}  # tests/cli; the last has no JSON
ROW = re.compile(r"^\| `([^`]+)` \| (`[^|]+`) \|", re.MULTILINE)


def printed(line):
    result = CliRunner().invoke(main, [*shlex.split(line), "--json"])
    assert result.exit_code in (0, 1), result.output
    return json.loads(result.stdout)


def test_the_page_lists_every_command():
    named = {name.split()[0] for name, _ in ROW.findall(text_of(DOCS / "reference" / "json.md"))}
    assert named | {"fetch", "demo", "completion"} == set(main.commands)
    assert {line.split()[0] for line in LINES} | {"fetch"} | ELSEWHERE == set(main.commands)


def test_every_key_is_on_the_page(filled, tmp_path, monkeypatch):
    monkeypatch.chdir(filled)
    keys = {name: re.findall(r"`(\w+)`", words) for name, words in ROW.findall(text_of(DOCS / "reference" / "json.md"))}
    for name, line in LINES.items():
        words = re.sub(r"-o (\S+)", rf"-o {tmp_path}/\1", line)
        assert list(printed(words)) == keys[name], name


@pytest.mark.parametrize("line", LISTS)
def test_without_a_name_a_list_is_printed(line):
    assert isinstance(printed(line), list)
