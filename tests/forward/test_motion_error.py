"""The error of a simulated motion: exact models make none, and wrong ones make the error that physics says."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cases import robot

import frischid as fr
from frischid.errors import InputError
from frischid.forward.motion_error import compare_simulated
from frischid.forward.torque_sources import RecordedTorque, TorqueFunction
from frischid.robot.kinematic_tree import tip_joint, tip_positions

SMOOTH = fr.parse_effects("viscous, offset, rotor_inertia")


@cache
def made(noise=1e-4):
    machine = robot("planar2")
    logs = [
        fr.simulate(
            machine, fr.random_fourier(machine, 4.0, seed=s), rate=200.0, effects=SMOOTH, noise=fr.Noise(tau=noise)
        )
        for s in (1, 2)
    ]
    return fr.identify(machine, logs[:1], effects=SMOOTH, recursion="none").model, logs


def test_a_true_model_moves_as_the_robot():
    model, logs = made()
    found = compare_simulated(model, logs[1:], horizons=[0.1, 0.5, 100.0])
    assert [h.horizon for h in found.horizons] == [0.1, 0.5]
    assert all(h.tip < 1.0 for h in found.horizons)
    assert all(h.starts == 40 for h in found.horizons)
    assert found.whole.horizon is None
    assert found.sources == (logs[1].source,)


def test_a_force_that_the_model_lacks_grows_with_the_square_of_time():
    model, logs = made()
    wrong = model.estimate.theta.copy()
    wrong[[c.name for c in model.estimate.columns].index("off2")] += 0.5
    other = replace(model, estimate=replace(model.estimate, theta=wrong), standard=None)
    found = compare_simulated(other, logs[1:], horizons=[0.05, 0.1])
    ratio = found.horizons[1].joints["joint2"] / found.horizons[0].joints["joint2"]
    assert ratio == pytest.approx(4.0, rel=0.15)


def test_plain_values_hold_every_figure():
    model, logs = made()
    data = compare_simulated(model, logs[1:], horizons=[0.1]).to_dict()
    assert set(data) == {"horizons", "whole", "tip_joint", "logs", "closed_loop"}
    assert set(data["horizons"][0]["joints"]) == set(model.robot.joints)


def test_an_unstable_simulation_is_infinite_and_null_in_json():
    model, logs = made()
    blow = TorqueFunction(lambda t, q, v: 1e6 * q + 1e5 * v)
    found = compare_simulated(model, logs[1:], horizons=[0.5], sources=[blow])
    assert np.isinf(found.horizons[0].tip)
    assert found.to_dict()["horizons"][0]["tip_mm"] is None
    assert found.closed


def test_horizons_that_end_at_the_same_sample_have_the_same_error():
    """Before, "the times of a simulated motion must begin with 0 and increase"."""
    model, logs = made()
    found = compare_simulated(model, logs[1:], horizons=[0.1, 0.101, 0.2])
    assert [h.horizon for h in found.horizons] == [0.1, 0.101, 0.2]
    assert found.horizons[0].tip == found.horizons[1].tip < found.horizons[2].tip


def test_a_recorded_torque_is_no_controller():
    model, logs = made()
    source = RecordedTorque(logs[1].t, logs[1].tau)
    found = compare_simulated(model, logs[1:], horizons=[0.1], sources=[source])
    assert not found.closed


def test_horizons_longer_than_the_log_are_an_error():
    model, logs = made()
    with pytest.raises(InputError, match="longer than the shortest horizon"):
        compare_simulated(model, logs[1:], horizons=[60.0])
    with pytest.raises(InputError, match="positive"):
        compare_simulated(model, logs[1:], horizons=[-1.0])


def test_the_tip_of_a_planar_arm_is_on_a_circle():
    machine = robot("planar2")
    assert tip_joint(machine) == "joint2"
    q = np.column_stack([np.linspace(-2, 2, 9), np.zeros(9)])
    reach = np.linalg.norm(tip_positions(machine, q), axis=1)
    np.testing.assert_allclose(reach, reach[0])


def late(log, by):
    """The log with a torque that was recorded `by` seconds late."""
    acted = fr.RecordedTorque(log.t + by, log.tau)
    return replace(log, tau=acted.torque(log.t, log.q, log.q))


@cache
def models_of_a_late_record():
    """Models of a record that is 2.5 ms late: as recorded, and in time."""
    model, (log, _) = made()
    options = {"effects": SMOOTH, "recursion": "none", "cutoff": 10.0}
    return [fr.identify(model.robot, [late(log, 0.0025)], torque_lag=x, **options).model for x in (0.0, 0.0025)]


def tip_after_half_a_second(model, log):
    return compare_simulated(model, [log], horizons=[0.5]).horizons[0].tip


def test_a_torque_that_was_recorded_late_acts_earlier():
    """The lag that the model takes back is taken back in the simulation too: nothing of its error is left."""
    model, (_, test) = made()
    clean = tip_after_half_a_second(model, test)
    as_recorded, in_time = (tip_after_half_a_second(m, late(test, 0.0025)) for m in models_of_a_late_record())
    assert in_time < 0.3 * as_recorded
    assert in_time < 2 * clean + 0.1


def test_a_fit_of_the_motion_reads_a_late_torque_in_time():
    _, (log, test) = made()
    options = fr.OutputErrorOptions(horizon=0.5, rounds=1, iterations=3)
    fitted = [fr.output_error(m, [late(log, 0.0025)], options=options).model for m in models_of_a_late_record()]
    as_recorded, in_time = (tip_after_half_a_second(m, late(test, 0.0025)) for m in fitted)
    assert in_time < 0.3 * as_recorded


def test_the_stamps_of_a_late_record_are_moved_in_a_simulation_of_ones_own():
    _, (_, test) = made()
    model, recorded = models_of_a_late_record()[1], late(test, 0.0025)
    start = fr.Starts(test.q[100:101], test.v[100:101], test.t[100:101])
    as_recorded, in_time = (
        fr.ForwardDynamics(model).simulate(fr.RecordedTorque(recorded.t - d, recorded.tau), start, np.array([0.0, 0.5]))
        for d in (0.0, model.lowpass.torque_lag)
    )
    off = [np.linalg.norm(x.q[0, 1] - test.q[200]) for x in (as_recorded, in_time)]
    assert off[1] < 0.3 * off[0]
