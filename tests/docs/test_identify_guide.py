"""What the guide to identification says of the reference and of its alarms is true."""

from pathlib import Path

import pytest

import frischid as fr
from frischid.model.alarms import AlarmCriteria

GUIDE = (Path(__file__).parents[2] / "docs" / "guides" / "identify.md").read_text(encoding="utf-8")


def test_the_urdf_with_fitted_friction_has_no_added_effect():
    assert "Added effects are not in it." in GUIDE
    robot, spring = fr.Robot.load("planar2"), fr.parse_effects("joint_spring@joint2")
    effects = (*fr.BASELINE, *spring)
    logs = [
        fr.simulate(
            robot, fr.random_fourier(robot, 8.0, seed=k), rate=50.0, effects=effects, parameters={"ks2": 3.0},
            noise=fr.Noise(tau=0.01), seed=k,
        )
        for k in (1, 2)
    ]  # fmt: skip
    model = fr.identify(robot, logs[:1], effects=fr.BASELINE, recursion="none").model
    step = fr.add(model, spring, logs[:1], valid=logs[1:])
    assert step.error_after < 0.5 * step.error_before
    assert step.headline.urdf_nrmse == pytest.approx(fr.headline(model, logs[1:]).urdf_nrmse, rel=1e-3)


def test_the_guide_states_the_factors_of_the_alarm_on_the_urdf():
    criteria = AlarmCriteria()
    (line,) = [line for line in GUIDE.splitlines() if line.startswith("| `worse-than-urdf`")]
    assert f"{criteria.worse_than_urdf:g} times that of the URDF" in line
    assert f"{criteria.above_noise:g} times the noise floor" in line
