"""Logs of two robots in one fit raise an alarm; logs of one robot do not, whatever they show."""

import xml.etree.ElementTree as ET
from itertools import cycle
from types import SimpleNamespace

import numpy as np
import pytest

import frischid as fr
from frischid.diagnosis.clause import on_condition
from frischid.model import log_agreement
from frischid.model.alarms import FAULTY_LOG, LOGS_DISAGREE, Alarm

NOISE = fr.Noise(q=1e-5, tau=0.02)
LOADED = {"m2": 3.0, "mx2": 1.0}


@pytest.fixture(scope="module")
def arm():
    return fr.Robot.load("planar2")


def log_of(robot, seed, seconds=12.0, effects=fr.BASELINE, **parameters):
    motion = fr.random_fourier(robot, seconds, seed=seed)
    return fr.simulate(
        robot, motion, rate=100, noise=NOISE, seed=seed, name=f"log{seed}", effects=effects, parameters=parameters
    )


def disagreement(robot, logs, **options):
    found = fr.identify(robot, logs, recursion="none", **options)
    return [alarm for alarm in found.alarms if alarm.id == LOGS_DISAGREE]


@pytest.mark.parametrize("prior", ["urdf", "none"])
def test_a_load_in_one_of_two_logs_is_an_alarm(arm, prior):
    (alarm,) = disagreement(arm, [log_of(arm, 1), log_of(arm, 2, **LOADED)], prior=prior)
    assert alarm.severity == "severe"
    assert "log1 and log2" in alarm.sentence
    assert "joint2" in alarm.joints
    assert alarm.value > 2 * alarm.limit


def test_the_one_log_of_another_robot_is_named(arm):
    (alarm,) = disagreement(arm, [log_of(arm, seed) for seed in (1, 2, 3)] + [log_of(arm, 4, **LOADED)])
    assert "log4 is unlike" in alarm.sentence


def test_logs_of_one_robot_agree(arm):
    assert disagreement(arm, [log_of(arm, 1), log_of(arm, 2), log_of(arm, 3, seconds=5.0)]) == []


def test_logs_of_one_robot_with_an_effect_that_the_model_lacks_agree(arm):
    effects = (*fr.BASELINE, *fr.parse_effects("joint_spring"))
    assert disagreement(arm, [log_of(arm, seed, effects=effects, ks2=1.0) for seed in (1, 2)]) == []


def test_a_log_that_shows_more_than_the_others_but_explains_them_is_no_alarm(arm, monkeypatch):
    ratios = cycle([np.array([9.0, 9.0]), np.array([1.0, 1.2])])
    monkeypatch.setattr(log_agreement, "surprise", lambda *_: next(ratios))
    assert disagreement(arm, [log_of(arm, 1), log_of(arm, 2)]) == []


def test_the_torques_may_be_as_small_as_those_of_a_watch(arm, tmp_path):
    """Residual variances far below 1e-8 (N·m)² are found to a share of their own size, not to an absolute one."""
    tree, small = ET.fromstring(arm.urdf), 1e-5
    for tag in (*tree.iter("mass"), *tree.iter("inertia"), *tree.iter("dynamics")):
        tag.attrib.update({key: repr(small * float(x)) for key, x in tag.attrib.items()})
    path = tmp_path / "watch.urdf"
    path.write_text(ET.tostring(tree, encoding="unicode"), encoding="utf-8")
    watch = fr.Robot.load(path)
    of_the_watch = [log_of(watch, 1), log_of(watch, 2, **{name: small * x for name, x in LOADED.items()})]
    ratios = [
        disagreement(robot, logs)[0].value
        for robot, logs in ((arm, [log_of(arm, 1), log_of(arm, 2, **LOADED)]), (watch, of_the_watch))
    ]
    assert ratios[1] == pytest.approx(ratios[0], rel=0.05)


def test_a_verdict_beside_such_logs_presumes_what_the_alarms_say():
    found = [Alarm(name, "severe", "", "", value=1.0) for name in (LOGS_DISAGREE, FAULTY_LOG, "impossible-sign")]
    diagnosis = SimpleNamespace(headline=SimpleNamespace(alarms=found), load=None)
    assert on_condition(diagnosis, "An effect is missing") == (
        "Unless a log has the fault that the alarm names or the robot changed between the fitted logs, as the alarm "
        "says, an effect is missing"
    )


@pytest.mark.parametrize(("fault", "said"), [("carried load, likely", "The robot"), ("torque sign, likely", "Unless")])
def test_a_verdict_on_a_load_does_not_presume_the_alarms_about_the_load(fault, said):
    sentences = {FAULTY_LOG: f"a.csv: it is so ({fault}).", LOGS_DISAGREE: ""}
    found = [Alarm(name, "severe", sentence, "", value=1.0) for name, sentence in sentences.items()]
    load = SimpleNamespace(stretches=[("a.csv", 1.0, 2.0)])
    diagnosis = SimpleNamespace(headline=SimpleNamespace(alarms=found), load=load)
    assert on_condition(diagnosis, "The robot carries a load").startswith(said)
