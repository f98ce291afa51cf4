"""Another type than a public function takes: the error names the argument, the value and the call that gives it."""

import json
from functools import cache

import numpy as np
import pytest
from cases import robot

import frischid as fr
from frischid.errors import InputError

ARM = robot("planar2")
MOTION = fr.random_fourier(ARM, 5.0, seed=1)
LOG = fr.simulate(ARM, MOTION, rate=50.0, noise=fr.Noise(q=1e-5, tau=0.01))


@cache
def found() -> fr.Identification:
    return fr.identify(ARM, [LOG], recursion="none")


WITH_A_MODEL = {
    "compare": lambda m: fr.compare(m, [LOG]),
    "headline": fr.headline,
    "diagnose": lambda m: fr.diagnose(m, [LOG]),
    "diagnose_in_roles": lambda m: fr.diagnose_in_roles(m, [LOG]),
    "add": lambda m: fr.add(m, fr.parse_effects("stribeck@joint1"), [LOG]),
    "improve": lambda m: fr.improve(m, [LOG]),
    "report": lambda m: fr.report(m, [LOG], "report.html"),
    "payload": lambda m: fr.payload(m, [LOG]),
    "make_consistent": fr.make_consistent,
    "export": lambda m: fr.export(m, "robot.urdf"),
    "output_error": lambda m: fr.output_error(m, [LOG]),
    "compare_simulated": lambda m: fr.compare_simulated(m, [LOG]),
    "simulate_findings": lambda m: fr.simulate_findings(m, None, [LOG]),
    "ForwardDynamics": fr.ForwardDynamics,
    "drive_parameters": fr.drive_parameters,
    "own_logs": fr.own_logs,
}


@pytest.mark.parametrize("name", WITH_A_MODEL)
def test_an_identification_is_no_model(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"model must be of the type Model, got Identification\(.*found\.model of"):
        WITH_A_MODEL[name](found())
    assert not list(tmp_path.iterdir())


OTHERS = {
    "robot must be of the type Robot, got 'planar2'": lambda: fr.simulate("planar2", MOTION, rate=50.0),
    "robot must be of the type Robot, got 'planar3'": lambda: fr.plan("planar3"),
    "robot must be of the type Robot, got 'planar4'": lambda: fr.random_fourier("planar4", 5.0, seed=1),
    "robot must be the path of a URDF or MJCF file, or a name, got 3": lambda: fr.Robot.load(3),
    "gravity must be three finite numbers in m/s², got 9.81": lambda: fr.Robot.load("planar2", gravity=9.81),
    "gravity must be three finite numbers in m/s², got 'down'": lambda: fr.Robot.load("planar2", gravity="down"),
    "planar2: known must be one number, got 'a'": lambda: fr.Robot.load("planar2", known={"my1": "a"}),
    "the angle of joint1 must be one number, got 'a'": lambda: fr.Robot.load("planar2", lock={"joint1": "a"}),
    "a log needs times t and positions q": lambda: fr.Log(LOG.t, LOG.joints, q=None),
    "trajectory must be a motion such as": lambda: fr.simulate(ARM, LOG.q, rate=50.0),
    "the rate must be one number, got '50'": lambda: fr.simulate(ARM, MOTION, rate="50"),
    "the seed must be one number, got 'a'": lambda: fr.simulate(ARM, MOTION, rate=50.0, seed="a"),
    "the parameter fv1 must be one number, got 'a'": lambda: fr.simulate(
        ARM, MOTION, rate=50.0, parameters={"fv1": "a"}
    ),
    "noise must be of the type Noise, got 0.01": lambda: fr.simulate(ARM, MOTION, rate=50.0, noise=0.01),
    r"noise q must be one number, got \[0.1, 0.2\]": lambda: fr.Noise(q=[0.1, 0.2]),
    "effects must be a list of effects, got PlanOptions": lambda: fr.plan(ARM, fr.PlanOptions(budget=10)),
    "options must be of the type PlanOptions": lambda: fr.plan(ARM, options={"budget": 10}),
    "the duration must be one number, got 'a'": lambda: fr.PlanOptions(duration="a"),
    "seed of a plan must be one number, got 'a'": lambda: fr.PlanOptions(seed="a"),
    "share of the limits that is used must be one number": lambda: fr.plan(ARM, options=fr.PlanOptions(limits="a")),
    "the payload's mass must be one number, got 'a'": lambda: fr.KnownPayload("a"),
    "payload must be of the type KnownPayload, got 2.0": lambda: fr.find_gains(ARM, [LOG], [LOG], 2.0),
    "interval must be one number, got 'a'": lambda: found().model.predict(LOG.q, LOG.v, LOG.a, interval="a"),
    "names such as 'joint_spring', got Stribeck": lambda: fr.diagnose(
        found().model, [LOG], effects=fr.parse_effects("stribeck")
    ),
    "max_steps must be one number, got 'a'": lambda: fr.improve(found().model, [LOG], max_steps="a"),
    "horizons must be a list of times in s, got 0.1": lambda: fr.compare_simulated(found().model, [LOG], horizons=0.1),
    "a horizon must be one number, got 'a'": lambda: fr.compare_simulated(found().model, [LOG], horizons=["a"]),
    "horizon of an output error fit must be one number": lambda: fr.OutputErrorOptions(horizon="a"),
    "options must be of the type OutputErrorOptions": lambda: fr.output_error(
        found().model, [LOG], options={"horizon": 0.5}
    ),
    "workers must be of the type Workers, got 2": lambda: fr.diagnose(found().model, [LOG], workers=2),
    r"truth must hold the \d+ base parameters, got the shape \(2,\)": lambda: fr.report(
        found().model, [LOG], "report.html", truth=[1.0, 2.0]
    ),
    "there is no model to report on": lambda: fr.report({}, [LOG], "report.html"),
    r"the box of joint1 must be two corners of three numbers in m, got \[\[0, 0, 0\]\]": lambda: fr.make_consistent(
        found().model, boxes={"joint1": [[0, 0, 0]]}
    ),
}


@pytest.mark.parametrize("words", OTHERS)
def test_another_type_is_refused_with_the_name_and_the_value(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        OTHERS[words]()


def test_numbers_of_numpy_are_numbers():
    fr.Noise(q=np.float32(1e-5), tau=np.float64(0.01))
    fr.PlanOptions(budget=np.int64(10), seed=np.int32(1))
    fr.compare_simulated(found().model, [LOG], horizons=np.array([0.1, 0.2]))


def test_numbers_of_numpy_are_numbers_of_a_drive_and_of_a_filter():
    """They had been refused: a kp of 3 was "not below 1e+12"."""
    drive = fr.PDController(kp={"joint1": np.int64(3)}, kd=np.float32(0.5), delay=np.float32(0.25))
    assert drive == fr.PDController(kp={"joint1": 3.0}, kd=0.5, delay=0.25)
    assert json.dumps(vars(fr.OutputErrorOptions(horizon=np.float32(0.5), stretches=np.int64(5))))
    gains = fr.CurrentGains({"joint1": np.float32(3)}, {"joint1": np.float32(0.5)})
    assert json.loads(json.dumps([gains.to_dict(), drive.to_dict()]))[0] == gains.to_dict()
    model = fr.identify(ARM, [LOG], cutoff=np.int64(4), torque_lag=np.float32(0.0), recursion="none").model
    assert json.loads(json.dumps(model.to_dict()))["filter"]["cutoff_hz"] == 4
