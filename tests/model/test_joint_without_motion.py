"""A joint that never moves has no cross-validated error, and an alarm says so."""

import numpy as np

import frischid as fr
from frischid.cli.pages.fitting import cross_validation


def test_a_joint_that_never_moves_is_no_perfect_joint():
    robot = fr.Robot.load("ur5")
    moving = robot.keep([name for name in robot.joints if name != "wrist_2_joint"])
    log = fr.simulate(moving, fr.random_fourier(moving, 20.0, seed=1), rate=50.0, noise=fr.Noise(tau=0.01))
    k, rng = robot.joints.index("wrist_2_joint"), np.random.default_rng(1)
    q, tau = np.insert(log.q, k, 0.3, axis=1), np.insert(log.tau, k, rng.normal(0.0, 0.01, len(log.t)), axis=1)
    found = fr.identify(robot, [fr.Log(t=log.t, joints=robot.joints, q=q, tau=tau)], recursion="none")
    assert "wrist_2_joint" not in found.cross_validation
    assert "wrist_2_joint –," in cross_validation(found)
    assert "(–: never moves)" in cross_validation(found)
    (alarm,) = [alarm for alarm in found.alarms if alarm.id == "joint-without-motion"]
    assert alarm.joints == ("wrist_2_joint",)
    assert alarm.severity == "doubt"
