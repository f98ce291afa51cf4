"""A model shown with a log it was not fitted to: the robot changed since, or an effect was always missing."""

from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.diagnosis.clause import missing
from frischid.diagnosis.floor import Floor, asks_for_explanation
from frischid.diagnosis.improvement import improve
from frischid.diagnosis.roles import (
    _note_before_change,
    decided_situation,
    diagnose_in_roles,
    logs_before_change,
    roles,
)
from frischid.diagnosis.shape_choice import searched
from frischid.diagnosis.situation import cross_validator
from frischid.effects import BASELINE, parse_effects
from frischid.effects.friction_memory import presliding
from frischid.errors import InputError
from frischid.logs.log import Log
from frischid.logs.readers import read_log, write_log
from frischid.model.headline import headline
from frischid.model.identification import identify
from frischid.model.model import Model
from frischid.model.own_logs import own_logs
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

PLANAR2 = Robot.load("planar2")
DRY = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.02, "Ia2": 0.01}
SQUARE, SPRING = "quadratic_viscous@joint1", "joint_spring@joint2"


def log_of(seed: int, effects: str, scale: float = 0.8, **values: float) -> Log:
    """A noisy log of the planar arm."""
    return simulate(
        PLANAR2,
        random_fourier(PLANAR2, 25.0, seed=seed, scale=scale),
        rate=100.0,
        effects=(*BASELINE, *parse_effects(effects)) if effects else BASELINE,
        parameters=DRY | values,
        noise=Noise(q=1e-6, tau=0.01),
        channels=(),
        seed=seed,
        name=f"log {seed}",
    )


def pushed(log: Log) -> Log:
    """The log of an arm that somebody pushes for a second, twice."""
    tau = np.array(log.tau)
    tau[((log.t > 5) & (log.t < 6)) | ((log.t > 15) & (log.t < 16.2)), 1] += 2.0
    return replace(log, tau=tau, source=f"{log.source} pushed")


@pytest.fixture(params=["square", "clean"])
def machine(request, tmp_path):
    """The name of the robot, and its model from two files."""
    effects, values = (SQUARE, {"fvv1": 4.0}) if request.param == "square" else ("", {})
    for seed in (1, 2):
        write_log(log_of(seed, effects, 0.5, **values), tmp_path / f"log{seed}.parquet")
    logs = [read_log(tmp_path / f"log{seed}.parquet", PLANAR2.joints) for seed in (1, 2)]
    return request.param, identify(PLANAR2, logs, recursion="none").model


def test_an_effect_that_the_own_logs_show_is_no_change(machine):
    name, model = machine
    if name == "clean":
        assert decided_situation(model, [log_of(3, "")]).situation == "always"
        return
    new = [log_of(3, SQUARE, fvv1=4.0)]
    assert cross_validator(model, new)[1] == "changed", "a refit is better on a faster motion: that alone shows nothing"
    found = diagnose_in_roles(model, new)
    assert (found.situation, found.verdict, found.findings[0].effect) == ("always", "effect", "quadratic_viscous")
    assert found.probabilities["quadratic_viscous"] > 0.8
    assert any("effects that explain most of it" in note for note in found.notes)
    assert found.headline.measured == "test"
    given = roles(model, new)
    assert given.found is not None
    assert given.found.to_dict()["probabilities"] == found.to_dict()["probabilities"]


def test_an_error_that_the_own_logs_have_too_is_no_change(tmp_path):
    def saturated(log: Log) -> Log:
        tau = np.array(log.tau)
        tau[:, 1] = np.clip(tau[:, 1], -limit, limit)
        return replace(log, tau=tau)

    limit = float(np.quantile(np.abs(log_of(1, "").tau[:, 1]), 0.85))
    for seed in (1, 2):
        write_log(saturated(log_of(seed, "")), tmp_path / f"log{seed}.parquet")
    model = identify(
        PLANAR2, [read_log(tmp_path / f"log{k}.parquet", PLANAR2.joints) for k in (1, 2)], recursion="none"
    ).model
    for seed in (3, 6):
        new = [saturated(log_of(seed, ""))]
        assert decided_situation(model, new).situation == "always"
        assert not decided_situation(model, new).touched, "its bursts are those of the own logs"


def test_a_small_push_beside_a_large_error_of_the_own_logs_is_found(tmp_path):
    def bound(log: Log) -> Log:
        """The log of an arm with a cable between both joints."""
        tau = np.array(log.tau)
        tau[:, 1] += 0.45 * np.tanh(3 * log.q[:, 0] * log.q[:, 1])
        return replace(log, tau=tau)

    for seed in (1, 2):
        write_log(bound(log_of(seed, "")), tmp_path / f"log{seed}.parquet")
    own = [read_log(tmp_path / f"log{k}.parquet", PLANAR2.joints) for k in (1, 2)]
    model = identify(PLANAR2, own, recursion="none").model
    for seed, situation in ((3, "changed"), (5, "always")):
        log = bound(log_of(seed, ""))
        assert decided_situation(model, [log])[::3] == ("always", False)
        assert decided_situation(model, [pushed(log)])[::3] == (situation, situation == "always")
        found = diagnose_in_roles(model, [pushed(log)], valid=[log_of(6, "")])
        assert (found.situation, found.verdict) == (situation, "contact")
        assert [round(c.start) for c in found.contacts] == [5, 15]
        assert any("so these logs select" in note for note in found.notes) == (situation == "always")


def test_a_joint_that_sticks_as_it_reverses_is_no_change(tmp_path):
    """Dry friction, which is undetermined at reversals, turns slowly there in the new log alone."""
    for seed in (1, 2):
        write_log(log_of(seed, "", 0.4, fc2=2.0), tmp_path / f"log{seed}.parquet")
    own = [read_log(tmp_path / f"log{seed}.parquet", PLANAR2.joints) for seed in (1, 2)]
    model, log = identify(PLANAR2, own, recursion="none").model, log_of(3, "", 0.4, fc2=2.0)
    side, tau = np.sign(np.gradient(log.q[:, 1], log.t)), np.array(log.tau)
    tau[:, 1] += 2.0 * (np.convolve(side, np.full(15, 1 / 15), mode="same") - side)
    sticks = [replace(log, tau=tau)]
    validator, _ = cross_validator(model, sticks)
    assert asks_for_explanation(validator.base_nrmse(), Floor.of(validator).noise / validator.spread, validator)[1]
    assert decided_situation(model, sticks).situation == "always"
    assert decided_situation(model, [log_of(3, SPRING, 0.4, fc2=2.0, ks2=0.5)]).situation == "changed"


def test_a_change_beside_an_effect_that_was_always_missing_is_a_change(machine):
    name, model = machine
    effects, values = (f"{SQUARE},{SPRING}", {"fvv1": 4.0}) if name == "square" else (SPRING, {})
    new = [log_of(4, effects, 0.5, ks2=3.0, **values)]
    found = diagnose_in_roles(model, new)
    assert found.situation == "changed"
    assert found.findings[0].effect == "joint_spring"
    assert found.headline.nrmse == headline(model, new).nrmse, "the error is that of the model as it is"
    always = ["quadratic_viscous"] if name == "square" else []
    assert [x["effect"] for x in found.to_dict()["always_missing"]] == always
    assert any("already show quadratic_viscous on joint1 (probability 9" in note for note in found.notes) == bool(
        always
    )
    assert all(f.effect != "quadratic_viscous" for f in found.findings if f.significant)
    before = "; the model's own logs already show quadratic_viscous on joint1 (probability 9"
    for verdict in ("effect", "unknown"):  # the lead of the report said "more is missing than any one effect explains"
        assert (before in missing(replace(found, verdict=verdict))) == bool(always)
    nothing_new = replace(found, verdict="none", findings=(), probabilities={})
    shown = "Beside quadratic_viscous on joint1, which the model's own logs already show, no effect is "
    assert missing(nothing_new).startswith(shown if always else "No effect is ")
    withheld = [replace(f, set_aside="noise") for f in found.always_missing]
    assert missing(replace(nothing_new, always_missing=tuple(withheld))).startswith("No effect is ")
    assert not withheld or _note_before_change(withheld).startswith(
        "the model's own logs hint at quadratic_viscous on joint1, not called missing there. The search"
    )


@pytest.mark.parametrize("machine", ["square"], indirect=True)
@pytest.mark.parametrize("situation", ["auto", "changed"])
def test_what_was_always_missing_is_no_part_of_the_change(machine, situation):
    _, model = machine
    new = [log_of(4, f"{SQUARE},{SPRING}", 0.5, ks2=3.0, fvv1=4.0)]
    given = roles(model, new, situation=situation)
    assert given.before is not None
    assert [e.id for e in given.before.effects[len(model.effects) :]] == ["quadratic_viscous"]
    assert given.before.estimate.theta[-1] == pytest.approx(4.0, rel=0.1), "as strong as in the own logs"
    steps, last = improve(model, new, situation=situation)
    assert [step.effect.id for step in steps][:2] == ["quadratic_viscous", "joint_spring"]
    assert steps[0].measured_on == "cross-validated on the fitted logs"
    assert last.situation == "changed"
    assert not improve(model, new, situation=situation, max_steps=0)[0]


@pytest.mark.parametrize("machine", ["clean"], indirect=True)
def test_a_push_in_a_log_of_its_own_is_found_there(machine):
    _, model = machine
    new = [pushed(log_of(5, "", 0.5))]
    assert cross_validator(model, new)[1] == "always", "a refit to a pushed log is no better"
    found = diagnose_in_roles(model, new)
    assert (found.situation, found.verdict) == ("changed", "contact")
    assert [round(c.start) for c in found.contacts] == [5, 15]


@pytest.mark.parametrize("machine", ["square"], indirect=True)
def test_an_own_log_that_tests_decides_nothing(machine):
    _, model = machine
    own = own_logs(model).logs
    new = [log_of(4, f"{SQUARE},{SPRING}", 0.5, ks2=3.0, fvv1=4.0)]
    decided = decided_situation(model, new, "changed", valid=own[:1])
    assert [log.identity for log in logs_before_change(model, own[:1])] == [own[1].identity]
    assert decided.found is not None
    assert not own_logs(model, own).logs
    assert decided_situation(model, new, "changed", valid=own).found is None


def test_parameters_of_a_change_that_the_logs_leave_open_are_called_unknown():
    """A payload where a joint rests: a mass of -0.194 ± 0.0019 kg, because a pseudo-inverse has no variance there."""
    arm = fr.Robot.load("ur10").keep(("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"))

    def recorded(seed, resting):
        rng, t = np.random.default_rng(seed), np.arange(0, 15, 0.01)
        q, v, a = (np.array(x) for x in fr.random_fourier(arm, 15, seed=seed)(t))
        q[:, resting], v[:, resting], a[:, resting] = 0.3, 0.0, 0.0
        noise = rng.standard_normal((2, *q.shape))
        tau = arm.inverse_dynamics(q, v, a) + 5 * v + 0.5 * noise[0]
        return fr.Log(t, arm.joints, q + 1e-6 * noise[1], tau=tau, source=f"log {seed}")

    model = fr.identify(arm, [recorded(1, [])], recursion="none").model
    payload = fr.parse_effects("payload(full=True)@shoulder_lift_joint")
    changed = fr.add(model, payload, [recorded(2, [2])], situation="changed").model
    mass = changed.parameters["dm2"]
    assert mass.stderr > 1000 * abs(mass.value)
    assert changed.parameters["dmx2"].stderr < 1.0, "this one is determined"
    assert np.linalg.eigvalsh(changed.estimate.covariance)[0] > 0


NEW = {
    "joint_spring": lambda t, q, v: 1.5 * (q - 1.2),
    "hysteresis": lambda t, q, v: presliding(t, v, 0.03),
    "asymmetric_viscous": lambda t, q, v: np.where(v > 0, 0.4 + 0.5 * v, 0.0),
    "asymmetric_coulomb": lambda t, q, v: np.where(v > 0, 0.6, 0.0),
    "torque_drift": lambda t, q, v: 1.2 * np.exp(-t / 15),
}
"""Torques that came after the model was identified, in whole: none is measured from an old parameter of the model."""


@pytest.mark.parametrize("machine", ["clean"], indirect=True)
@pytest.mark.parametrize("name", NEW)
def test_what_comes_later_brings_the_old_parameters_that_hold_a_part_of_it(machine, name):
    """A spring's angle without torque was searched in the offset of before, and new friction in the old one."""
    _, model = machine

    def later(seed: int) -> Log:
        log = log_of(seed, "", 0.5)
        tau = np.array(log.tau)
        tau[:, 1] += NEW[name](log.t, log.q[:, 1], np.gradient(log.q[:, 1], log.t))
        return replace(log, tau=tau, source=f"{log.source} later")

    found = diagnose_in_roles(model, [later(4)])
    first = found.findings[0]
    assert (found.situation, first.effect, first.joints) == ("changed", name, ("joint2",))
    assert first.probability > 0.8
    assert {e.id for e in first.members} > {name}, "beside a change of old parameters"
    assert len(first.parameters) >= sum(len(e.columns(PLANAR2)) for e in first.members)
    steps, _ = improve(model, [later(4)], max_steps=1)
    assert steps[0].effect.id == name
    before, after = (fr.compare(m, [later(6)]).nrmse for m in (model, steps[0].model))
    assert after < 0.4 * before, "on another log of the changed robot too"
    searched_for = searched(model, parse_effects(f"{name}@joint2"), f"{name}@joint2", [later(4)], "changed")
    assert {e.id for e in searched_for} == {e.id for e in first.members}, "frischid add adds the same"


@pytest.mark.parametrize("machine", ["clean"], indirect=True)
def test_changed_friction_alone_has_no_rivals_that_contain_it(machine):
    """Every effect of friction beside the change of friction explains as much: they had shared the probability."""
    _, model = machine
    log = log_of(4, "", 0.5)
    v = np.gradient(log.q[:, 1], log.t)
    tau = np.array(log.tau)
    tau[:, 1] += 0.3 * np.sign(v) + 0.3 * v
    found = diagnose_in_roles(model, [replace(log, tau=tau, source="later")])
    assert [e.id for e in found.findings[0].members] == ["friction_change"]
    assert found.findings[0].probability > 0.8


@pytest.mark.parametrize("machine", ["clean"], indirect=True)
def test_an_offset_and_a_friction_that_both_changed_are_not_friction_of_one_direction(machine):
    """The columns are the same in motion. Only where one direction kept its friction are the two changes one cause."""
    _, model = machine
    log = log_of(4, "", 0.5)
    tau = np.array(log.tau)
    tau[:, 1] += 0.6 + 0.2 * np.sign(np.gradient(log.q[:, 1], log.t))
    found = diagnose_in_roles(model, [replace(log, tau=tau, source="later")])
    assert found.findings[0].effect == "offset_change"
    assert sum(found.probabilities.get(name, 0.0) for name in ("asymmetric_coulomb", "asymmetric_viscous")) < 0.1


def test_friction_of_one_direction_is_no_candidate_where_nothing_changed(machine):
    """Beside the model's offset it differs at standstill only; after a change the offset is known from before."""
    _, model = machine
    for situation in ("always", "changed"):
        found = diagnose_in_roles(model, [log_of(4, "", 0.5)], situation=situation, effects=["asymmetric_coulomb"])
        assert any("not tried: asymmetric_coulomb" in note for note in found.notes) == (situation == "always")


@pytest.mark.parametrize("machine", ["clean"], indirect=True)
@pytest.mark.parametrize("ratio", [0.0, 0.5])
def test_a_coupling_needs_more_than_the_motion_of_its_own_joints(machine, ratio):
    """A heavier rotor at one joint was called a motor that turns with two, with a ratio of -1/32 and 94 %."""
    _, model = machine
    log = log_of(4, "", 0.5)
    a, tau = np.gradient(np.gradient(log.q, log.t, axis=0), log.t, axis=0), np.array(log.tau)
    tau += 0.3 * (a[:, :1] * ratio + a[:, 1:]) * [ratio, 1.0]
    found = diagnose_in_roles(model, [replace(log, tau=tau, source="later")], situation="changed")
    assert (found.probabilities.get("joint_coupling", 0.0) > 0.5) == (ratio > 0)
    if not ratio:
        assert str(found.findings[0].members[0]) == "rotor_inertia(coupled=False, ratio=1, changed=1)@joint2"
        assert found.findings[0].probability > 0.8
        assert found.findings[0].parameters["dIa2"] == pytest.approx(0.3, rel=0.1)


def test_viscous_friction_of_one_direction_that_the_model_has_may_have_changed():
    """The model's own effect was no candidate; on a slide at constant speeds dry friction took its place, with 94 %."""
    effects = (*BASELINE, *parse_effects("asymmetric_viscous@joint2"))
    logs = [log_of(seed, "asymmetric_viscous@joint2", 0.5, fva2=0.3) for seed in (1, 2)]
    model = identify(PLANAR2, logs, effects=effects, recursion="none").model
    later = log_of(4, "asymmetric_viscous@joint2", 0.5, fva2=0.9, fv2=0.9)
    found = diagnose_in_roles(model, [later], situation="changed")
    assert found.probabilities.get("asymmetric_coulomb", 0.0) < 0.05
    assert str(found.findings[0].members[0]) == "asymmetric_viscous(changed=1)@joint2"


KNOWN = {
    "joint_spring": ("joint_spring@joint2", {"ks2": 2.0}, {"ks2": 1.4}),
    "load_friction": ("load_friction@joint2", {"fl2": 0.1}, {"fl2": 0.2}),
    "hysteresis": ("hysteresis(distance=0.05)@joint2", {"fh2": 0.5}, {"fh2": 1.0}),
}
"""An effect that a robot has, its coefficient when the model is identified, and later."""


@pytest.mark.parametrize("in_model", [True, False], ids=["in the model", "shown by its logs"])
@pytest.mark.parametrize("name", KNOWN)
def test_an_effect_that_was_there_before_may_change(tmp_path, name, in_model):
    """Such an effect was no candidate: hysteresis that grew on a joint that had some was a drive gain."""
    effect, before, later = KNOWN[name]
    for seed in (1, 2):
        write_log(log_of(seed, effect, 0.5, **before), tmp_path / f"log{seed}.parquet")
    own = [read_log(tmp_path / f"log{seed}.parquet", PLANAR2.joints) for seed in (1, 2)]
    effects = (*BASELINE, *parse_effects(effect if in_model else ""))
    model = identify(PLANAR2, own, recursion="none", effects=effects).model
    logs = [log_of(seed, effect, 0.5, **later) for seed in (3, 4)]
    found = diagnose_in_roles(model, logs, situation="changed")
    first = found.findings[0]
    assert (first.effect, first.joints) == (name, ("joint2",))
    assert first.probability > 0.8
    assert first.members[0].changed
    assert first.sentence.endswith("This effect was there before, and has changed")
    coefficient = next(iter(before))
    assert first.parameters[f"d{coefficient}"] == pytest.approx(later[coefficient] - before[coefficient], rel=0.1)
    if not in_model:
        return
    again = fr.add(model, first.members, logs, situation="changed")
    steps, last = improve(model, logs, situation="changed")
    for step in (again, *steps):
        assert step.error_after < 0.3 * step.error_before
    assert last.verdict == "none"
    named = searched(model, parse_effects(f"{name}@joint2"), f"{name}@joint2", logs, "changed")
    assert {(e.id, e.changed) for e in named} == {(e.id, e.changed) for e in first.members}, (
        "frischid add does the same"
    )
    steps[0].model.save(tmp_path / "changed.json")
    assert Model.load(tmp_path / "changed.json").effects == steps[0].model.effects


def test_an_effect_may_change_again(tmp_path):
    """The second change of a spring was a spring of another form, with 0.99."""
    first, second = ([log_of(seed, "joint_spring@joint2", 0.5, ks2=ks)] for seed, ks in ((3, 1.4), (4, 0.8)))
    effects = (*BASELINE, *parse_effects("joint_spring@joint2"))
    own = [log_of(seed, "joint_spring@joint2", 0.5, ks2=2.0) for seed in (1, 2)]
    model = identify(PLANAR2, own, recursion="none", effects=effects).model
    model = fr.add(model, parse_effects("joint_spring@joint2"), first, situation="changed").model
    notes = fr.export(model, tmp_path / "drives.csv").notes
    assert notes == (
        "the table holds the drives before the robot changed: joint_spring(form=linear, changed=1)@joint2 is not in it",
    )
    found = diagnose_in_roles(model, second, situation="changed").findings[0]
    assert [str(e) for e in found.members] == ["joint_spring(form=linear, changed=2)@joint2"]
    assert found.parameters["ddks2"] == pytest.approx(-0.6, rel=0.1)
    assert fr.add(model, found.members, second, situation="changed").error_after < 0.02


def test_a_change_is_added_to_what_the_model_has():
    """A finding tells a change of an effect that the own logs show and the model lacks: then the effect is added."""
    change = parse_effects("joint_spring(changed=1)@joint2")
    own = [log_of(seed, "", 0.5) for seed in (1, 2)]
    model = identify(PLANAR2, own, recursion="none").model
    later = [log_of(3, "joint_spring@joint2", 0.5, ks2=1.4)]
    added = fr.add(model, change, later, situation="changed").model
    assert dict(zip((c.name for c in added.estimate.columns), added.estimate.theta, strict=True))["ks2"] > 1.2
    both = fr.add(added, parse_effects("joint_spring"), later, situation="changed").model
    assert [str(e) for e in both.effects[-2:]] == [
        "joint_spring(form=linear)@joint1",
        "joint_spring(form=linear, changed=1)@joint2",
    ]
    with pytest.raises(InputError, match="assumed not to have changed"):
        fr.add(added, change, later, situation="always")
    with pytest.raises(InputError, match="expected a number from 0 to"):
        parse_effects("joint_spring(changed=True)@joint2")


def test_a_short_log_of_a_slow_robot_has_blocks_of_time():
    """With twelve periods a block, a log of 7 s had three blocks at 5 Hz: ranks of three blocks pass no test."""
    log = log_of(1, "", 0.5)
    log = fr.stretch(log, 0.0, 7.2)
    model = identify(PLANAR2, [log], recursion="none", cutoff=5.0).model
    assert cross_validator(model, [log])[0].data.cache.blocks >= 5
