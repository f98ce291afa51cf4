"""Alarms of parameters that no robot can have say what the model in hand has."""

from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.cli.pages.exporting import alarms_of
from frischid.core.types import Column
from frischid.forward.forward_dynamics import ForwardDynamics
from frischid.model.alarms import Alarm, AlarmCriteria
from frischid.model.headline import alarms_of_fit
from frischid.model.joint_inertia import drawn_poses, least_inertia, mass_matrices
from frischid.model.physical_alarms import INERTIA, SIGN, as_one, indefinite_mass, remedy, wrong_signs

CRITERIA = AlarmCriteria()


def by_id(alarms):
    return {alarm.id: alarm for alarm in alarms}


def identified(rotor, **choices):
    """A model of planar2 whose second joint has a rotor inertia that no robot can have, and a test log."""
    robot = fr.Robot.load("planar2")
    logs = [
        fr.simulate(
            robot, fr.random_fourier(robot, 10.0, seed=seed), rate=100.0, parameters={"Ia2": rotor},
            effects=fr.BASELINE, noise=fr.Noise(tau=0.01), seed=seed,
        )
        for seed in (1, 2)
    ]  # fmt: skip
    return fr.identify(robot, logs[:1], valid=logs[1:], recursion="none", **choices), logs[1]


def test_friction_that_leads_the_motion_is_no_inertia():
    robot = fr.Robot.load("planar2")
    effects = fr.parse_effects("viscous, coulomb(width=0.01, lead=0.01)")
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=200.0, parameters={"fc1": 2.0, "fc2": 1.0})
    model = fr.identify(robot, [log], effects=effects, recursion="none").model
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (20, 2))
    np.testing.assert_allclose(mass_matrices(model, (q, {})), fr.ForwardDynamics(model).mass_matrix(q), rtol=1e-9)


@pytest.fixture(scope="module")
def negative():
    return identified(-1.0)


@pytest.mark.parametrize(
    ("value", "said"), [(-0.0888, "Ia4 = -0.0888 kg·m² (5.3 s.e.)."), (0.0, "Ia4, held at 0 (5.3 s.e.).")]
)
def test_the_alarm_of_a_sign_says_what_the_model_has(value, said):
    column = Column("Ia4", "kg·m²", "elbow", "rotor_inertia", 1)
    (alarm,) = wrong_signs([("Ia4", 5.3)], CRITERIA, {"Ia4": (column, value)})
    assert alarm.sentence.endswith(f": {said}")
    assert alarm.joints == ("elbow",)


def test_the_alarm_of_a_fit_gives_the_values_that_the_model_has(negative):
    found, _ = negative
    alarm = by_id(found.alarms)[SIGN]
    value = found.model.parameters["Ia2"].value
    assert value < -0.5
    assert f"Ia2 = {value:.3g} kg·m² (" in alarm.sentence


def test_a_model_without_a_positive_mass_matrix_has_an_alarm_that_no_error_hides(negative):
    found, test = negative
    assert INERTIA not in by_id(found.alarms), "the rotor of impossible sign is why: one alarm says both"
    for alarm in (by_id(found.alarms)[SIGN], by_id(fr.headline(found.model, [test]).alarms)[SIGN]):
        assert alarm.severity == "doubt"
        assert "not positive definite" in alarm.sentence
        assert "of the fitted poses, mostly because of joint2." in alarm.sentence
        assert "then look for a missing effect (frischid diagnose). To simulate, identify without" in alarm.remedy
    q = test.q[:50]
    with pytest.raises(fr.InputError, match=r"least eigenvalue is .* kg·m², mostly of joint2, at joint2 = .* rad"):
        ForwardDynamics(found.model).require_inertia(q)


def test_the_remedy_gives_a_model_that_can_be_simulated(negative):
    """The logs put the rotor clearly below zero: physical links keep it there, so it must go first."""
    found, test = negative
    physical = fr.make_consistent(found.model).model
    told = by_id(alarms_of_fit(physical.history))[SIGN].sentence
    assert "Ia2" in told
    assert "not positive definite" in told
    for model in (found.model, physical):
        assert "--effects 'viscous, coulomb(" in remedy(model)
        assert "rotor_inertia(" not in remedy(model).split("--effects")[1]
    model = found.model
    others = [effect for effect in model.effects if effect.id != "rotor_inertia"]
    again = fr.identify(model.robot, [test], effects=others, recursion="none").model
    again = fr.make_consistent(again).model
    assert not any("positive definite" in alarm.sentence for alarm in alarms_of_fit(again.history))
    ForwardDynamics(again).require_inertia(drawn_poses(model.robot)[0])


def test_a_mass_matrix_that_no_sign_explains_has_an_alarm_of_its_own(negative):
    found, _ = negative
    least = least_inertia(found.model, [drawn_poses(found.model.robot)])
    (matrix,) = indefinite_mass(found.model, least, "poses", CRITERIA)
    assert (matrix.id, matrix.joints, matrix.value < 0.0) == (INERTIA, ("joint2",), True)
    column = Column("Ia1", "kg·m²", "joint1", "rotor_inertia", 1)
    signs = wrong_signs([("Ia1", 5.3)], CRITERIA, {"Ia1": (column, -0.1)})
    assert as_one([], [matrix]) == [matrix]
    assert as_one(signs, []) == signs
    (both,) = as_one(signs, [matrix])
    assert both.id == SIGN
    assert matrix.sentence in both.sentence


def test_an_ordinary_model_has_neither_alarm():
    found, _ = identified(0.2)
    assert not {SIGN, INERTIA} & set(by_id(found.alarms))


def test_the_mass_matrix_is_that_of_the_simulation():
    found, test = identified(0.2)
    q = test.q[::20]
    assert np.allclose(mass_matrices(found.model, (q, {})), ForwardDynamics(found.model).mass_matrix(q), atol=1e-9)
    least = least_inertia(found.model, [(q, {}), (q[:1], {})])
    assert least.share == 0.0
    assert least.value > 0.0


def test_a_page_without_a_log_says_on_which_log_an_alarm_was_raised(negative):
    found, _ = negative
    event = dict(found.model.history[-1])
    other = Alarm("extrapolation", "doubt", "The motion of these logs goes beyond.", "Identify again.")
    event["test"] = {
        **event["test"],
        "logs": ["folder/fast.csv"],
        "alarms": [*event["test"]["alarms"], other.to_dict()],
    }
    model = replace(found.model, history=(event,))
    alarms = by_id(alarms_of(model))
    assert alarms["extrapolation"].sentence == "In the test on fast.csv: The motion of these logs goes beyond."
    assert alarms[SIGN].sentence == by_id(found.alarms)[SIGN].sentence
