import numpy as np
import pytest
from click.testing import CliRunner

from frischid.cli import main
from frischid.effects import BASELINE, parse_effects
from frischid.errors import IdentifiabilityError, InputError
from frischid.motions.discrimination import _lost, separate
from frischid.motions.plan_options import PlanOptions
from frischid.robot.robot import Robot

PLANAR = Robot.load("planar2")


def test_the_planned_motion_distinguishes_two_effects_better_than_random_ones():
    spring, gain = parse_effects("joint_spring@joint2, drive_gain@joint2")
    apart = separate(PLANAR, spring, gain, options=PlanOptions(duration=10.0, budget=2000))
    assert apart.sharper > 1.2
    assert 0 <= apart.correlation < 0.999
    assert not apart.plan.violations


def test_effects_that_no_motion_distinguishes_are_refused():
    payload, spring = parse_effects("payload@joint2, joint_spring@joint2")
    with pytest.raises(IdentifiabilityError, match="no motion can distinguish payload"):
        separate(PLANAR, payload, spring, options=PlanOptions(budget=100))
    with pytest.raises(InputError, match="same effect"):
        separate(PLANAR, spring, spring, options=PlanOptions(budget=100))
    with pytest.raises(InputError, match="in the model already"):
        separate(PLANAR, BASELINE[0], spring, options=PlanOptions(budget=100))


def test_an_effect_that_contains_the_other_is_told_by_what_it_has_beside():
    spring, hose = parse_effects("joint_spring@joint2, cable_hose@joint2")
    for pair, budget in (((spring, hose), 3000), ((hose, spring), 10)):
        apart = separate(PLANAR, *pair, options=PlanOptions(budget=budget))
        assert (apart.first, apart.second) == (str(spring), str(hose))
        assert apart.shared == ("kh2",)
        if budget > 1000:
            assert apart.sharper > 1.1
            assert 0.1 < apart.correlation < apart.typical < 1


def test_columns_that_act_as_other_parameters_do_are_left_out():
    """The rotor's share of a coupled motor is an inertia of parallel links; its friction is not."""
    load, coupled = parse_effects("load_friction@joint1, joint_coupling@joint1+joint2")
    assert _lost(PLANAR, BASELINE, coupled)
    for pair in ((load, coupled), (coupled, load)):
        apart = separate(PLANAR, *pair, options=PlanOptions(duration=8.0, budget=60))
        assert apart.shared == ()
        assert 0 <= apart.correlation < 0.999


def test_the_command_line_writes_the_motion(tmp_path):
    pair = ["--separate", "stribeck@joint2,hysteresis@joint2"]
    out = str(tmp_path / "motion.npz")
    run = ["excite", "planar2", "-o", out, "--duration", "5", "--budget", "300"]
    done = CliRunner().invoke(main, [*run, *pair])
    assert done.exit_code == 0, done.output
    assert "times smaller than on a random motion" in " ".join(done.output.split())
    assert np.load(out)["t"][-1] == pytest.approx(5.0)
    refused = CliRunner().invoke(main, [*run, "--separate", "stribeck@joint2"])
    assert refused.exit_code == 2
    assert "two effects" in refused.output
