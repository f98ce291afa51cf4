"""Results beside their object: computed once, and gone with the object."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.core.remembered import KEYS_KEPT, Remembered
from frischid.logs import recording
from frischid.model import noise_floor


class Thing:
    """An object."""


def test_a_result_is_computed_once_for_each_object_and_key() -> None:
    known, asked = Remembered[int](), []

    def number() -> int:
        asked.append(1)
        return len(asked)

    one, other = Thing(), Thing()
    assert [known.of(x, key, number) for x in (one, other, one) for key in "ab"] == [1, 2, 3, 4, 1, 2]


def test_an_object_keeps_its_last_keys_only() -> None:
    known, thing = Remembered[object](), Thing()
    first = weakref.ref(known.of(thing, 0, Thing))
    for key in range(1, KEYS_KEPT + 1):
        known.of(thing, key, Thing)
    gc.collect()
    assert first() is None


def test_a_result_goes_with_its_object() -> None:
    known, thing = Remembered[Thing](), Thing()
    result = weakref.ref(known.of(thing, 0, Thing))
    del thing
    gc.collect()
    assert result() is None


def test_an_error_is_not_kept() -> None:
    known, thing = Remembered[int](), Thing()
    with pytest.raises(ZeroDivisionError):
        known.of(thing, 0, lambda: 1 // 0)
    assert known.of(thing, 0, lambda: 7) == 7


def arm_and_log() -> tuple[fr.Robot, fr.Log]:
    robot = fr.Robot.load("planar2")
    return robot, fr.simulate(robot, fr.random_fourier(robot, 8, seed=1), rate=100, noise=fr.Noise(q=1e-5, tau=0.01))


def test_everything_that_is_remembered_of_a_log_equals_what_is_computed_anew() -> None:
    """The same arrays as a log of its own each time: motions, noise floor, alarms, and what a diagnosis finds."""
    robot, log = arm_and_log()
    spring = fr.parse_effects("joint_spring@joint2")

    def steps(fresh: bool) -> list[object]:
        def one() -> fr.Log:
            return replace(log) if fresh else log

        model = fr.identify(robot, [one()], recursion="none").model
        found = fr.diagnose(model, [one()], effects=["joint_spring", "hysteresis"])
        step = fr.add(model, spring, [one()])
        errors = fr.compare(step.model, [one()])
        return [model.to_dict(), found.to_dict(), step.model.to_dict(), errors.to_dict()]

    assert steps(fresh=True) == steps(fresh=False) == steps(fresh=False)


def test_a_log_is_prepared_once_and_its_noise_followed_once_per_model(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, log = arm_and_log()
    prepared, followed = [], []
    prepare, through = recording.prepare, noise_floor._through_the_motion
    monkeypatch.setattr(recording, "prepare", lambda *a, **k: prepared.append(1) or prepare(*a, **k))
    monkeypatch.setattr(noise_floor, "_through_the_motion", lambda *a: followed.append(1) or through(*a))
    model = fr.identify(robot, [log], recursion="none").model
    for _ in range(3):
        fr.compare(model, [log])
    assert (len(prepared), len(followed)) == (1, 1)
    fr.compare(fr.add(model, fr.parse_effects("joint_spring@joint2"), [log]).model, [log])
    assert (len(prepared), len(followed)) == (1, 2)


def test_nobody_can_write_into_a_motion_that_is_remembered() -> None:
    robot, log = arm_and_log()
    model = fr.identify(robot, [log], recursion="none").model
    (motion,) = model.motions([log])
    with pytest.raises(ValueError, match="read-only"):
        motion.q[0] = np.inf
