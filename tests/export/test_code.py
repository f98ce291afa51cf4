"""Generated code computes the model's torque: every effect, both signs of every parameter, whatever its names are."""

import ast
import ctypes
import importlib.util
import itertools
import json
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import fields, replace
from functools import cache

import mujoco
import numpy as np
import pytest
from cases import exact_log, quick, random_values, robot, states
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from frischid.effects import BASELINE, EFFECTS, parse_effects
from frischid.errors import InputError
from frischid.export.consistency import make_consistent
from frischid.export.names import comment, identifier, identifiers, number
from frischid.export.proofread import balanced, proofread
from frischid.export.urdf import export
from frischid.model.model import Model
from frischid.motions.simulation import Noise
from frischid.robot.robot import Robot

NAMES = ("planar2", "planar2 far_end known", "ur10 far_end tilted", "panda with fingers", "kinova continuous",
         "tiago torso and arm", "mixed mimic")  # fmt: skip


@cache
def physical(name, effects=BASELINE):
    machine = robot(name)
    log = exact_log(machine, effects, random_values(machine, effects), noise=Noise(tau=0.01))
    return make_consistent(quick(machine, [log], effects=effects).model).model


def library(path, optimise="-O2"):
    out = path.with_suffix(".so")
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-pedantic"]
    subprocess.run(["gcc", optimise, *strict, "-shared", "-fPIC", str(path), "-o", str(out), "-lm"], check=True)
    return ctypes.CDLL(str(out))


def call(function, *columns):
    pointers = [np.ascontiguousarray(c, dtype=float) for c in columns]
    out = np.empty_like(pointers[0])
    for k in range(len(out)):
        row = [x[k].ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in (*pointers, out)]
        function(*row)
    return out


def module(path):
    spec = importlib.util.spec_from_file_location("control", path)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def check_code(model, folder, optimise="-O2"):
    """Both languages, both functions, against the model on random states, to 1e-9 of the largest torque."""
    prefix = identifier(model.robot.name).lower()
    q, v, a = states(model.robot, 20)
    v[0], a[1] = 0.0, 0.0
    expected, friction = model.inverse_dynamics(q, v, a), model.friction(q, v)
    for suffix in (".c", ".py"):
        export(model, folder / f"control{suffix}", force=True)
    built, python = library(folder / "control.c", optimise), module(folder / "control.py")
    for found, wanted in (
        (call(built[f"{prefix}_inverse_dynamics"], q, v, a), expected),
        (call(built[f"{prefix}_friction"], q, v), friction),
        (python.inverse_dynamics(q, v, a), expected),
        (python.friction(q, v), friction),
    ):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9 * max(np.abs(wanted).max(), 1e-9))


@pytest.mark.parametrize("name", NAMES)
def test_generated_code_is_the_model(name, tmp_path):
    check_code(physical(name), tmp_path)


# ---- every effect that follows from its joint's state, both signs of every parameter that the effect accepts


def signed(effect):
    """The effect with every numeric parameter of its own at another value, of each sign that it accepts."""
    shape = {
        f.name: 1.7 * x if x else 0.03
        for f in fields(effect)
        if isinstance(x := getattr(effect, f.name), float | int) and not isinstance(x, bool)
    }
    for signs in itertools.product((1.0, -1.0), repeat=len(shape)):
        changed = {k: s * x for s, (k, x) in zip(signs, shape.items(), strict=True)}
        try:
            yield replace(effect, **changed)
        except InputError:
            assert -1.0 in signs, f"{effect.id} refuses positive values of {list(shape)}"


def coded():
    """Every effect whose class states code without memory, in every form, shape parameters of both signs."""
    texts = [name for name, kind in EFFECTS.items() if kind.code and not kind.memory and name != "thermal_drift"]
    texts += ["joint_spring(form=cubic)", "joint_spring(form=periodic)@turn"]
    return {str(e): e for text in texts for (effect,) in [parse_effects(text)] for e in [effect, *signed(effect)]}


CODED = coded()


def test_every_coded_effect_is_tried_away_from_its_defaults():
    ids = {effect.id for effect in CODED.values()}
    assert ids | {"hysteresis", "cable_hose", "thermal_drift"} == {name for name, kind in EFFECTS.items() if kind.code}
    assert any(effect.id == "coulomb" and effect.lead > 0 for effect in CODED.values())


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("effect", CODED.values(), ids=CODED)
def test_code_of_every_effect_is_its_column(effect, sign, tmp_path):
    machine = robot("mixed mimic")
    values = {name: sign * x for name, x in random_values(machine, [effect]).items()}
    standard = dict(zip(machine.all_names, map(float, machine.nominal), strict=True)) | values
    nothing = {"prior": None, "fitted": None}  # of the effect that is put in
    data = {**physical("mixed mimic", ()).to_dict(), **nothing, "effects": [effect.to_dict()], "standard": standard}
    model = Model.from_dict(data)
    q, v, a = states(machine, 20)
    without = Model.from_dict({**data, "effects": []}).inverse_dynamics(q, v, a)
    assert np.abs(model.inverse_dynamics(q, v, a) - without).max() > 1e-3  # the effect acts, or nothing is tested
    check_code(model, tmp_path, "-O0")


def test_generated_python_needs_only_numpy(tmp_path):
    export(physical("planar2"), tmp_path / "control.py")
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import control; control.inverse_dynamics([0] * 2, [1] * 2, [1] * 2)\n"
        "print(sorted({m.split('.')[0] for m in sys.modules} & {'frischid', 'pinocchio', 'scipy', 'cvxpy'}))"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_two_robots_link_into_one_program(tmp_path):
    for name in ("planar2", "ur10 far_end tilted"):
        export(physical(name), tmp_path / f"{name.split()[0]}.c")
    sources = [str(path) for path in sorted(tmp_path.glob("*.c"))]
    main = tmp_path / "main.c"
    main.write_text("".join(f'#include "{path}"\n' for path in sources) + "int main(void) { return 0; }\n")
    command = ["gcc", "-std=c99", "-Wall", "-Werror", str(main), "-lm", "-o", str(tmp_path / "main")]
    subprocess.run(command, check=True)


def test_a_number_that_is_none_is_refused(tmp_path):
    model = physical("planar2")
    broken = replace(model, standard={**model.standard, "fv1": float("inf")})
    for suffix in (".c", ".py", ".xml"):
        with pytest.raises(InputError, match="number inf"):
            export(broken, tmp_path / f"control{suffix}")
    assert not list(tmp_path.iterdir())


# ---- hostile names

HOSTILE = (
    'a\n"""\nevil = 1\n"""', "*/ int evil; /*", "*/*/", "/*/**", "\\", "\\\n*/", "??/", "???/\n*/",
    "'''", '"', "<&>]]>-->", "\r#define double int\r", "@J@{q}%s", "é\u202egnp\u2028x", "", " ", "1", "int",
    "\N{SNOWMAN}", "\\N{nothing}\\x", '""""', "/", "*", "?",
)  # fmt: skip
XML_TEXT = st.text(st.characters(exclude_categories=("Cc", "Cs"), include_characters="\t\n\r"), max_size=12)
TEXTS = (
    st.lists(st.sampled_from(HOSTILE) | XML_TEXT, max_size=4)
    .map("".join)
    .filter(lambda x: "\ufffe" not in x and "\uffff" not in x)
)
JOINTS = st.lists(TEXTS.filter(lambda x: x not in ("", "universe")), min_size=2, max_size=2, unique=True)


def renamed(model, title, joints):
    """The model with its robot and its joints called otherwise, wherever their names stand."""
    names = dict(zip(model.robot.joints, joints, strict=True))

    def change(x):
        if isinstance(x, dict):
            return {names.get(k, k): change(y) for k, y in x.items()}
        if isinstance(x, list):
            return [change(y) for y in x]
        return names.get(x, x) if isinstance(x, str) else x

    data = json.loads(json.dumps({**model.to_dict(), "previous": None}))
    tree = ET.fromstring(data["robot"]["urdf"])
    tree.set("name", title)
    for joint in tree.iter("joint"):
        joint.set("name", names.get(joint.get("name"), joint.get("name")))
    data = change(data)
    data["robot"] |= {"urdf": ET.tostring(tree, encoding="unicode"), "name": title}
    return Model.from_dict(data)


def skeleton(text):
    """Python's meaning without the names: the tree with its docstring and the tuple of joints taken out."""
    tree = ast.parse(text)
    assert isinstance(tree.body[0].value, ast.Constant)
    assert tree.body[2].targets[0].id == "JOINTS"
    return ast.dump(ast.Module([tree.body[1], *tree.body[3:]], []))


def bare(text, title):
    """C without its comments and names of its own."""
    text, prefix = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL), identifier(title)
    text = re.sub(r"enum \{.*?\};", "", text, flags=re.DOTALL)
    text = re.sub(rf"\b{prefix.lower()}_", "robot_", text)
    return re.sub(r"\s+", " ", re.sub(rf"\b{prefix.upper()}_", "ROBOT_", text))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(title=TEXTS, joints=JOINTS)
@example(title=HOSTILE[0], joints=[HOSTILE[0], HOSTILE[1]])
@example(title=HOSTILE[4], joints=["*", "\\"])
@example(title="a" + HOSTILE[7], joints=["A b", "a.b"])
def test_names_change_no_code(title, joints, tmp_path):
    plain = physical("planar2")
    model = renamed(plain, title, joints)
    for suffix in (".c", ".py", ".xml", ".urdf"):
        for built, name in ((plain, "plain"), (model, "renamed")):
            export(built, tmp_path / f"{name}{suffix}")
    sources = {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()}
    assert skeleton(sources["renamed.py"]) == skeleton(sources["plain.py"])
    assert tuple(joints) == module(tmp_path / "renamed.py").JOINTS
    balanced(sources["renamed.c"])
    assert bare(sources["renamed.c"], title) == bare(sources["plain.c"], plain.robot.name)
    found = [x.get("name") for x in ET.fromstring(sources["renamed.xml"]).iter("joint")]
    assert found == joints
    again = Robot.load(tmp_path / "renamed.urdf")
    assert list(again.joints) == joints


@pytest.mark.parametrize("k", range(0, len(HOSTILE), 4))
def test_code_with_hostile_names_compiles_and_computes(k, tmp_path):
    names = [x or "e" for x in HOSTILE[k : k + 3]]
    check_code(renamed(physical("planar2"), names[0] + names[1], names[1:]), tmp_path)


def test_mujoco_reads_hostile_names(tmp_path):
    names = ["*/\n\"'<&>", "\\]]>"]
    export(renamed(physical("planar2"), "--> \"'", names), tmp_path / "robot.xml")
    compiled = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    assert [compiled.joint(i).name for i in range(compiled.njnt)] == names


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
