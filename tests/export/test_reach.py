"""A model says what it can be exported to, and the commands that change a model repeat it."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
from cases import robot
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.cli.pages import improving
from frischid.effects import EFFECTS, parse_effects
from frischid.export.reach import exportable, in_words, reach_of

XML_ALONE = ("viscous", "coulomb", "rotor_inertia", "joint_coupling", "payload")


@pytest.fixture(scope="module")
def fitted():
    machine = robot("planar2")
    logs = [fr.simulate(machine, fr.random_fourier(machine, 5.0, seed=s), rate=100.0) for s in (1, 2)]
    return fr.identify(machine, [logs[0]], recursion="none").model, logs[1]


def test_every_effect_of_the_catalogue_can_be_code(fitted):
    machine = fitted[0].robot
    for name in EFFECTS:
        model = replace(fitted[0], effects=parse_effects(name), robot=machine)
        code, mjcf, urdf = reach_of(model)
        assert code.whole, name
        of_controller = fr.EFFECTS[name].of_controller
        assert mjcf.whole, name
        inside = (*XML_ALONE, "time_delay", "elasticity", "backlash")
        assert (mjcf.beside == ()) == (of_controller or name in inside), name
        assert urdf.whole == (of_controller or name in ("viscous", "coulomb"))


def test_a_change_of_the_robot_is_exported_to_no_format(fitted, tmp_path):
    """The terminal had said "C and NumPy: whole" of such a model, whose export is refused."""
    model, log = fitted
    step = fr.add(model, parse_effects("offset_change@joint2"), [log], situation="changed")
    assert [(x.format, x.whole, x.refused) for x in reach_of(step.model)] == [
        (name, False, ("offset_change@joint2",)) for name in ("code", "MJCF", "URDF")
    ]
    assert in_words(reach_of(step.model)).startswith("exports to no format, because offset_change describes a change")
    with pytest.raises(fr.InputError, match="describes a change of the robot"):
        fr.export(step.model, tmp_path / "robot.c")


def test_add_says_what_the_model_can_be_exported_to(fitted):
    model, log = fitted
    step = fr.add(model, parse_effects("hysteresis"), [log])
    page = improving.added(step, "model.json")
    assert page.data["exports"]["code"] == {"whole": True, "without": [], "refused": [], "steps": True, "beside": []}
    assert any("C and NumPy: whole, as a step function" in str(part) for part in page.parts)
    assert "MJCF: whole, with offset, hysteresis in a Python file beside the XML" in in_words(reach_of(step.model))
    assert page.data["exports"]["MJCF"]["beside"] == ["offset", "hysteresis(distance=0.006, width=0.005)"]
    json.dumps(page.data)


def test_a_class_without_code_is_named(fitted):
    try:

        @dataclass(frozen=True)
        class Detent(fr.Effect):
            """A detent."""

            id = "detent"

            def terms(self, state):
                return self.per_joint(state, "cd", "", lambda i: np.sin(8 * state.q[:, i]))

        model = replace(fitted[0], effects=(*parse_effects("viscous"), Detent()))
        code = reach_of(model)[0]
        assert code.refused == ("detent",)
        assert "not with detent, whose class states no code" in in_words(reach_of(model))
    finally:
        fr.EFFECTS.remove("detent")


def test_improve_searches_only_among_effects_that_an_export_holds(fitted, tmp_path, monkeypatch):
    model = fitted[0]
    assert set(exportable(model, "c")) == {name for name in EFFECTS if any(EFFECTS[name].candidates(model.robot))}
    assert set(exportable(model, "mjcf")) == set(exportable(model, "c"))
    assert "joint_spring" not in exportable(model, "urdf")
    hidden = parse_effects("viscous, coulomb, offset, rotor_inertia, joint_spring@joint2")
    motion = fr.random_fourier(model.robot, 20.0, seed=3)
    values = {"ks2": 4.0}
    log = fr.simulate(model.robot, motion, rate=50.0, effects=hidden, parameters=values, noise=fr.Noise(tau=0.01))
    monkeypatch.chdir(tmp_path)
    fr.write_log(log, "log.csv")
    fr.identify(model.robot, [log], recursion="none").model.save("model.json")
    added = {}
    for kind in ("c", "urdf"):
        line = ["improve", "model.json", "log.csv", "--max-steps", "1", "--exportable", kind, "--json"]
        done = CliRunner().invoke(main, line)
        assert done.exit_code in (0, 1), done.output
        added[kind] = [step["effect"] for step in json.loads(done.stdout)["steps"]]
    assert added["c"] == ["joint_spring"]
    assert not set(added["urdf"]) - set(exportable(model, "urdf"))
