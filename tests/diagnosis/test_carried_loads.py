"""A body that the robot carries for a while is named, weighed and left out; it is neither a contact nor an effect."""

import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import frischid as fr
from frischid.diagnosis.clause import missing
from frischid.diagnosis.stretches import reach_of_a_step, wider
from frischid.logs.filters import LowPass
from frischid.regression.regressor import Regressor

ARM = fr.Robot.load("planar2")
SIZES = {"fv1": 0.8, "fv2": 0.4, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.2, "Ia2": 0.1}
NOISE = np.array([0.1, 0.03])  # N·m
MASS, CENTRE = 0.6, 0.2  # kg, m along the second link
BODY = dict(zip(ARM.all_names, ARM.nominal, strict=True))
HEAVIER = {"m2": BODY["m2"] + MASS, "mx2": BODY["mx2"] + MASS * CENTRE, "Izz2": BODY["Izz2"] + MASS * CENTRE**2}


@cache
def recorded(start: float, stop: float, effects: str = "", seed: int = 4) -> fr.Log:
    """A log of 20 s of an arm that carries a body from `start` to `stop`, with a hidden effect."""
    motion = fr.random_fourier(ARM, 20.0, seed=seed)
    hidden = (*fr.BASELINE, *(fr.parse_effects(effects) if effects else ()))
    own = SIZES | ({"ks2": 3.0} if effects else {})
    bare, loaded = (
        fr.simulate(ARM, motion, rate=100.0, effects=hidden, parameters=own | more, channels=())
        for more in ({}, HEAVIER)
    )
    carried = (bare.t >= bare.t[0] + start) & (bare.t < bare.t[0] + stop)
    rng = np.random.default_rng(seed)
    tau = np.where(carried[:, None], loaded.tau, bare.tau) + NOISE * rng.normal(size=bare.tau.shape)
    return replace(bare, q=bare.q + 1e-6 * rng.normal(size=bare.q.shape), v=None, a=None, tau=tau, source="picked.csv")


def diagnosed(*logs: fr.Log) -> fr.Diagnosis:
    return fr.diagnose(fr.identify(ARM, list(logs), recursion="none").model, list(logs))


def test_a_load_that_is_taken_and_put_down_is_weighed_and_left_out():
    """It had been a contact (97 %)."""
    log = replace(recorded(8.0, 14.0), t=recorded(8.0, 14.0).t + 1000.0)
    found = diagnosed(log)
    load = found.load
    assert load is not None
    assert load.mass_error is not None
    assert load.joint == "joint2"
    assert load.mass == pytest.approx(MASS, abs=3 * load.mass_error)
    assert load.mass_error < 0.1 * MASS
    ((_, start, stop),) = load.stretches
    assert (start, stop) == pytest.approx((1008.0, 1014.0), abs=0.15)
    assert load.left_out == load.stretches
    assert (found.verdict, found.contacts, found.limits) == ("none", (), ())
    assert "in picked.csv from 8.0" in str(load)  # counted from the first sample, as `frischid cut` does
    assert str(load) in found.notes
    assert any("the model was fitted with this load" in note for note in found.notes)
    assert found.remainder.startswith(f"the robot carries {load.words} for a while; in the rest of the logs, no effect")
    assert missing(replace(found, verdict="unknown")).endswith(
        f"the robot carries {load.words} for a while (left out of the search)"
    )
    written = found.to_dict()["load"]
    assert (written["joint"], written["mass"], written["stretches"][0]["log_start"]) == ("joint2", load.mass, 1000.0)
    assert found.left_out("joint1") == found.left_out("joint2") == {"load": list(load.stretches)}


def test_the_shorter_times_are_left_out():
    found = diagnosed(recorded(5.0, 30.0))
    assert found.load is not None
    assert found.load.stretches[0][1] == pytest.approx(5.0, abs=0.15)
    ((_, start, stop),) = found.load.left_out
    assert start < 1.0 < 4.8 < stop < 5.2
    assert "The times without the load are left out" in str(found.load)
    assert found.left_out("joint1") == {"no load": list(found.load.left_out)}
    assert found.verdict == "none"


@pytest.mark.parametrize(("start", "stop", "seed"), [(8.0, 15.0, 6), (12.0, 15.0, 4), (8.0, 11.0, 7), (4.0, 16.0, 6)])
def test_an_effect_beside_the_load_is_found_too(start, stop, seed):
    """The effect explains more than the load."""
    found = diagnosed(recorded(start, stop, "joint_spring@joint2", seed))
    assert found.load is not None
    assert found.load.mass == pytest.approx(MASS, rel=0.05)
    assert found.load.stretches[0][1:] == pytest.approx((start, stop), abs=0.2)
    assert (found.verdict, found.findings[0].effect) == ("effect", "joint_spring")


def test_a_load_of_one_of_two_logs_is_found():
    found = diagnosed(recorded(0.0, 0.0), replace(recorded(9.0, 30.0, seed=5), source="second.csv"))
    assert found.load is not None
    assert {source for source, _, _ in found.load.stretches} == {"second.csv"}


def test_a_log_that_is_loaded_throughout_is_left_out_as_a_whole():
    """Such a log is a fold, which then has no rows: the other log is cut anew. The alarm of the logs says the same."""
    found = diagnosed(recorded(0.0, 0.0), replace(recorded(0.0, 30.0, seed=5), source="second.csv"))
    assert found.load is not None
    assert found.load.mass_error is not None
    assert found.load.mass == pytest.approx(MASS, abs=3 * found.load.mass_error)
    assert [source for source, _, _ in found.load.stretches] == ["second.csv"]
    assert [alarm.id for alarm in found.headline.alarms] == ["logs-disagree"]
    assert missing(found).startswith("The robot carries a load of 0.6")


def test_a_measured_log_that_goes_on_with_a_load_of_2805_g():
    """Two measured logs of a UR10e, one after the other in one file."""
    if not (folder := os.environ.get("FRISCHID_DATA")):
        pytest.skip("FRISCHID_DATA is not set")
    data = Path(folder) / "ur10e"
    robot = fr.Robot.load(data / "ur10e.urdf")
    gains = np.array([11.97, 11.98, 9.84, 10.75, 10.69, 10.68])  # N·m/A
    names = "unloaded_50s_14harm", "loaded_2805g_50s_14harm"
    parts = [fr.read_log(data / "logs" / f"{name}.parquet", robot.joints) for name in names]
    rows = [slice(None, len(part.t) // 2) for part in parts]
    t = [part.t[own] - part.t[0] for part, own in zip(parts, rows, strict=True)]
    q, v, current = (
        np.concatenate([getattr(part, name)[own] for part, own in zip(parts, rows, strict=True)])
        for name in ("q", "v", "current")
    )
    t = np.concatenate([t[0], t[1] + t[0][-1] + 2.0])
    log = fr.Log(t, robot.joints, q, v=v, tau=current * gains, source="in_one.csv")
    found = fr.diagnose(fr.identify(robot, [log], recursion="none").model, [log])
    assert found.load is not None
    assert found.load.mass == pytest.approx(2.805, rel=0.03)
    ((_, start, _),) = found.load.stretches
    assert start == pytest.approx(float(t[len(parts[0].t) // 2]), abs=1.0)
    assert found.findings[0].effect == "hysteresis"


@pytest.mark.parametrize("effects", ["", "joint_spring@joint2"])
def test_an_arm_that_carries_nothing_has_no_load(effects):
    assert diagnosed(recorded(0.0, 0.0, effects)).load is None


@pytest.mark.parametrize(("shape", "seed"), [("steady", 4), ("swelling", 4), ("steady", 6), ("swelling", 8)])
def test_a_push_is_no_load(shape, seed):
    """Seed 6 had a load of 0.83 ± 0.17 kg."""
    log = recorded(0.0, 0.0, seed=seed)
    t = log.t - log.t[0]
    inside = (t > 8.0) & (t < 9.5)
    size = np.where(inside, 1.0 if shape == "steady" else np.sin(np.pi * (t - 8.0) / 1.5), 0.0)
    found = diagnosed(replace(log, tau=log.tau + size[:, None] * [8.0, 3.0], source="pushed"))
    assert found.load is None


def test_a_joint_that_moves_only_as_the_load_is_taken_cannot_be_judged():
    """The fit without the moment of the change had ended the command: "joint1 never moves"."""
    log, rng = recorded(8.0, 14.0), np.random.default_rng(4)
    t = log.t - log.t[0]
    part = np.clip((t - 7.65) / 0.7, 0.0, 1.0)
    q = np.column_stack([0.3 + 0.4 * (part - np.sin(2 * np.pi * part) / (2 * np.pi)), log.q[:, 1]])
    v = np.gradient(q, t, axis=0)
    a = np.gradient(v, t, axis=0)
    columns, own = Regressor(ARM, fr.BASELINE), BODY | SIZES
    values = [[(own | more).get(c.name, 0.0) for c in columns.columns] for more in ({}, HEAVIER)]
    bare, loaded = (np.array(theta) @ columns(t, q, v, a) for theta in values)
    carried = (t >= 8.0) & (t < 14.0)
    tau = np.where(carried[:, None], loaded, bare) + NOISE * rng.normal(size=q.shape)
    log = replace(log, q=q + 1e-6 * rng.normal(size=q.shape), tau=tau)
    model = fr.identify(ARM, [log], recursion="none", cutoff=4.0).model
    assert fr.diagnose(model, [log]).load is None


def test_the_margin_is_the_reach_of_the_filter():
    reach = reach_of_a_step(LowPass(5.0))
    taps = LowPass(5.0).taps(0.01)
    assert reach == pytest.approx(0.01 * (len(taps) // 2), abs=0.01)
    assert wider([("a.csv", 1.0, 2.0)], reach) == [("a.csv", 1.0 - reach, 2.0 + reach)]
    assert reach_of_a_step(LowPass(None)) == 0.0
