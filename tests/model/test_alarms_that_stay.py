"""The alarms of a fit stay with the model: on test logs, and after a step that fits nothing."""

import pytest

import frischid as fr
from frischid.model.headline import alarms_of_fit, headline_of


@pytest.fixture(scope="module")
def short():
    """A model with a severe alarm, since its log lasts 3 s; the log, and a test log."""
    robot = fr.Robot.load("planar2")
    logs = [
        fr.simulate(robot, fr.random_fourier(robot, s, seed=k), rate=100.0, noise=fr.Noise(tau=0.02), seed=k)
        for k, s in enumerate((3.0, 10.0))
    ]
    model = fr.identify(robot, logs[:1], recursion="none").model
    assert "log-too-short" in ids(alarms_of_fit(model.history))
    return model, *logs


def ids(alarms):
    return [alarm.id for alarm in alarms]


def test_an_added_effect_has_the_alarms_of_its_fit_with_and_without_a_test_log(short):
    model, fit, test = short
    effect = fr.parse_effects("joint_spring@joint2")
    for valid in ([], [test]):
        step = fr.add(model, effect, [fit], valid=valid)
        assert "log-too-short" in ids(step.headline.alarms)
        assert step.headline.grade == "–"
        assert headline_of(step.model.history[-1]).alarms == step.headline.alarms
    assert step.headline.alarms == fr.headline(step.model, [test]).alarms


def test_improve_has_the_alarms_of_the_fit_on_a_test_log(short):
    model, fit, test = short
    _, last = fr.improve(model, [fit], valid=[test], max_steps=0)
    assert "log-too-short" in ids(last.headline.alarms)


def test_physical_links_keep_the_alarms_of_the_fit(short):
    model, fit, test = short
    physical = fr.make_consistent(model).model
    assert "log-too-short" in ids(alarms_of_fit(physical.history))
    for logs in ([test], [fit]):
        assert fr.headline(physical, logs).grade == "–", "on a test log, and on its own"
