"""Generated code computes the model's torque: every effect, both signs of every parameter, whatever its names are."""

import ctypes
import itertools
import runpy
import subprocess
import sys
from dataclasses import fields, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from cases import exact_log, quick, random_values, robot, states

from frischid.effects import BASELINE, EFFECTS, parse_effects
from frischid.errors import InputError
from frischid.export.consistency import make_consistent
from frischid.export.export import export
from frischid.export.names import identifier
from frischid.model.model import Model
from frischid.motions.simulation import Noise

NAMES = ("planar2", "planar2 far_end known", "ur10 far_end tilted", "panda with fingers", "kinova continuous",
         "one joint", "tiago torso and arm", "mixed mimic")  # fmt: skip


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
    """Run from the text: a module's bytecode is stale where the file changes within a second and keeps its size."""
    return SimpleNamespace(**runpy.run_path(str(path)))


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


def test_the_load_in_generated_code_has_the_known_links(tmp_path):
    check_code(physical("planar2 far_end known", parse_effects("viscous, coulomb, load_friction")), tmp_path)


# ---- every effect that follows from its joint's state, both signs of every parameter that the effect accepts


def signed(effect):
    """The effect with every numeric parameter of its own at another value, of each sign that it accepts."""
    shape = {
        f.name: 1.7 * x if x else 0.03
        for f in fields(effect)
        if f.name in effect.parameters
        and isinstance(x := getattr(effect, f.name), float | int)
        and not isinstance(x, bool)
    }
    for signs in itertools.product((1.0, -1.0), repeat=len(shape)):
        changed = {k: s * x for s, (k, x) in zip(signs, shape.items(), strict=True)}
        try:
            yield replace(effect, **changed)
        except InputError:
            assert -1.0 in signs, f"{effect.id} refuses positive values of {list(shape)}"


OF_TIME = ("thermal_drift", "torque_drift")
"""Effects that act over time: `tests/export/test_step.py` tries them."""


def coded():
    """Every effect whose class states code without memory, in every form, shape parameters of both signs."""
    texts = [name for name, kind in EFFECTS.items() if kind.code and not kind.memory and name not in OF_TIME]
    texts += ["joint_spring(form=cubic)", "joint_spring(form=periodic)@turn", "joint_spring(form=curve)@elbow"]
    return {str(e): e for text in texts for (effect,) in [parse_effects(text)] for e in [effect, *signed(effect)]}


CODED = coded()


def test_every_coded_effect_is_tried_away_from_its_defaults():
    ids = {effect.id for effect in CODED.values()}
    assert ids | {"hysteresis", "cable_hose", "self_heating", *OF_TIME} == {
        name for name, kind in EFFECTS.items() if kind.code
    }
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
