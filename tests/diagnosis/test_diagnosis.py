"""A hidden effect is found, named, added, and the error falls; nothing is found where nothing is hidden."""

import json
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from frischid.cli import main
from frischid.cli.pages.improving import diagnosis as page_of
from frischid.cli.pages.improving import verdict_of
from frischid.core.text import listed
from frischid.diagnosis.addition import add, undo
from frischid.diagnosis.clause import missing
from frischid.diagnosis.contacts import _stands_out
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.improvement import improve
from frischid.diagnosis.shape_choice import searched
from frischid.diagnosis.verdict import not_called_missing
from frischid.effects import BASELINE, parse_effects
from frischid.errors import InputError, UnknownNameError
from frischid.logs.log import Log
from frischid.logs.readers import write_log
from frischid.model.comparison import compare
from frischid.model.identification import identify, identify_again
from frischid.model.model import Model
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

UR5 = Robot.load("ur5")
NOISE = Noise(q=1e-5, tau=0.004)
DRY = {f"fv{i}": 3.0 for i in range(1, 7)} | {f"fc{i}": 2.0 for i in range(1, 7)} | {f"Ia{i}": 0.3 for i in range(1, 7)}


def log_of(seed: int, effects: str = "", seconds: float = 25.0, robot: Robot = UR5, **values: float) -> Log:
    """A noisy log of a robot that has the baseline effects and some more."""
    return simulate(
        robot,
        random_fourier(robot, seconds, seed=seed, scale=0.8),
        rate=100.0,
        effects=(*BASELINE, *parse_effects(effects)),
        parameters=(DRY if robot is UR5 else {}) | values,
        noise=NOISE,
        channels=(),
        seed=seed,
        name=f"log {seed} {effects}",
    )


@cache
def healthy() -> Model:
    return identify(UR5, [log_of(1)], recursion="none").model


HIDDEN = [
    ("stribeck(speed=0.1, exponent=2)@elbow_joint", {"fs3": 3.0}, "stribeck"),
    ("asymmetric_viscous@wrist_1_joint", {"fva4": 1.0}, "asymmetric_viscous"),
    ("load_friction@shoulder_lift_joint", {"fl2": 0.1}, "load_friction"),
    ("position_friction@elbow_joint", {"fp3": 1.0}, "position_friction"),
    ("self_heating(constant=12, exponent=1.5)@wrist_1_joint", {"fvh4": -0.8, "fch4": -0.6}, "self_heating"),
    ("joint_spring@wrist_2_joint", {"ks5": 1.0}, "joint_spring"),
    ("cogging(order=12)@elbow_joint", {"A3": 2.0}, "cogging"),
    ("torque_drift(constant=12)@wrist_2_joint", {"offt5": 1.0}, "torque_drift"),
    ('formula("load4/(abs(load4) + 0.5)")@wrist_1_joint', {"c[load4/(abs(load4)+0.5)]4": 0.6}, "gear_play"),
]


def test_an_encoder_zero_that_was_always_wrong_is_named():
    """The rigid parameters absorb only a part of the error: without this effect the answer was another one."""
    logs = [log_of(seed) for seed in (1, 2)]
    shifted = [replace(log, q=log.q + 0.05 * (np.array(UR5.joints) == "shoulder_lift_joint")) for log in logs]
    found = diagnose(identify(UR5, shifted, recursion="none").model, shifted)
    best = found.findings[0]
    assert (found.situation, best.effect, best.joints) == ("always", "encoder_zero", ("shoulder_lift_joint",))
    assert best.probability > 0.9
    assert best.parameters["zero2"] == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize(("effect", "values", "name"), HIDDEN, ids=[h[2] for h in HIDDEN])
def test_a_hidden_effect_is_named_and_removed(effect, values, name):
    logs, held_out = [log_of(1, effect, **values)], [log_of(2, effect, **values)]
    model = identify(UR5, logs, recursion="none").model
    found = diagnose(model, [*logs, *held_out])
    assert found.situation == "always"
    assert found.verdict == "effect"
    best = found.findings[0]
    assert name in (best.effect, *best.confused_with)
    assert effect.partition("@")[2] in best.joints
    assert best.p_value < 0.01
    step = add(model, best.members, logs, valid=held_out, finding=best)
    assert step.test_after < 0.7 * step.test_before
    assert step.test_after < 1.5 * compare(step.model, held_out).noise_floor


def test_an_effect_named_without_a_shape_gets_the_friction_smoothing_of_the_model():
    """As in a diagnosis: `frischid add model.json load_friction log.csv` is the effect that `diagnose` tried."""
    logs, wide = [log_of(1)], parse_effects("viscous, coulomb(width=0.05), offset, rotor_inertia")
    model = identify(UR5, logs, effects=wide, recursion="none").model
    for text in ("position_friction@elbow_joint", "stribeck@elbow_joint"):
        (found,) = searched(model, parse_effects(text), text, logs, "always")
        assert found.width == 0.05
    stated = "position_friction(width=0.01)@elbow_joint"
    assert searched(model, parse_effects(stated), stated, logs, "always") == parse_effects(stated)


@cache
def of_healthy():
    """Diagnosis of a robot that misses nothing."""
    return diagnose(healthy(), [log_of(1), log_of(2)])


def test_a_healthy_robot_raises_no_alarm():
    found = of_healthy()
    assert found.verdict == "none"
    assert not any(f.significant for f in found.findings)
    assert found.error < 2 * found.noise_floor
    assert (
        replace(found, error=found.noise_floor).remainder
        == "no effect is missing: the residual error is that of the sensor noise"
    )
    above = replace(found.headline, nrmse=3 * found.headline.noise_floor)
    explained = replace(found, error=found.noise_floor, headline=above).remainder
    assert explained.startswith("no effect is missing: noise explains the error"), "the headline shows more noise"
    far, there = 9 * found.noise_floor, found.headline
    noisy = replace(found, error=far, headline=replace(there, nrmse=0.017, noise_floor=0.0123), probabilities={})
    assert noisy.remainder.endswith("the model's NRMSE is 0.017, that of the sensor noise alone 0.012")
    silent = replace(found, error=0.01, headline=replace(there, nrmse=0.002, noise_floor=3e-5), probabilities={})
    assert silent.remainder.endswith("NRMSE is 0.002, that of the sensor noise alone 3e-05")  # not: 66 times the noise
    outside = replace(noisy, probabilities={**found.probabilities, "outside": 0.95, "none": 0.02}).remainder
    assert "0.012. The most probable cause is something outside the catalogue (95 %), but these logs" in outside


def test_no_missing_effect_beside_a_probable_one_is_explained_on_every_surface():
    """The ranking may give an effect half of the probability although no effect is called missing."""
    found = of_healthy()
    first = next(f for f in found.findings if f.members)
    weak = replace(first, probability=0.49, gain=3.0, p_value=0.2)
    others = [f for f in found.findings if f is not first]
    there = replace(found.headline, nrmse=0.017, noise_floor=0.01)
    result = replace(
        found, error=9 * found.noise_floor, findings=(weak, *others), headline=there,
        probabilities={weak.effect: 0.49, "none": 0.12, "several": 0.39},
    )  # fmt: skip
    where = listed(weak.joints) or "the robot"
    told = (
        "no effect is called missing; the model's NRMSE is 0.017, that of the sensor noise alone 0.01. The most "
        f"probable effect is {weak.effect} on {where} (49 %), but its evidence may be chance"
    )
    assert result.remainder == told
    assert verdict_of(result) == told
    assert missing(result).lower() == told.lower()
    quiet = replace(result, error=found.noise_floor, headline=replace(there, noise_floor=0.02)).remainder
    assert quiet.startswith("no effect is called missing: the residual error is that of the sensor noise. The most ")
    loud = replace(result, error=found.noise_floor).remainder
    assert loud.startswith("no effect is called missing: noise may explain the error"), "`none` has 12 % only"
    likely = replace(result, probabilities={weak.effect: 0.2, "none": 0.8})
    assert "most probable" not in likely.remainder


def test_what_python_shows_of_a_result_is_a_line():
    logs = [log_of(s, "joint_spring@wrist_2_joint", ks5=1.0) for s in (1, 2)]
    found = identify(UR5, logs[:1], valid=logs[1:], recursion="none")
    diagnosed = diagnose(found.model, logs[:1], valid=logs[1:], effects=["joint_spring"])
    step = add(found.model, diagnosed.findings[0].members, logs[:1], valid=logs[1:])
    for result in (found, found.model, found.model.estimate, found.comparison, diagnosed, step):
        assert repr(result).startswith(f"{type(result).__name__}(")
        assert len(repr(result)) < 160
    assert "effect: joint_spring on wrist_2_joint" in repr(diagnosed)
    assert f"{step.error_before:.4f} → {step.error_after:.4f}" in repr(step)


def test_what_is_no_list_of_logs_is_refused():
    log = log_of(1)
    for wrong, kind in ((log, "Log"), (["run.csv"], "str"), ("run.csv", "str")):
        with pytest.raises(InputError, match=f"logs must be a list of logs, got {kind}"):
            identify(UR5, wrong)
        with pytest.raises(InputError, match=f"valid must be a list of logs, got {kind}"):
            diagnose(healthy(), [log_of(2)], valid=wrong)


@pytest.mark.parametrize(
    ("effect", "parameter"), [("friction_change", "dfv3"), ("friction_change", "dfc3"), ("offset_change", "doff3")]
)
def test_friction_and_offsets_that_changed_are_changes(effect, parameter):
    """What the model has may change: no effect that looks like it is the cause, no square of the speed, no spring."""
    changed = log_of(3, f"{effect}@elbow_joint", **{parameter: 1.5})
    found = diagnose(healthy(), [changed])
    first = found.findings[0]
    assert (found.situation, first.effect, first.joints) == ("changed", effect, ("elbow_joint",))
    assert first.probability == max(found.probabilities.values()) > 0.75
    assert first.parameters[parameter] == pytest.approx(1.5, rel=0.05)


def test_a_payload_is_a_change():
    last = parse_effects("payload@wrist_3_joint")
    columns = [c.name for c in last[0].columns(UR5)]
    truth = dict(zip(columns, (1.5, 0.02, 0.01, 0.09), strict=True))
    loaded = [log_of(s, "payload@wrist_3_joint", **truth) for s in (3, 4)]
    found = diagnose(healthy(), loaded)
    assert found.situation == "changed"
    assert found.findings[0].effect == "payload"
    assert found.findings[0].parameters[columns[0]] == pytest.approx(1.5, rel=0.1)


def test_another_link_that_may_carry_the_body_is_named_once():
    columns = [c.name for c in parse_effects("payload@wrist_3_joint")[0].columns(UR5)]
    near_the_axis = dict(zip(columns, (1.5, 0.0, 0.0, 0.03), strict=True))
    first = diagnose(healthy(), [log_of(3, "payload@wrist_3_joint", **near_the_axis)]).findings[0]
    assert (first.effect, first.elsewhere) == ("payload", ("wrist_1_joint", "wrist_2_joint"))


@cache
def scaled_under_a_payload() -> tuple[Log, ...]:
    """Logs of an arm that carries a payload, and whose fourth torque channel has lost a tenth."""
    last = parse_effects("payload@wrist_3_joint")
    truth = dict(zip([c.name for c in last[0].columns(UR5)], (0.3, 0.01, 0.0, 0.02), strict=True))
    scale = np.where(np.array(UR5.joints) == "wrist_1_joint", 0.9, 1.0)
    loaded = (log_of(s, "payload@wrist_3_joint", **truth) for s in (3, 4))
    return tuple(Log(x.t, x.joints, x.q, tau=x.tau * scale, source=x.source) for x in loaded)


def test_two_changes_stand_before_a_refit_that_explains_both():
    found = diagnose(healthy(), scaled_under_a_payload())
    first, second, *others = (f for f in found.findings if f.significant)
    assert {first.effect, second.effect} == {"payload", "drive_gain"}
    assert first.entered
    assert second.entered
    (refit,) = (f for f in others if f.effect == "old_parameters")
    assert refit.probability > second.probability, "so the probability alone does not put it there"
    assert any(f"robably also missing, beside {first.title}: {second.title}; it explains" in x for x in found.notes)
    assumed = "; assumed: the robot changed since it was identified"
    assert missing(found).endswith(f"; probably also missing: {second.title}{assumed}")


def test_a_change_is_found_beside_one_that_was_added():
    (first, second), _ = improve(healthy(), list(scaled_under_a_payload()), max_steps=2)
    assert {first.finding.effect, second.finding.effect} == {"payload", "drive_gain"}
    assert second.error_after < 0.1 * first.error_before


def test_an_outside_force_is_a_contact():
    log = log_of(2)
    tau = np.array(log.tau)
    push = (log.t > 10) & (log.t < 11)
    tau[push, :3] += np.hanning(push.sum())[:, None] * [25.0, 30.0, 15.0]
    pushed = Log(log.t, log.joints, log.q, tau=tau, source="pushed")
    found = diagnose(healthy(), [log_of(1), pushed])
    assert found.verdict == "contact"
    assert found.findings[0].effect == "contact"
    assert [c.source for c in found.contacts] == ["pushed"]
    assert 9.5 < found.contacts[0].start < 10.5 < found.contacts[0].stop < 11.5


def test_improve_takes_steps_that_can_be_undone():
    hidden = "asymmetric_viscous@wrist_1_joint, joint_spring@wrist_2_joint"
    logs, held_out = ([log_of(s, hidden, fva4=1.0, ks5=1.0)] for s in (1, 2))
    model = identify(UR5, logs, recursion="none").model
    steps, last = improve(model, logs, valid=held_out, max_steps=3)
    assert {"asymmetric_viscous", "joint_spring"} <= {s.finding.effect for s in steps}
    errors = [steps[0].error_before, *(s.error_after for s in steps)]
    assert (np.diff(errors) < 0).all()
    assert last.noise_floor > 0
    final = Model.from_dict(json.loads(json.dumps(steps[-1].model.to_dict())))
    assert [e["action"] for e in final.history] == ["identify", *["add"] * len(steps)]
    for _ in steps:
        final = undo(final)
    assert final.effects == model.effects
    np.testing.assert_allclose(final.estimate.theta, model.estimate.theta)
    with pytest.raises(InputError, match="no step to undo"):
        undo(final)


def test_the_error_before_is_the_last_steps_where_it_was_measured_on_the_same_logs(monkeypatch):
    hidden = "asymmetric_viscous@wrist_1_joint, joint_spring@wrist_2_joint"
    logs = [log_of(1, hidden, fva4=1.0, ks5=1.0)]
    model = identify(UR5, logs, recursion="none").model
    fits = []
    monkeypatch.setattr("frischid.diagnosis.refit.identify_again", lambda *a: fits.append(a) or identify_again(*a))
    first = add(model, parse_effects("asymmetric_viscous@wrist_1_joint"), logs)
    second = add(first.model, parse_effects("joint_spring@wrist_2_joint"), logs)
    assert len(fits) == 2
    assert first.error_before == model.history[-1]["cross_validated"]["nrmse"]
    assert second.error_before == first.error_after > second.error_after
    other = add(model, parse_effects("asymmetric_viscous@wrist_1_joint"), [log_of(3, hidden, fva4=1.0, ks5=1.0)])
    assert len(fits) == 4
    assert other.error_before != first.error_before


def test_names_that_do_not_exist():
    with pytest.raises(UnknownNameError, match="stribeck"):
        diagnose(healthy(), [log_of(1)], effects=["stribek"])
    with pytest.raises(InputError, match="write stribeck instead of stribeck@elbow_joint"):
        diagnose(healthy(), [log_of(1)], effects=["stribeck@elbow_joint"])
    with pytest.raises(InputError, match="no log"):
        diagnose(healthy(), [])


def test_the_command_line(tmp_path):
    effect, values = "asymmetric_viscous@wrist_1_joint", {"fva4": 1.0}
    for seed in (1, 2):
        write_log(log_of(seed, effect, **values), tmp_path / f"{seed}.parquet")
    runner = CliRunner()
    paths = [str(tmp_path / f"{s}.parquet") for s in (1, 2)]
    model = str(tmp_path / "model.json")
    assert runner.invoke(main, ["identify", "ur5", paths[0], "--bbrf", "none", "-o", model]).exit_code == 0
    told = runner.invoke(main, ["diagnose", model, paths[0], "--valid", paths[1], "--json"])
    assert told.exit_code == 0
    data = json.loads(told.output)
    assert data["verdict"] == "effect"
    first = data["findings"][0]
    keys = {
        "effect",
        "joints",
        "error_before",
        "error_after",
        "gain",
        "probability",
        "significant",
        "withheld",
        "parameters",
        "confused_with",
        "sentence",
    }
    assert keys <= set(first)
    assert "p_value" not in first
    assert sum(data["probabilities"].values()) == pytest.approx(1.0)
    assert len({f["effect"] for f in data["findings"]}) == len(data["findings"])
    assert set(data["search"]["joints"]["elbow_joint"]) == {"error", "noise_floor"}
    shown = runner.invoke(main, ["diagnose", model, paths[0], "--valid", paths[1]])
    assert "An effect is missing" in shown.output
    new = str(tmp_path / "new.json")
    added = ["add", model, "asymmetric_viscous", paths[0], "--joints", "wrist_1*", "--valid", paths[1], "-o", new]
    result = runner.invoke(main, [*added, "--json"])
    assert result.exit_code == 0, result.output
    step = json.loads(result.output)
    assert step["step"]["error_after"] < step["step"]["error_before"]
    assert "asymmetric_viscous" in runner.invoke(main, ["history", new]).output
    old = str(tmp_path / "old.json")
    assert runner.invoke(main, ["history", new, "--undo", "-o", old]).exit_code == 0
    assert Model.load(old).effects == BASELINE
    compared = json.loads(runner.invoke(main, ["compare", new, paths[1], "--json"]).output)["comparison"]
    assert {"nrmse", "noise_floor", "joints", "conditions"} <= set(compared)
    assert {"joint", "condition", "ratio", "p_value"} <= set(compared["conditions"][0])
    assert "not fitted to" in " ".join(runner.invoke(main, ["history", new]).output.split())
    twice = runner.invoke(main, ["add", model, "stribeck@elbow_joint", paths[0], "--joints", "wrist_1*", "-o", new])
    assert twice.exit_code == 2
    assert "name them only once" in twice.output
    wrong = runner.invoke(main, ["add", model, "stribek", paths[0], "-o", new])
    assert wrong.exit_code == 2
    assert "stribeck" in wrong.output


def test_what_nothing_explains_is_described():
    hidden = 'formula("q3*sign(v2)")@shoulder_lift_joint'
    column = parse_effects(hidden)[0].columns(UR5)[0].name
    logs = [log_of(s, hidden, **{column: 3.0}) for s in (1, 2)]
    model = identify(UR5, logs[:1], recursion="none").model
    found = diagnose(model, logs)
    assert found.verdict == "unknown"
    assert found.findings[0].effect == "unknown"
    assert found.description.joint == "shoulder_lift_joint"
    assert found.description.formula[0] == "q3*sign(v2)"
    assert found.description.removed > 0.9
    assert any("a description, not a cause" in note for note in found.notes)
    assert json.loads(json.dumps(found.to_dict()))["description"]["formula"][0] == "q3*sign(v2)"


def test_on_other_logs_what_is_new_comes_before_what_was_always_missing():
    always, new = "stribeck(speed=0.1, exponent=2)@elbow_joint", "asymmetric_viscous@wrist_1_joint"
    values = {"fs3": 6.0, "fva4": 0.6}
    model = identify(UR5, [log_of(s, always, fs3=6.0) for s in (1, 2)], recursion="none").model
    assert diagnose(model, [log_of(s, always, fs3=6.0) for s in (1, 2)]).findings[0].effect == "stribeck"
    found = diagnose(model, [log_of(s, f"{always}, {new}", **values) for s in (3, 4)])
    assert [f.effect for f in found.findings[:2]] == ["asymmetric_viscous", "stribeck"]
    assert found.findings[0].own < found.findings[1].own
    assert any("effects are ranked by the error they explain beyond 1.25 times" in note for note in found.notes)


def wandering(log: Log, joint: str, size: float, seed: int) -> Log:
    """The log with a torque on one joint that nothing explains: smooth noise, another one in every log."""
    x = np.convolve(np.random.default_rng(seed).normal(size=len(log.t)), np.hanning(200), "same")
    tau = np.array(log.tau)
    tau[:, log.joints.index(joint)] += size * x / x.std()
    return Log(log.t, log.joints, log.q, tau=tau, source=log.source)


@pytest.mark.parametrize(("size", "verdict"), [(0.6, "effect"), (3.0, "unknown")])
def test_an_effect_is_named_beside_a_remainder_on_another_joint(size, verdict):
    made = [log_of(s, "asymmetric_viscous@wrist_1_joint", fva4=1.0) for s in (1, 2)]
    logs = [wandering(log, "wrist_2_joint", size, k) for k, log in enumerate(made)]
    found = diagnose(identify(UR5, logs[:1], recursion="none").model, logs)
    effect = next(f for f in found.findings if f.members)
    assert effect.effect == "asymmetric_viscous"
    assert effect.share > 0.5
    assert found.joints["wrist_2_joint"]["error"] ** 2 > effect.removed, "more is left there than the effect removes"
    assert found.verdict == verdict


def test_what_leaves_more_than_it_removes_where_it_acts_is_no_cause():
    made = [log_of(s, "asymmetric_viscous@elbow_joint", fva3=0.14) for s in (1, 2)]
    logs = [wandering(log, "elbow_joint", 0.07, k) for k, log in enumerate(made)]
    found = diagnose(identify(UR5, logs[:1], recursion="none").model, logs)
    effect = next(f for f in found.findings if f.members)
    assert effect.effect == "asymmetric_viscous"
    assert effect.significant
    assert effect.share < 0.5
    assert found.joints["elbow_joint"]["error"] < 0.01, "little is wrong in all"
    assert found.verdict == "unknown"


def test_what_another_joint_always_does_is_no_contact():
    planar2 = Robot.load("planar2")
    hidden = 'formula("exp(3*q1*q2)")@joint2'  # in short bursts, but whenever the arm comes by
    column = parse_effects(hidden)[0].columns(planar2)[0].name
    dry = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.02, "Ia2": 0.01}
    logs = [log_of(s, hidden, 20.0, robot=planar2, **dry, **{column: 0.01}) for s in (5, 6)]
    found = diagnose(identify(planar2, logs[:1], recursion="none").model, logs)
    assert found.verdict == "unknown"
    assert not found.contacts


def test_a_push_is_a_contact_whatever_else_is_missing():
    made = [log_of(s, "joint_spring@wrist_2_joint", ks5=3.0) for s in (1, 2)]
    logs = [wandering(log, "wrist_3_joint", 3.0, k) for k, log in enumerate(made)]
    tau = np.array(logs[1].tau)
    push = (logs[1].t > 10) & (logs[1].t < 11)
    tau[push, :4] += np.hanning(push.sum())[:, None] * [25.0, 30.0, 15.0, 6.0]
    pushed = Log(logs[1].t + 1000.0, logs[1].joints, logs[1].q, tau=tau, source="pushed")
    found = diagnose(identify(UR5, logs[:1], recursion="none").model, [logs[0], pushed])
    assert found.verdict == "contact"
    times = [(c.start - c.log_start, c.stop - c.log_start) for c in found.contacts if c.source == "pushed"]
    assert any(start < 10.5 < stop for start, stop in times)
    assert found.findings[1].effect == "joint_spring"


@pytest.mark.parametrize("form", ["cubic", "periodic"])
def test_a_spring_is_found_in_the_form_it_has(form):
    hidden = f"joint_spring(form={form})@wrist_2_joint"
    columns = [c.name for c in parse_effects(hidden)[0].columns(UR5)]
    values = dict(zip(columns, [0.1, -0.3, 0.5] if form == "cubic" else [0.2, 1.0, 0.6, -0.4], strict=True))
    logs = [log_of(s, hidden, **values) for s in (1, 2)]
    found = diagnose(identify(UR5, logs[:1], recursion="none").model, logs)
    assert found.verdict == "effect"
    assert [str(e) for e in found.findings[0].members] == [str(parse_effects(hidden)[0])]
    assert found.findings[0].error_after < 0.1 * found.error


def test_a_counterbalance_whose_ends_come_near_to_each_other_is_predicted_best_by_a_curve():
    hidden = "counterbalance(ratio=0.7, rest=0.3)@wrist_2_joint"
    *fitted, test = (log_of(s, hidden, cp5=1.0) for s in (1, 2, 3))
    model = identify(UR5, fitted, recursion="none").model
    first = diagnose(model, fitted).findings[0]
    assert (first.effect, first.joints) == ("joint_spring", ("wrist_2_joint",))
    curve, periodic = (
        add(model, parse_effects(f"joint_spring(form={form})@wrist_2_joint"), fitted, valid=[test])
        for form in ("curve", "periodic")
    )
    assert curve.test_after < 0.5 * periodic.test_after
    assert curve.test_after < 0.1 * curve.test_before


def test_what_another_joint_does_is_not_called_an_effect_that_resembles_it():
    planar2, hidden = Robot.load("planar2"), 'formula("tau_model2")@joint1'
    column = parse_effects(hidden)[0].columns(planar2)[0].name
    dry = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.02, "Ia2": 0.01}
    logs = [log_of(s, hidden, robot=planar2, **dry, **{column: 0.15}) for s in (1, 2)]
    model = identify(planar2, logs[:1], recursion="none").model
    found = diagnose(model, logs)
    resembling = found.findings[1]
    assert resembling.effect in {"drive_gain", "gear_play"}  # two functions of the joint's own load
    assert resembling.removed > 0.9 * found.joints["joint1"]["error"] ** 2  # so nothing of it seems to be missing
    assert found.verdict == "unknown"
    assert found.description.formula[0] == "tau_model2"
    assert any(f"on joint1 'tau_model2' explains far more than {resembling.effect} does" in n for n in found.notes)
    said = " ".join(map(str, page_of(found).parts))
    assert f"on joint1 only resembles the cause. Found: {next(iter(resembling.parameters))} = " in said
    assert type(resembling.members[0]).sentence.format(joint="joint1") not in said.lower()


def test_two_effects_are_compared_in_the_same_independent_samples(monkeypatch):
    planar2, dry = Robot.load("planar2"), {"fv1": 0.5, "fv2": 0.3, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.02, "Ia2": 0.01}
    before, *after = (log_of(s, robot=planar2, **dry) for s in (1, 2, 3))
    scaled = [Log(x.t, x.joints, x.q, tau=x.tau * [1.0, 0.97], source=x.source) for x in after]
    counted = CrossValidator.effective_with
    monkeypatch.setattr(
        CrossValidator, "effective_with", lambda v, c: counted(v, c) * (9.0 if c.effect.id == "gear_play" else 1.0)
    )
    found = diagnose(identify(planar2, [before], recursion="none").model, scaled)
    gain, rival = found.findings[:2]
    assert (gain.effect, rival.effect) == ("drive_gain", "gear_play")
    assert rival.gain > gain.gain, "each gain counts the samples that its own effect leaves independent"
    assert rival.removed < gain.removed


def test_sectors_of_a_damaged_gear_are_no_cogging():
    heights = {-1.0: 1.0, -0.45: -1.6, 0.1: 1.2, 0.3: -0.7, 0.8: 1.4, 1.1: -1.8}
    hidden = 'formula("' + " + ".join(f"{h:g}*sign(q2 - {at:g})" for at, h in heights.items()) + '")@joint2'
    planar2 = Robot.load("planar2")
    column = parse_effects(hidden)[0].columns(planar2)[0].name
    dry = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.02, "Ia2": 0.01}
    logs = [log_of(s, hidden, robot=planar2, **dry, **{column: 0.1}) for s in (1, 2)]
    model = identify(planar2, logs[:1], recursion="none").model
    found = diagnose(model, logs)
    assert found.verdict == "unknown"
    assert found.findings[1].significant, "something passes for it"
    assert any("jumps from sector to sector of q2" in note for note in found.notes)
    assert next(iter(found.description.depends_on)) == "q2"


def test_a_measured_temperature_explains_friction_that_drifts():
    joint, hidden = "elbow_joint", 'thermal_drift(by="temperature")@elbow_joint'
    logs = []
    for seed in (1, 2):
        log = log_of(seed)
        warm = 25.0 + 10.0 * np.sin(2 * np.pi * log.t / 18.0 + seed)
        j = log.joints.index(joint)
        tau = np.array(log.tau)
        v = np.gradient(log.q[:, j], log.t)
        tau[:, j] += (warm - 25.0) * (0.1 * v + 0.1 * np.tanh(v / 0.005))
        logs.append(Log(log.t, log.joints, log.q, tau=tau, extra={f"temperature_{joint}": warm}, source=f"warm {seed}"))
    model = identify(UR5, logs[:1], recursion="none").model
    steps, _ = improve(model, logs, max_steps=1)
    assert [str(e) for e in steps[0].model.effects[-1:]] == [str(parse_effects(hidden)[0])]
    assert "constant" not in steps[0].finding.parameters, "a time constant that nothing depends on"
    assert steps[0].error_after < 0.4 * steps[0].error_before


def test_parameters_that_no_longer_hold_are_a_finding():
    from frischid.diagnosis.findings import OLD_PARAMETERS

    other = {f"fv{i}": 3.0 + (-1) ** i for i in range(1, 7)} | {f"fc{i}": 2.0 - (-1) ** i for i in range(1, 7)}
    worn = [log_of(s, **other | {f"Ia{i}": 0.3 + 0.2 * (i % 3) for i in range(1, 7)}) for s in (5, 6)]
    found = diagnose(healthy(), worn)
    assert found.situation == "changed"
    assert found.findings[0].effect == OLD_PARAMETERS
    assert found.findings[0].share > 0.9
    assert "identify the robot again" in found.findings[0].sentence


def test_a_large_payload_is_found_with_its_inertias():
    body = {"m6": 2.0, "mx6": 0.1, "mz6": 0.3, "Ixx6": 0.12, "Iyy6": 0.12, "Izz6": 0.06}
    nominal = dict(zip(UR5.all_names, UR5.nominal, strict=True))
    loaded = [log_of(s, **{name: nominal[name] + value for name, value in body.items()}) for s in (5, 6)]
    found = diagnose(healthy(), loaded)
    best = found.findings[0]
    assert (found.situation, best.effect, best.joints) == ("changed", "payload", ("wrist_3_joint",))
    assert best.parameters["dm6"] == pytest.approx(2.0, rel=0.02)
    assert best.parameters["dIzz6"] == pytest.approx(0.06, rel=0.2)
    assert best.error_after < 1.3 * found.noise_floor


def loose_reversals(log: Log, joint: int, level: float) -> Log:
    """The same log, on which one joint's dry friction turns up to 20 ms early or late, each time another."""
    v = np.gradient(log.q[:, joint], log.t)
    tau, rng = np.array(log.tau), np.random.default_rng(0)
    for k in np.flatnonzero(np.diff(np.sign(v))) + 1:
        late = int(rng.integers(-2, 3))
        tau[min(k, k + late) : max(k, k + late), joint] -= np.sign(late) * 2 * level * np.sign(v[k])
    return Log(log.t, log.joints, log.q, tau=tau, source=f"{log.source} loose")


def test_dry_friction_that_turns_a_little_early_or_late_raises_no_alarm():
    logs = [loose_reversals(log_of(s), 4, 2.0) for s in (1, 2)]
    found = diagnose(identify(UR5, logs[:1], recursion="none").model, logs)
    assert found.joints["wrist_2_joint"]["error"] > 2 * found.joints["wrist_2_joint"]["noise_floor"]
    assert found.verdict == "none"
    assert any("the residual error of wrist_2_joint is at reversals and standstill" in note for note in found.notes)


def test_a_joint_that_sticks_as_it_reverses_lacks_nothing():
    logs = []
    for log in (log_of(1), log_of(2)):
        side = np.sign(np.gradient(log.q[:, 4], log.t))
        tau = np.array(log.tau)
        tau[:, 4] += 4.0 * (np.convolve(side, np.full(9, 1 / 9), mode="same") - side)  # it turns within 90 ms
        logs.append(replace(log, tau=tau, source=f"{log.source}, sticks"))
    found = diagnose(identify(UR5, logs[:1], recursion="none").model, logs)
    assert found.verdict == "none"
    assert max(found.probabilities, key=found.probabilities.__getitem__) == "none"
    assert {f.probability for f in found.findings if f.dry_friction_instead} == {0.0}


@pytest.mark.parametrize(
    ("floors", "share", "why"),
    [
        (2.5, 0.2, ""),
        (
            1.5,
            0.4,
            "it explains 40 % of the error above the sensor noise there, and must explain 50 %, because in this",
        ),
        (1.5, 0.6, ""),
        (1.1, 1.0, "in this search, the error there is hardly more than the sensor noise"),
        (0.0, 0.6, "it explains 60 % of the error above the sensor noise there, and must explain"),
        (0.0, 0.9, ""),
        (2.5, 0.0, "it explains none of the error above the sensor noise there"),
        (0.0, 0.0, "in this search, the error there is hardly more than the sensor noise"),
    ],
    ids=[
        "far above",
        "a part",
        "half",
        "what sensors leave",
        "half of dry friction at rest",
        "nearly all of it",
        "none of much",
        "nothing",
    ],
)
def test_how_much_a_finding_must_explain(floors, share, why):
    finding = Finding("stribeck", (), 0.02, 0.01, 50.0, 3e-4, share, floors, floors, 0.0, 1e-6, {}, (), "", ())
    assert finding.sure
    assert finding.withheld.startswith(why)
    assert finding.significant == (not why) == (not finding.withheld)


def test_a_small_effect_that_leaves_less_than_the_floor_is_found():
    """The floor was too high for sharp friction: a held-out error below it proves that."""
    logs = [log_of(s, "hysteresis@wrist_2_joint", fh5=0.06) for s in (1, 2)]
    found = diagnose(identify(UR5, logs[:1], recursion="none").model, logs)
    assert (found.verdict, found.findings[0].effect, found.findings[0].joints) == (
        "effect",
        "hysteresis",
        ("wrist_2_joint",),
    )


def test_what_is_withheld_is_told_once():
    logs = [log_of(s, "hysteresis@wrist_2_joint", fh5=0.06) for s in (1, 2)]
    strict = DiagnosisCriteria(clear_error=1e3, half_explained=0.999)
    found = diagnose(identify(UR5, logs[:1], recursion="none").model, logs, criteria=strict)
    withheld = next(f for f in found.findings if f.sure and f.withheld)
    assert found.verdict == "none"
    (told,) = [text for text in (found.remainder, *found.notes) if withheld.withheld in text]
    assert withheld.title in told


def test_a_probable_cause_that_is_not_called_missing_is_told():
    """The verdict names the most probable cause, so a reader looks for its finding."""
    logs = [log_of(s, "hysteresis@wrist_2_joint", fh5=0.06) for s in (1, 2)]
    found = diagnose(identify(UR5, logs[:1], recursion="none").model, logs).findings
    likely = replace(found[-1], gain=-1.0, p_value=1.0)
    (told,) = not_called_missing([*found[:-1], likely], {found[0].effect: 0.2, likely.effect: 0.8}, "effect")
    assert told == f"the most probable cause, {likely.title}, is not called missing: its evidence may be chance"
    assert not_called_missing(found, {found[0].effect: 0.8, likely.effect: 0.2}, "effect") == []


@pytest.mark.parametrize(("burst", "found"), [(0.05, False), (0.2, True)])
def test_a_burst_within_what_the_noise_is_unsure_by_is_no_event(burst, found):
    def rows(squares, count):
        counts = np.array([[count]])
        return SimpleNamespace(
            spread=np.ones(1), counts=counts, theta=None, squares=lambda *_: squares, criteria=DiagnosisCriteria()
        )

    noise, left = 1000 * 0.1**2, 0.9 * 990 * 0.1**2  # the floor is a little high
    assert _stands_out(rows(left + burst * noise, 1000), rows(left, 990), np.array([0.1]), None) == found


@pytest.mark.parametrize("run", [diagnose, improve, lambda m, logs: add(m, parse_effects("stribeck"), logs)])
def test_logs_that_cannot_be_judged_are_refused(run):
    log = log_of(2)
    still = replace(log, q=np.full_like(log.q, 0.3))
    if run is not diagnose:  # diagnose still looks for contacts (tests/test_logs_that_rest.py)
        with pytest.raises(InputError, match="the arm stands still"):
            run(healthy(), [still])
    silent = replace(log, tau=np.where(np.arange(6) == 2, np.nan, log.tau))
    with pytest.raises(InputError, match=r"no torque \(tau_<joint>\) of elbow_joint"):
        run(healthy(), [silent])
    with pytest.raises(InputError, match=r"no position \(q_<joint>\) of wrist_3_joint"):
        run(healthy(), [log.select(UR5.joints[:5])])


def test_a_log_cannot_be_held_out_and_fitted():
    for run in (diagnose, improve, lambda m, logs, valid: add(m, parse_effects("stribeck"), logs, valid=valid)):
        with pytest.raises(InputError, match="both fitted and held out"):
            run(healthy(), [log_of(2)], valid=[log_of(2)])


def test_logs_too_short_to_judge_by_are_told():
    log = log_of(2)
    short = replace(log.slice(300, 400), tau=5 * log.tau[300:400])  # of a robot that is not as its URDF says
    found = diagnose(healthy(), [short], situation="always")
    assert any("too short" in note for note in found.notes)
    assert not any("too short" in note for note in diagnose(healthy(), [log], effects=["stribeck"]).notes)


def test_another_joint_that_explains_as_much_is_named():
    """Of two joints, one gain is the inverse of the other beside links of other weight: no log tells which is wrong."""
    robot = Robot.load("TwoDofs")
    logs = [log_of(seed, "drive_gain@J2", robot=robot, gain2=0.1) for seed in (1, 2)]
    found = diagnose(identify(robot, logs, recursion="none").model, logs, situation="always")
    first = found.findings[0]
    assert first.effect == "drive_gain"
    assert {*first.joints, *first.elsewhere} == {"J1", "J2"}
    (other,) = first.elsewhere
    assert f"On {other} instead, the same effect" in first.sentence
    spring = log_of(3, "joint_spring@wrist_2_joint", ks5=1.0)
    assert diagnose(healthy(), [spring]).findings[0].elsewhere == ()


@pytest.mark.parametrize("name", ["thermal_drift", "torque_drift"])
def test_an_effect_of_temperature_is_one_of_time_where_no_log_has_a_temperature(name):
    logs = [log_of(1)]
    (found,) = searched(healthy(), parse_effects(f"{name}@elbow_joint"), f"{name}@elbow_joint", logs, "always")
    assert found.channels(UR5) == ()


@pytest.mark.parametrize(("order", "found"), [(3.0, False), (9.0, True)])
def test_a_wave_that_does_not_repeat_within_the_motion_is_no_ripple(order, found):
    """Its half is a curve of the angle: a spring."""
    motion, ripple = (
        random_fourier(UR5, 25.0, seed=2, scale=0.25),
        parse_effects(f"cogging(order={order})@wrist_2_joint"),
    )
    log = simulate(
        UR5, motion, rate=100.0, effects=(*BASELINE, *ripple), parameters=DRY | {"A5": 1.0}, noise=NOISE, channels=()
    )
    assert (order * np.ptp(log.q[:, 4]) > 2 * 2 * np.pi) == found
    first = diagnose(identify(UR5, [log], recursion="none").model, [log]).findings[0]
    assert (first.effect, first.joints) == ("cogging" if found else "joint_spring", ("wrist_2_joint",))


def test_an_effect_on_a_joint_without_torque_says_so():
    log = log_of(1)
    blind = replace(log, tau=np.where(np.arange(6) == 2, np.nan, log.tau))
    model = identify(UR5, [blind], recursion="none").model
    with pytest.raises(InputError, match=r"was not fitted to a torque of elbow_joint.*shoulder_pan_joint"):
        searched(model, parse_effects("cogging@elbow_joint"), "cogging@elbow_joint", [blind], "always")
