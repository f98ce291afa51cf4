"""An effect that a user names without a shape is the effect that the diagnosis found under this name."""

import json

import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.diagnosis.shape_choice import searched

PLANAR2 = fr.Robot.load("planar2")


def case(hidden, rate=50.0, **values):
    """Two logs of planar2 with a hidden effect, and the model that lacks it."""
    effects, noise = (*fr.BASELINE, *fr.parse_effects(hidden)), fr.Noise(q=1e-5, tau=0.01)
    values |= {"fv1": 0.2, "fv2": 0.1, "fc1": 0.1, "fc2": 0.1}
    logs = [
        fr.simulate(
            PLANAR2,
            fr.random_fourier(PLANAR2, 20.0, seed=seed),
            rate=rate,
            effects=effects,
            parameters=values,
            noise=noise,
            seed=seed,
        )
        for seed in (1, 2)
    ]
    return fr.identify(PLANAR2, logs, recursion="none").model, logs


@pytest.mark.parametrize(
    ("form", "values"), [("linear", {"ks2": 1.5}), ("periodic", {"bs2": 0.8, "bcc2": 0.7}), ("cubic", {"bqqq2": 0.5})]
)
def test_a_spring_has_the_form_that_the_diagnosis_finds(form, values):
    """`diagnose` names no form, and its next command is ``add MODEL joint_spring@joint2``."""
    model, logs = case(f"joint_spring(form={form})@joint2", **values)
    first = fr.diagnose(model, logs, effects=["joint_spring"]).findings[0]
    text = "joint_spring@joint2"
    assert searched(model, fr.parse_effects(text), text, logs, "auto") == first.members
    assert first.members[0].form == form


@pytest.mark.parametrize("ratio", [1.0, -1.0])
def test_a_coupling_has_the_ratio_that_the_diagnosis_finds_and_prints(ratio):
    number = "1_2" if ratio > 0 else "1_m2"
    text, values = "joint_coupling@joint1+joint2", {f"fvm{number}": 0.5, f"fcm{number}": 0.4}
    model, logs = case(text.replace("@", f"(ratio={ratio})@"), **values)
    first = fr.diagnose(model, logs, effects=["joint_coupling"]).findings[0]
    assert first.members[0].ratio == ratio
    assert searched(model, fr.parse_effects(text), text, logs, "auto") == first.members
    assert fr.parse_effects(*first.to_dict()["members"]) == first.members
    assert [x for name, x, _ in first.found(PLANAR2) if name == "ratio"] == ([-1.0] if ratio < 0 else [])


def test_a_payload_without_a_joint_stays_on_the_last_link():
    model, logs = case("payload(full=True)", dm2=0.5, dIzz2=0.05)
    for text in ("payload", "payload@joint2"):
        (found,) = searched(model, fr.parse_effects(text), text, logs, "always")
        assert [name for _, name, _ in found.acts_on(PLANAR2)] == ["joint2"]


def test_a_delay_without_joints_is_one_delay():
    model, logs = case("time_delay(size=0.02)", delay=0.02)
    (found,) = searched(model, fr.parse_effects("time_delay"), "time_delay", logs, "auto")
    assert found.joints is None
    (at_joint,) = searched(model, fr.parse_effects("time_delay@joint2"), "time_delay@joint2", logs, "auto")
    assert at_joint.joints == ("joint2",)


def test_parentheses_of_one_effect_say_nothing_of_another():
    model, logs = case("cogging(order=23)@joint2", rate=100.0, A2=0.3)
    for text in ("cogging@joint2, stribeck(0.2)@joint1", "stribeck(0.2)@joint1, cogging@joint2"):
        found = {e.id: e for e in searched(model, fr.parse_effects(text), text, logs, "auto")}
        assert found["cogging"].order == pytest.approx(23.0, abs=0.5)
        assert found["stribeck"].speed == 0.2


@pytest.mark.parametrize(
    ("name", "why"),
    [("payload", "--situation changed"), ("counterbalance", "frischid add"), ("command_delay", "lack the channels")],
)
def test_an_effect_that_cannot_be_tried_is_named(name, why):
    """Else a verdict on nothing reads like one on the effect that the user named."""
    model, logs = case("joint_spring@joint2", ks2=1.5)
    (said,) = [note for note in fr.diagnose(model, logs, effects=[name]).notes if note.startswith("not tried: ")]
    assert name in said
    assert why in said


def test_an_effect_that_is_tried_has_no_such_note():
    model, logs = case("joint_spring@joint2", ks2=1.5)
    assert not any("not tried" in note for note in fr.diagnose(model, logs, effects=["joint_spring"]).notes)


def test_the_option_of_joints_is_for_every_effect_that_is_named(tmp_path):
    model, logs = case("quadratic_viscous@joint2", fvv2=0.1)
    model.save(tmp_path / "model.json")
    fr.write_log(logs[0], tmp_path / "log.csv")
    words = ["add", f"{tmp_path}/model.json", "quadratic_viscous, cubic_viscous", f"{tmp_path}/log.csv"]
    done = CliRunner().invoke(main, [*words, "--joints", "joint2", "-o", f"{tmp_path}/new.json", "--json"])
    assert done.exit_code in (0, 1), done.output
    assert json.loads(done.stdout)["effect"] == "quadratic_viscous@joint2, cubic_viscous@joint2"
    added = fr.Model.load(tmp_path / "new.json").effects[-2:]
    assert [e.joints for e in added] == [("joint2",), ("joint2",)]
