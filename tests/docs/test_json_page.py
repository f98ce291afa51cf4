"""The page on JSON lists every key that a command prints, and no other."""

import json
import re
import shlex
from typing import get_args, get_type_hints

import pytest
from click.testing import CliRunner
from fences import DOCS, text_of
from jsonschema import Draft202012Validator, ValidationError
from output_schemas import fits, printed_by

from frischid.cli import main
from frischid.cli.outputs.models import HistoryStepOutput
from frischid.cli.outputs.schemas import FURTHER, OUTPUTS, TYPES, schema_of

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
LISTS = ("info", "fetch", "effects", "schema")
ELSEWHERE = {"demo", "studio", "completion"}  # tests/cli; the last has no JSON
ROW = re.compile(r"^\| `([^`]+)` \| (`[^|]+`) \|", re.MULTILINE)


def printed(line):
    result = CliRunner().invoke(main, [*shlex.split(line), "--json"])
    assert result.exit_code in (0, 1), result.output
    data = json.loads(result.stdout)
    printed_by(shlex.split(line), data)
    return data


def test_the_page_lists_every_command():
    named = {name.split()[0] for name, _ in ROW.findall(text_of(DOCS / "reference" / "json.md"))}
    commands = set(main.commands)
    named |= {"fetch", "demo", "completion", "schema"}
    assert named == commands, "a command needs a row in docs/reference/json.md"
    run = {line.split()[0] for line in LINES} | {"fetch", "schema"} | ELSEWHERE
    assert run == commands, "a command needs a line in LINES, which prints its keys"


def test_every_key_is_on_the_page(filled, tmp_path, monkeypatch):
    monkeypatch.chdir(filled)
    keys = {name: re.findall(r"`(\w+)`", words) for name, words in ROW.findall(text_of(DOCS / "reference" / "json.md"))}
    for name, line in LINES.items():
        words = re.sub(r"-o (\S+)", rf"-o {tmp_path}/\1", line)
        assert list(printed(words)) == keys[name], name


@pytest.mark.parametrize("line", LISTS)
def test_without_a_name_a_list_is_printed(line):
    assert isinstance(printed(line), list)


@pytest.mark.parametrize("name", TYPES)
def test_a_schema_is_a_schema(name):
    schema = json.loads(CliRunner().invoke(main, ["schema", name]).stdout)
    assert schema == json.loads(json.dumps(schema_of(name)))
    Draft202012Validator.check_schema(schema)


def test_every_command_has_a_schema_and_the_page_names_the_others():
    commands = set(main.commands) - {"completion", "schema"}
    assert set(OUTPUTS) == commands, "a command needs the type of its JSON in OUTPUTS (frischid/cli/outputs/schemas.py)"
    text = text_of(DOCS / "reference" / "json.md")
    assert all(f"- `{name}`: " in text for name in FURTHER)


def test_a_key_that_the_schema_lacks_is_an_error():
    fits("cut", {"output": "a.csv", "samples": 3, "seconds": 1.0})
    for wrong in ({"output": "a.csv", "samples": 3}, {"output": "a.csv", "samples": 3, "seconds": 1.0, "more": 1}):
        with pytest.raises(ValidationError):
            fits("cut", wrong)


def test_files_and_outputs_of_options_have_the_form_of_their_schemas(filled, tmp_path, monkeypatch):
    monkeypatch.chdir(filled)
    printed("compare model.json test.csv --simulate")
    printed("diagnose model.json log.csv --try joint_spring --simulate")
    printed("identify robot.urdf unloaded_currents.csv")
    printed("identify robot.urdf log.csv --scheduler none")
    printed(f"demo --practice {tmp_path}/practice")
    printed(f"check robot.urdf turned.csv -o {tmp_path}/fixed.toml")
    printed(f"payload model.json loaded.csv -o {tmp_path}/tool.json")
    fits("payload", json.loads((tmp_path / "tool.json").read_text()))
    printed(f"export model.json -o {tmp_path}/actuators.json")
    fits("actuator_file", json.loads((tmp_path / "actuators.json").read_text()))
    fits("model_file", json.loads((filled / "model.json").read_text()))


def test_every_step_of_a_model_has_the_form_of_its_schema(filled, tmp_path, monkeypatch):
    monkeypatch.chdir(filled)
    printed(f"add model.json joint_spring@joint2 log.csv --valid test.csv -o {tmp_path}/added.json")
    printed(f"consistent {tmp_path}/added.json -o {tmp_path}/consistent.json")
    printed(f"fleet robot.urdf 'fleet/**/*.parquet' --scheduler none -o {tmp_path}/fleet.json")
    moved = "identify robot.urdf log.csv --estimator output_error --horizon 0.2"
    printed(f"{moved} -o {tmp_path}/moved.json")
    actions = set()
    for name in ("consistent", "fleet", "moved"):
        actions |= {step["action"] for step in printed(f"history {tmp_path}/{name}.json")["steps"]}
        fits("model_file", json.loads((tmp_path / f"{name}.json").read_text()))
    assert actions == set(get_args(get_type_hints(HistoryStepOutput)["action"]))
