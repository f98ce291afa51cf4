"""No byte of a URDF's name becomes code: the same model under two names differs only where names stand."""

import random
import re
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest
from hostile_names import HOSTILE, c_skeleton, names, python_skeleton, renamed, xml_skeleton
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from test_code import check_code, module, physical

from frischid.errors import InputError
from frischid.export.export import export
from frischid.export.names import comment, identifiers, number
from frischid.export.proofread import balanced, proofread
from frischid.robot.robot import Robot

XML_TEXT = st.text(st.characters(exclude_categories=("Cc", "Cs"), include_characters="\t\n\r"), max_size=12)
TEXTS = (
    st.lists(st.sampled_from(HOSTILE) | XML_TEXT, max_size=4)
    .map("".join)
    .filter(lambda x: "\ufffe" not in x and "\uffff" not in x)
)
JOINTS = st.lists(TEXTS.filter(lambda x: x not in ("", "universe")), min_size=2, max_size=2, unique=True)


def of_joints(joints):
    return dict(zip(physical("planar2").robot.joints, joints, strict=True))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(title=TEXTS, joints=JOINTS)
@example(title=HOSTILE[0], joints=[HOSTILE[0], HOSTILE[1]])
@example(title=HOSTILE[4], joints=["*", "\\"])
@example(title="a" + HOSTILE[7], joints=["A b", "a.b"])
def test_names_change_no_code(title, joints, tmp_path):
    plain = physical("planar2")
    model = renamed(plain, title, of_joints(joints))
    sources = {}
    for suffix in (".c", ".py", ".xml", ".urdf"):
        for built, name in ((plain, "plain"), (model, "renamed")):
            export(built, tmp_path / f"{name}{suffix}")
            sources[f"{name}{suffix}"] = (tmp_path / f"{name}{suffix}").read_text(encoding="utf-8")
    assert python_skeleton(sources["renamed.py"]) == python_skeleton(sources["plain.py"])
    assert tuple(joints) == module(tmp_path / "renamed.py").JOINTS
    balanced(sources["renamed.c"])
    assert c_skeleton(sources["renamed.c"], title) == c_skeleton(sources["plain.c"], plain.robot.name)
    for suffix in ("xml", "urdf"):
        assert xml_skeleton(sources[f"renamed.{suffix}"]) == xml_skeleton(sources[f"plain.{suffix}"])
    found = [x.get("name") for x in ET.fromstring(sources["renamed.xml"]).iter("joint")]
    assert found == joints
    again = Robot.load(tmp_path / "renamed.urdf")
    assert list(again.joints) == joints


@pytest.mark.parametrize("k", range(0, len(HOSTILE), 4))
def test_code_with_hostile_names_compiles_and_computes(k, tmp_path):
    given_names = [x or "e" for x in HOSTILE[k : k + 3]]
    check_code(renamed(physical("planar2"), "".join(given_names[:2]), of_joints(given_names[1:])), tmp_path)


def test_mujoco_reads_hostile_names(tmp_path):
    given_names = ["*/\n\"'<&>", "\\]]>"]
    export(renamed(physical("planar2"), "--> \"'", of_joints(given_names)), tmp_path / "robot.xml")
    compiled = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    assert [compiled.joint(i).name for i in range(compiled.njnt)] == given_names


def test_the_names_of_the_long_run_differ_and_are_hostile():
    found = names(random.Random(0), 500)
    assert len(set(found)) == 500
    assert all(any(piece in "".join(found) for piece in (x, x[:3])) for x in HOSTILE)


# ---- what writes names, and what reads the text again


@given(st.text())
@example("*/*/**//")
@example('"""""" \'\'\'\'')
@example("??????")
def test_a_comment_stays_one(text):
    written = comment(text)
    assert written.isprintable()
    assert not re.search(r"""\*/|/\*|""" + '"""' + r"""|'''|\?\?|\\""", written)


@given(st.lists(st.text() | st.sampled_from(["a b", "a.b", "a_b", "a_b_2", ""])))
def test_identifiers_are_unique_and_plain(names):
    found = identifiers(names)
    assert len(set(found)) == len(names)
    assert all(re.fullmatch(r"[A-Za-z]\w*", x, re.ASCII) for x in found)
    assert identifiers(["ur10", "elbow_joint"]) == ["ur10", "elbow_joint"]


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_is_read_again_as_itself(x):
    assert float(number(np.float64(x))) == x


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("C", "/* open"), ("C", "a */ b"), ("C", "/* a /* b */"), ("C", "int f(void) {"), ("C", "a[2));"),
        ("C", 'x = "y";'), ("C", "x\\\ny"), ("NumPy", "def f(:"), ("NumPy", '"""'), ("NumPy", "\0"),
        ("MJCF", "<a>"), ("URDF", "<a b=\"<\"/>"),
    ],
)  # fmt: skip
def test_malformed_text_is_not_written(kind, text):
    with pytest.raises(InputError, match=r"robot\.x: not written"):
        proofread(text, kind, "robot.x")
