from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from cases import exact_log, misfit, quick, random_values, robot, serial_arms, true_base
from scipy.signal import lfilter

from frischid.effects import BASELINE, parse_effects
from frischid.errors import EmptyBoxError, IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators.frisch import Box
from frischid.estimators.least_squares import least_squares_folds
from frischid.logs.locked_joints import moving_but_locked
from frischid.logs.log import Log
from frischid.logs.summary import summarise
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.model.identification_bounds import without_information
from frischid.model.identify_options import ESTIMATORS
from frischid.model.log_examination import check
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.moments import Gram
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

PLANAR, UR10 = robot("planar2"), robot("ur10")
VALUES = random_values(PLANAR, BASELINE)
WITH_ROTORS = parse_effects("viscous,coulomb,rotor_inertia(coupled=true,ratio=0.1)")


def planar_log(seed=1, seconds=20.0, rate=100.0, **options):
    return exact_log(PLANAR, BASELINE, VALUES, seconds, rate, seed, **options)


def joined(first, second, pause):
    """One log of two recordings with `pause` seconds between them."""
    t = np.concatenate([first.t, first.t[-1] + pause + second.t])
    return Log(t, first.joints, np.concatenate([first.q, second.q]), tau=np.concatenate([first.tau, second.tau]))


# ---- logs without noise


@pytest.mark.parametrize("prior", ["none", "urdf"])
def test_a_log_of_a_simulation_without_noise_is_exact(prior):
    log = simulate(UR10, random_fourier(UR10, 30.0, seed=1), rate=200.0)
    found = identify(UR10, [log], recursion="none", prior=prior)
    assert found.model.estimate.covariance.diagonal().min() > 0
    np.testing.assert_array_less(0.0, np.linalg.eigvalsh(found.model.estimate.information))
    assert found.headline.nrmse < 1e-3


# ---- several logs


def test_several_logs_are_one_identification_and_never_glued():
    logs = [planar_log(seed, channels=()) for seed in (1, 2)]
    # the second begins where the first does not end: a derivative across the boundary would be enormous
    logs[1] = simulate(PLANAR, Moved(random_fourier(PLANAR, 20.0, seed=2)), rate=100.0, parameters=VALUES, channels=())
    assert np.abs(logs[0].q[-1] - logs[1].q[0]).max() > 0.3
    two = quick(PLANAR, logs, cutoff=5.0)
    gap = quick(PLANAR, [joined(*logs, pause=3.0)], cutoff=5.0)
    assert two.samples == gap.samples
    np.testing.assert_allclose(two.model.estimate.theta, gap.model.estimate.theta, rtol=1e-5, atol=1e-6)
    assert misfit(two, true_base(two, VALUES)) < 1e-3
    glued = quick(PLANAR, [joined(*logs, pause=0.01)], cutoff=5.0)
    assert misfit(glued, true_base(glued, VALUES)) > 10 * misfit(two, true_base(two, VALUES))


class Moved:
    """A motion with its joints elsewhere."""

    def __init__(self, motion):
        self.motion, self.duration = motion, motion.duration

    def __call__(self, t):
        q, v, a = self.motion(t)
        return q + 0.5, v, a


def test_order_of_logs_does_not_matter():
    logs = [planar_log(seed, noise=Noise(tau=0.05)) for seed in (1, 2, 3)]
    first, second = (quick(PLANAR, x, cutoff=5.0, prior="none") for x in (logs, logs[::-1]))
    np.testing.assert_allclose(first.model.estimate.theta, second.model.estimate.theta, rtol=1e-9)
    np.testing.assert_allclose(first.model.estimate.covariance, second.model.estimate.covariance, rtol=1e-6, atol=1e-18)
    assert first.samples == second.samples
    # folds of the cross-validation that bounds the noise are stretches in order: they are others, if hardly
    first, second = (quick(PLANAR, x, cutoff=5.0) for x in (logs, logs[::-1]))
    np.testing.assert_allclose(first.model.estimate.theta, second.model.estimate.theta, rtol=1e-2)


def test_more_logs_give_smaller_errors():
    motions = [random_fourier(PLANAR, 20.0, seed=s) for s in range(8)]
    noise = Noise(tau=0.05)
    logs = [simulate(PLANAR, m, rate=100.0, parameters=VALUES, noise=noise, seed=s) for s, m in enumerate(motions)]
    one, eight = (quick(PLANAR, x, cutoff=5.0, prior="none") for x in (logs[:1], logs))
    assert np.median(eight.model.estimate.stderr / one.model.estimate.stderr) < 0.6


# ---- joints


def test_joints_a_log_does_not_hold_are_locked_and_said():
    held = [j for j in UR10.joints if j != "elbow_joint"]
    smaller = UR10.keep(held)
    log = exact_log(smaller, BASELINE, random_values(smaller, BASELINE))
    found = quick(UR10, [log])
    assert found.model.robot.locked == {"elbow_joint": 0.0}
    assert any(
        n == "locked at 0 rad (m) (not every log has the position; --lock JOINT=ANGLE sets another angle): elbow_joint"
        for n in found.notes
    )
    assert max(found.cross_validation.values()) < 1e-5
    # one log of two is enough
    both = quick(UR10, [exact_log(UR10, BASELINE), log])
    assert "elbow_joint" in both.model.robot.locked


def test_locks_from_the_logs_keep_the_links_of_known_parameters_and_frames():
    """Without the shoulder, m3 is a link of the wrist: it had been known of this link."""
    arm = Robot.load("ur10", known={"m3": 12.0})
    log = exact_log(arm, BASELINE).select(arm.joints[1:])
    with pytest.raises(InputError, match=r"m3 would be known of another link: give --lock shoulder_pan_joint"):
        identify(arm, [log], recursion="none")
    links = dict(zip(arm.joints, ("shoulder_link", "upper_arm_link"), strict=False))
    framed = quick(Robot.load("ur10", frames=links), [log]).model.robot
    assert framed.frames == {"shoulder_lift_joint": "upper_arm_link"}


def test_columns_of_the_log_in_another_order():
    log = exact_log(UR10, BASELINE, random_values(UR10, BASELINE))
    first, second = quick(UR10, [log]), quick(UR10, [log.select(log.joints[::-1])])
    np.testing.assert_allclose(first.model.estimate.theta, second.model.estimate.theta, rtol=1e-9)


def standing_at(angle, seed=1):
    """A log of the planar arm whose first joint stands at an angle."""
    arm = Robot.load("planar2", lock={"joint1": angle})
    log = exact_log(arm, BASELINE, seed=seed, noise=Noise(tau=0.01))
    wide = {c: np.column_stack([np.full(len(log), x), getattr(log, c)[:, 0]]) for c, x in (("q", angle), ("tau", 0.0))}
    return replace(log, joints=("joint1", "joint2"), v=None, a=None, source=f"at {angle}", **wide)


def test_a_joint_that_not_every_log_holds_is_locked_where_another_log_says():
    log = standing_at(1.0)
    found = quick(PLANAR, [log, replace(standing_at(1.0, 2).select(["joint2"]), source="short")])
    assert found.model.robot.locked == {"joint1": pytest.approx(1.0)}
    assert not any("gravity" in warning for warning in found.warnings)


def test_a_lock_that_contradicts_the_log_is_said_with_the_right_one():
    log = standing_at(1.0)
    (said,) = (w for w in quick(Robot.load("planar2", lock={"joint1": 0.0}), [log]).warnings if "is locked at" in w)
    assert said == (
        "joint1 is locked at 0 and stands at 1 rad (m) in a log; lock where the log says (--lock joint1=1), or correct "
        "the position column"
    )
    (report,) = check(Robot.load("planar2", lock={"joint1": 0.0}), [log])
    assert "locked joint elsewhere" in [issue.kind for issue in report.issues]
    for right in (1.0, 1.0 + 2 * np.pi):
        robot = Robot.load("planar2", lock={"joint1": right})
        assert not any("is locked at" in w for w in quick(robot, [log]).warnings)
        assert check(robot, [log])[0].issues == ()


def test_a_whole_turn_of_a_sliding_joint_is_another_place():
    """Before, a slide that was locked at 0 m and stood at 6.28 m counted as being at its lock."""
    rail = PLANAR.urdf.replace('<joint name="joint1" type="revolute">', '<joint name="joint1" type="prismatic">')
    robot = replace(PLANAR, urdf=rail, locked={"joint1": 0.0})
    for place, said in ((0.0, []), (2 * np.pi, ["locked joint elsewhere"])):
        (report,) = check(robot, [standing_at(place)])
        assert [issue.kind for issue in report.issues if "lock" in issue.kind] == said


def test_a_joint_that_moves_and_is_missing_from_another_log_has_a_remedy_that_works():
    log, other = planar_log(), planar_log(seed=2)
    short = replace(other.select(["joint1"]), source="short")
    found = quick(PLANAR, [log, short])
    (said,) = (w for w in found.warnings if w.startswith("locked but moving"))
    assert said.endswith("joint2: short has no position; leave that log out, or record q_joint2 there too")
    with pytest.raises(InputError, match=r"no joint of the robot is in all logs.*holds joint2; short holds joint1"):
        quick(PLANAR, [log.select(["joint2"]), short])


def test_a_locked_joint_may_move_by_three_degrees():
    robot = Robot.load("ur10", lock=["elbow_joint"])
    log = exact_log(UR10, BASELINE)
    column = log.joints.index("elbow_joint")
    for travel, expected in ((0.045, {}), (0.055, {"elbow_joint": pytest.approx(0.055)})):
        q = np.array(log.q)
        q[:, column] = np.linspace(0.2, 0.2 + travel, len(q))
        assert summarise(robot, [replace(log, q=q)], robot.joints).locked.moving == expected


def test_locked_joints_that_move_are_one_warning():
    assert moving_but_locked({}) == []
    (said,) = moving_but_locked({"torso": 0.32, "elbow": 1.8})
    assert said.startswith("locked but moving in a log: torso by 0.32 rad (m), elbow by 1.8 rad (m); let them move")


def test_torque_joints():
    log = planar_log(noise=Noise(tau=0.01))
    found = quick(PLANAR, [log], torque_joints=["joint2"])
    assert found.model.joints == ("joint2",)
    assert list(found.cross_validation) == ["joint2"]
    assert found.reduction.rank < quick(PLANAR, [log]).reduction.rank
    assert "torque rows left out: joint1 (they move, their torque is not fitted)" in found.notes
    with pytest.raises(UnknownNameError, match=r"unknown joint 'joint3'.*joint1, joint2"):
        quick(PLANAR, [log], torque_joints=["joint3"])


def test_joints_without_a_torque_channel_are_left_out_and_said():
    log = planar_log()
    tau = log.tau.copy()
    tau[:, 0] = np.nan
    found = quick(PLANAR, [replace(log, tau=tau)])
    assert found.model.joints == ("joint2",)
    assert any("no torque channel for joint1" in n for n in found.notes)
    with pytest.raises(InputError, match="no torque for joint1"):
        identify(PLANAR, [replace(log, tau=tau)], torque_joints=["joint1", "joint2"])


@pytest.mark.parametrize(("value", "said"), [(0.0, "is zero throughout"), (3.5, "never changes while the joint moves")])
def test_dead_torque_names_the_option(value, said):
    log = planar_log()
    tau = log.tau.copy()
    tau[:, 1] = value
    dead = replace(log, tau=tau)
    with pytest.raises(InputError, match=f"torque of joint2 {said}.*--torque-joints"):
        quick(PLANAR, [dead])
    assert quick(PLANAR, [dead], torque_joints=["joint1"]).model.joints == ("joint1",)
    (found,) = check(PLANAR, [dead])
    assert any("joint2" in w and "never changes" in w for w in found.warnings)


def test_a_joint_without_motion_and_torque_is_to_be_locked():
    """A gripper in a simulator's arrays: the error had named --torque-joints alone."""
    log = planar_log()
    q, v, a, tau = (x * np.array([1.0, 0.0]) for x in (log.q, log.v, log.a, log.tau))
    with pytest.raises(InputError, match=r"lock joint2, without motion in this log \(--lock, lock=\), or leave"):
        quick(PLANAR, [replace(log, q=q, v=v, a=a, tau=tau)])


# ---- too little


def test_no_log_and_a_log_of_another_robot():
    with pytest.raises(InputError, match="no log"):
        identify(PLANAR, [])
    with pytest.raises(InputError, match=r"share no joint.*joint1, joint2.*elbow_joint"):
        identify(PLANAR, [exact_log(UR10, ())])


def test_fewer_samples_than_parameters():
    log = exact_log(UR10, BASELINE)
    with pytest.raises(IdentifiabilityError, match=r"torque rows cannot determine \d+ parameters; record longer"):
        quick(UR10, [log.slice(100, 118)], torque_joints=["shoulder_pan_joint"], prior="none")
    estimate = quick(PLANAR, [planar_log(seconds=5.0)]).model.estimate
    with pytest.raises(IdentifiabilityError, match=r"too short to hold any of it out.*record longer"):
        least_squares_folds([Gram.zeros(estimate.columns, estimate.joints)], estimate.weights)
    with pytest.raises(InputError, match="no stretch without a gap is longer"):
        quick(UR10, [log.slice(100, 112)])


@pytest.mark.parametrize("effects", ["viscous,coulomb,offset", "viscous"])
def test_a_joint_that_never_moves_names_its_parameters(effects):
    effects = parse_effects(effects)
    log = exact_log(PLANAR, effects)
    q, v, a = log.q.copy(), log.v.copy(), log.a.copy()
    q[:, 1], v[:, 1], a[:, 1] = 0.4, 0.0, 0.0
    with pytest.raises(IdentifiabilityError, match=r"fv2.*(move|motion)"):
        quick(PLANAR, [replace(log, q=q, v=v, a=a)], effects=effects, prior="none")
    found = quick(PLANAR, [replace(log, q=q, v=v, a=a)], effects=effects)
    assert "log-leaves-open" in [alarm.id for alarm in found.alarms]


def test_parameters_that_a_motion_cannot_distinguish_are_named():
    # on an exponential, acceleration is in proportion to speed: inertia and viscous friction are one number
    t = np.arange(1000) / 100
    machine = Robot.load("planar2", joints=["joint1"], gravity=(0, 0, 0))
    q = 0.1 * np.exp(0.3 * t)[:, None]
    log = Log(t, machine.joints, q, v=0.3 * q, a=0.09 * q, tau=q + 0.01 * np.sin(9 * t)[:, None])
    with pytest.raises(IdentifiabilityError, match=r"cannot distinguish (Izz1R?, fv1|fv1, Izz1R?) "):
        quick(machine, [log], effects=parse_effects("viscous"), velocity="measured", prior="none")


def test_no_motion():
    log = planar_log()
    still = Log(log.t, log.joints, 0 * log.q, tau=log.tau)
    with pytest.raises(InputError, match="the arm stands still, at 1 pose: gravity needs at least 5 different poses"):
        identify(PLANAR, [still])
    assert "standstill" in [issue.kind for issue in check(PLANAR, [still])[0].issues]


# ---- choices


def test_unknown_choices():
    log = planar_log()
    with pytest.raises(UnknownNameError, match=r"unknown estimator 'wsl'.*wls"):
        identify(PLANAR, [log], estimator="wsl")
    with pytest.raises(InputError, match="velocity"):
        identify(PLANAR, [log], velocity="guess")
    with pytest.raises(InputError, match=r"strict.*undo|undo.*strict"):
        identify(PLANAR, [log], recursion="strickt")
    with pytest.raises(InputError, match="cut-off"):
        identify(PLANAR, [log], cutoff=-3.0)


def test_estimators_share_their_rows_and_differ_in_their_weights():
    log = exact_log(UR10, BASELINE, random_values(UR10, BASELINE), 20.0, noise=Noise(tau=0.03))
    found = {e: quick(UR10, [log], estimator=e).model.estimate for e in ESTIMATORS}
    assert found["ols"].weights.tolist() == [1.0] * 6
    np.testing.assert_allclose(found["wls"].weights, found["wls"].sigma ** -2.0, rtol=1e-3)
    assert not np.allclose(found["wls"].theta, found["ols"].theta, rtol=1e-4)


def test_frisch_picks_the_best_point_of_its_box():
    noise = Noise(q=1e-4, v=1e-3, a=1e-2, tau=0.01)
    found = quick(PLANAR, [planar_log(noise=noise)], estimator="frisch")
    assert found.selection is not None
    assert found.narrowest_box is found.model.bounds["frisch"]
    assert found.narrowest_box.contains(found.model.estimate.theta)


def test_the_headline_is_the_error_of_the_estimators_own_values():
    """Eq. (24) adds kilograms to rotor inertias: on this arm, its point predicts the wrists badly, and must say so."""
    arm = Robot.load("ur5")
    log = simulate(arm, random_fourier(arm, 20.0, seed=1), rate=100.0, noise=Noise(q=1e-4, tau=0.5))
    found = quick(arm, [log], estimator="frisch")
    own = compare(found.model, [log])
    assert own.nrmse > 0.5
    assert found.headline.nrmse == pytest.approx(own.nrmse, rel=0.1)
    assert found.headline.grade not in ("A", "B")
    _, lower, upper = found.model.predict(log.q, log.v, log.a)
    wrists = ((log.tau >= lower) & (log.tau <= upper)).mean(axis=0)[3:]
    assert wrists.min() > 0.6  # 0.04 with the band of least squares


def test_frisch_is_equation_24_and_frisch_squared_is_least_squares_in_the_box():
    log = planar_log(noise=Noise(q=1e-4, v=1e-3, a=1e-2, tau=0.05))
    printed, squared = (quick(PLANAR, [log], estimator=e) for e in ("frisch", "frisch_squared"))
    box = printed.model.bounds["frisch"]
    found = {f.model.estimate.estimator: f.model.estimate.theta for f in (printed, squared)}
    np.testing.assert_allclose(box.lower, squared.model.bounds["frisch"].lower)
    assert box.contains(found["frisch"])
    assert box.contains(found["frisch_squared"])
    # Norms that are not squared pull towards zero; the squared form does not pull at all.
    assert np.linalg.norm(found["frisch"]) < np.linalg.norm(found["frisch_squared"])


# ---- bounds


NOISY = Noise(q=5e-3, v=5e-2, a=0.5, tau=0.2)


def test_empty_box_names_parameter_and_window():
    log = planar_log(noise=NOISY)
    found = identify(PLANAR, [log], cutoff=None, window=40)
    emptied = found.recursion.emptied
    assert emptied is not None
    assert "bbrf" not in found.model.bounds
    assert isinstance(found.narrowest_box, Box)
    words = f"at window {emptied.window}: parameter {emptied.parameter} has lower bound"
    assert any(words in note for note in found.notes)
    with pytest.raises(EmptyBoxError, match=words) as error:
        identify(PLANAR, [log], cutoff=None, window=40, estimator="frisch")
    assert error.value.parameter == emptied.parameter
    assert error.value.window == emptied.window
    for variant in ("undo", "calibrated"):
        other = identify(PLANAR, [log], cutoff=None, window=40, estimator="frisch", recursion=variant)
        assert other.narrowest_box.contains(other.model.estimate.theta)


def test_bounds_without_information_are_said():
    log = planar_log(noise=NOISY)
    found = identify(PLANAR, [log], cutoff=None, window=60, recursion="calibrated")
    one_shot, box = found.model.bounds["frisch"], found.model.bounds["bbrf"]
    silent = without_information(found.model.bounds)
    np.testing.assert_array_equal(silent["bbrf"], ~np.isfinite(box.width) | (box.width >= one_shot.width))
    assert silent["bbrf"].all(), "windows of 60 rows cannot be told from infinity"
    assert not silent["frisch"].any()
    assert any("(calibrated) holds no information on 13 of 13 parameters" in w for w in (*found.warnings, *found.notes))


def test_theorem_one_is_tested_and_reported():
    found = quick(PLANAR, [planar_log(noise=NOISY)])
    assert not found.simplex.same_orthant
    (doubt,) = (w for w in found.notes if w.startswith("the classical Frisch box is no bound here"))
    assert found.simplex.disagreeing[0] in doubt
    clean = quick(PLANAR, [planar_log()])
    assert not any("Theorem 1" in w for w in clean.notes)


def test_recursion_is_left_out_of_short_logs_and_said():
    found = identify(PLANAR, [planar_log(seconds=4.5, rate=4.0)], cutoff=None)
    assert found.recursion is None
    assert any("BBRF left out" in w and "too few" in w for w in found.warnings)


def test_windows_are_as_asked():
    log = planar_log(noise=NOISY)
    few = identify(PLANAR, [log], cutoff=None, window=1000, recursion="undo")
    many = identify(PLANAR, [log], cutoff=None, window=200, recursion="undo")
    assert many.recursion.windows > few.recursion.windows > 0


# ---- uncertainty


def test_standard_errors_cover_the_truth_with_coloured_residuals():
    clean = planar_log(seconds=40.0)
    truth, hits = None, []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        # correlated over 0.2 s, of different size on the two joints
        noise = lfilter([1.0], [1.0, -0.95], rng.normal(size=(len(clean) + 500, 2)), axis=0)[500:]
        log = replace(clean, tau=clean.tau + noise * [1.0, 0.2])
        found = quick(PLANAR, [log])
        e = found.model.estimate
        truth = true_base(found, VALUES) if truth is None else truth
        hits.append(np.abs(e.theta - truth) < 1.96 * e.stderr)
    coverage = np.mean(hits)
    assert 0.85 <= coverage <= 1.0
    assert np.mean(hits, axis=0).min() > 0.7, "one parameter is never covered"


def test_cross_validation_is_worse_than_in_sample():
    log = planar_log(seconds=10.0, rate=50.0, noise=Noise(tau=0.2))
    found = quick(PLANAR, [log], effects=parse_effects("viscous,coulomb,offset,rotor_inertia"), prior="none")
    spread = log.tau.std(axis=0)
    inside = found.model.estimate.sigma / spread
    outside = np.array(list(found.cross_validation.values()))
    # sigma is already divided by the degrees of freedom: compare the mean squares themselves
    share = len(found.model.base) / (2 * found.samples)
    assert (outside > inside * np.sqrt(1 - share)).all()


def test_validation_logs_are_compared_and_never_fitted():
    logs = [planar_log(1, noise=Noise(tau=0.01)), planar_log(2, noise=Noise(tau=0.01))]
    alone, both = quick(PLANAR, logs[:1]), quick(PLANAR, logs[:1], valid=logs[1:])
    assert alone.comparison is None
    np.testing.assert_array_equal(alone.model.estimate.theta, both.model.estimate.theta)
    assert both.comparison.nrmse == pytest.approx(0.01, rel=0.2)
    assert both.model.history[0]["test"]["nrmse"] == both.comparison.nrmse


# ---- structure


@pytest.mark.parametrize(
    ("options", "effects", "counts"),
    [
        ({"frames": "far_end", "known": {"my1": 0.0, "my2": 0.0}}, WITH_ROTORS, (9, 5, 14, 7)),
        ({"known": {"my1": 0.0, "my2": 0.0}}, WITH_ROTORS, (9, 7, 15, 4)),
        ({"frames": "far_end"}, WITH_ROTORS, (11, None, None, None)),
        ({}, WITH_ROTORS, (11, None, None, None)),
    ],
)
def test_the_papers_arm(options, effects, counts):
    machine = Robot.load("planar2", **options)
    found = structure(Regressor(machine, effects), machine.joints)
    p, absolute, none, linear = counts
    assert found.rank == p == len(found.base)
    assert found.gap > 1e4
    if absolute is not None:
        assert len(found.absolute) == absolute
        assert len(found.none) + len(machine.known) == none
        assert len(found.linear) == linear
        assert absolute + none + linear == len(machine.all_names) + 6


@pytest.mark.parametrize("name", serial_arms())
def test_rank_does_not_depend_on_the_seed(name):
    machine = Robot.load(name)
    regressor = Regressor(machine, BASELINE)
    found = [structure(regressor, machine.joints, seed=seed) for seed in range(4)]
    assert len({x.rank for x in found}) == 1
    assert all(x.gap > 100 for x in found)


def test_there_are_serial_arms_to_test():
    assert {"planar2", "kinova", "ur10_robot", "xarm7", "z1", "talos_left_arm"} <= set(serial_arms())
    assert len(serial_arms()) >= 15


def test_examination_says_facts():
    log = planar_log()
    (found,) = check(PLANAR, [log])
    assert found.warnings == ()
    assert found.facts["samples"] == len(log)
    assert found.facts["joints"] == ["joint1", "joint2"]
    assert found.facts["channels"] == ["v", "a", "tau"]
    degrees = Log(log.t, log.joints, np.rad2deg(log.q), tau=log.tau)
    assert any("degrees" in w for w in check(PLANAR, [degrees])[0].warnings)


def test_roughly_written_angles_do_not_tie_friction_to_a_rotor():
    # What 1.5708 leaves of an exact relation once gave every coefficient of friction a millionth of a rotor inertia.
    machine = Robot.load("xarm7")
    names = {c.name for c in structure(Regressor(machine, BASELINE), machine.joints).base_columns()}
    assert {"fv1", "fc7", "off3", "Ia6"} <= names


@pytest.mark.parametrize("ticks", [1e6, 1e9])
def test_stamps_in_ticks_are_said_before_a_spectrum_is_taken(ticks):
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 4.0, seed=0), rate=50.0, channels=())
    wrong = replace(log, t=log.t * ticks)
    with pytest.raises(InputError, match="unit of time"):
        identify(robot, [wrong])


def test_text_where_an_object_is_meant_is_said():
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 4.0, seed=0), rate=50.0, channels=())
    for wrong in ("viscous", ["viscous"], 3):
        with pytest.raises(InputError, match="effects must be a list of effects"):
            identify(robot, [log], effects=wrong)
    with pytest.raises(InputError, match=r"robot must be a frischid\.Robot, got 'planar2'"):
        identify("planar2", [log])
    with pytest.raises(InputError, match="cutoff must be a frequency"):
        identify(robot, [log], cutoff="5")
    with pytest.raises(InputError, match="unknown estimator '3'"):
        identify(robot, [log], estimator=3)


def test_a_cutoff_too_low_for_any_log_asks_for_no_memory():
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 4.0, seed=0), rate=50.0, channels=())
    with pytest.raises(InputError, match="needs a filter of"):
        identify(robot, [log], cutoff=1e-9)


@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_a_urdf_whose_masses_are_all_wrong_does_no_harm(factor, tmp_path):
    """Dummy inertias are common; a log that excites every parameter must win over them."""
    log, other = (
        simulate(PLANAR, random_fourier(PLANAR, 20.0, seed=seed), rate=100.0, noise=Noise(tau=0.05)) for seed in (1, 2)
    )
    tree = ElementTree.fromstring(PLANAR.urdf)
    for element in (x for tag in ("mass", "inertia") for x in tree.iter(tag)):
        element.attrib.update({name: repr(factor * float(value)) for name, value in element.attrib.items()})
    (tmp_path / "wrong.urdf").write_text(ElementTree.tostring(tree, encoding="unicode"))
    wrong = Robot.load(tmp_path / "wrong.urdf")
    right, found = (identify(machine, [log], valid=[other], recursion="none") for machine in (PLANAR, wrong))
    assert found.comparison.nrmse < 1.1 * right.comparison.nrmse
