"""Hostile names in the text files beside generated code: YAML, URScript, TOML, CSV, JSON, and commands to copy."""

import csv
import io
import json
import random
import shlex
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from hostile_names import HOSTILE, names, renamed
from test_code import physical

from frischid.core.text import one_line, quoted
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.rivals import command_for, pair_of
from frischid.effects import EFFECTS
from frischid.export.actuators import actuators_csv, actuators_json
from frischid.export.names import cell
from frischid.logs.log import Log
from frischid.logs.mapping import JointMap, LogMap
from frischid.logs.mapping_fix import toml_of
from frischid.logs.proposal import Proposal
from frischid.motions.programme_files import _trajectory, _urscript

MANY = [*names(random.Random(3), 1500), "del\x7f", "\U0001f916", "=HYPERLINK(1)", "-2+3|x", "@x", "\tq", "nel\x85"]


SURE = {"significant": True, "probability": 0.5, "undecided": (), "criteria": DiagnosisCriteria()}


def moved(joints):
    """A log of these joints at rest."""
    zero = np.zeros((10, len(joints)))
    return Log(np.arange(10) / 10, tuple(joints), q=zero, v=zero, a=zero)


@pytest.mark.parametrize("k", range(0, len(MANY), 100))
def test_names_stay_names_in_a_joint_trajectory(k):
    joints = list(dict.fromkeys(MANY[k : k + 100]))
    read = yaml.safe_load("\n".join(_trajectory(moved(joints))) + "\n")
    assert read["joint_names"] == joints
    assert len(read["points"]) == 10


def test_names_are_no_lines_of_a_robots_programme():
    plain = list(_urscript(moved([f"j{k}" for k in range(6)]), 100.0))
    for k in range(0, len(MANY) - 6, 6):
        lines = "\n".join(_urscript(moved(MANY[k : k + 6]), 100.0)).splitlines()
        assert [*lines[:1], *lines[2:]] == [*plain[:1], *plain[2:]]
        assert lines[1].startswith("  # joints in order: ")


@pytest.mark.parametrize("name", [*HOSTILE[:4], "a\n[file]\nheader = false", *MANY[-7:], *MANY[:60]])
def test_names_are_no_entries_of_a_proposed_mapping(name):
    name = name or "empty"
    found = Proposal({"time": name}, {name: {"q": name}}, [f"because of {name}"], [name], gains={name: 2.0})
    expected = {"file": {"time": name}, "joint": {name: {"q": name}}, "current_gain": {name: 2.0}}
    assert tomllib.loads(found.toml(f"{name}.csv")) == expected
    forms = {name: LogMap(time=name, joint={name: JointMap(q=name)}), "other": LogMap()}
    assert tomllib.loads(toml_of(forms))["layout"][name] == {"file": {"time": name}, "joint": {name: {"q": name}}}


def test_a_quoted_text_is_read_again_as_it_was():
    for text in MANY:
        assert tomllib.loads(f"x = {quoted(text)}") == {"x": text}
        assert yaml.safe_load(f"x: {quoted(text)}") == {"x": text}
        assert len(one_line(text).splitlines()) == 1
    assert quoted(["a", 1.5, True]) == '["a", 1.5, true]'


@pytest.mark.parametrize("name", [*MANY[-7:], *MANY[:20]])
def test_the_table_of_drives_runs_no_formula_and_json_keeps_the_name(name):
    plain = physical("planar2")
    model = renamed(plain, "r", dict(zip(plain.robot.joints, [name, "other"], strict=True)))
    rows = list(csv.DictReader(io.StringIO(actuators_csv(model), newline="")))
    assert [row["joint"] for row in rows] == [cell(name), "other"]
    assert not rows[0]["joint"].startswith(("=", "+", "-", "@"))
    assert rows[0]["joint"].isprintable()  # a new line would begin a new row
    assert [row["joint"] for row in json.loads(actuators_json(model))["joints"]] == [name, "other"]


@pytest.mark.parametrize("joint", ["$(touch owned)", "a; rm -rf b", "`x`", "a'b", "a\nb", "joint2"])
def test_a_name_is_one_word_of_a_proposed_command(joint):
    found = [
        SimpleNamespace(effect=name, joints=(joint,), members=(EFFECTS[name]((joint,)),), entered=False, **SURE)
        for name in ("joint_spring", "viscous")
    ]
    command = command_for(pair_of(found, {"joint_spring": 0.5, "viscous": 0.45}))
    assert shlex.split(command)[3:5] == ["--separate", f"joint_spring@{joint},viscous@{joint}"]
