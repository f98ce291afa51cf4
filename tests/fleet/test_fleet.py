"""A fleet: who differs is found and named, wherever the work is done and whatever dies on the way."""

import json
import logging
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from listening import listening, needs_ss

import frischid as fr
from frischid.cli import main
from frischid.cli.pages.fleets import fleet as fleet_page
from frischid.core.parallel import Dask, Here, workers
from frischid.core.types import Column
from frischid.errors import InputError
from frischid.estimators.least_squares import wls
from frischid.fleet.deviation import Centre, Deviation, Null, changes, deviation, usual_deviation
from frischid.fleet.fleet import identify_fleet
from frischid.fleet.fleet_options import FleetOptions
from frischid.fleet.jobs import Explaining, RobotMoments, explain
from frischid.fleet.log_paths import LogPath, find_logs, local, robot_of
from frischid.fleet.results import SIGNIFICANCE
from frischid.fleet.shared_fit import SharedFit, with_spread
from frischid.logs.table_writing import write_table
from frischid.regression.moment_blocks import total
from frischid.regression.moments import Gram

ROBOTS, SECONDS, RATE = 22, 20.0, 50.0
FRICTION = {"fv1": 4.0, "fv2": 5.0, "fv3": 3.0, "fc1": 6.0, "fc2": 7.0, "fc3": 5.0}
ALTERED = {
    4: ("payload", ", payload@elbow_joint", {"dm3": 1.0, "dmx3": 0.3}),
    11: ("coulomb", "", {"fc2": 9.5, "fv2": 6.5}),
    19: ("gravity_tilt", ", gravity_tilt", {"tilt_x": 0.03}),
}


@pytest.fixture(scope="module")
def arm():
    robot = fr.Robot.load("ur5")
    return robot.keep(robot.joints[:3])


@pytest.fixture(scope="module")
def folder(arm, tmp_path_factory):
    """Logs of a fleet, one folder a robot; three robots are altered, one has a second log that is broken."""
    path = tmp_path_factory.mktemp("fleet")
    for k in range(ROBOTS):
        rng = np.random.default_rng(k)
        _, more, values = ALTERED.get(k, ("", "", {}))
        log = fr.simulate(
            arm,
            fr.random_fourier(arm, SECONDS, seed=k),
            rate=RATE,
            effects=fr.parse_effects(f"viscous, coulomb, offset, rotor_inertia{more}"),
            parameters={n: x * (1 + 0.01 * rng.normal()) for n, x in FRICTION.items()} | values,
            noise=fr.Noise(q=2e-5, tau=0.02),
            channels=(),
            seed=k,
        )
        (path / f"r{k:02d}").mkdir()
        fr.write_log(log, path / f"r{k:02d}" / "log.parquet")
    (path / "r07" / "broken.parquet").write_bytes((path / "r07" / "log.parquet").read_bytes()[:3000])
    return path


@pytest.fixture(scope="module")
def alone(arm, folder):
    """The fleet identified in one process."""
    return identify_fleet(arm, find_logs([f"{folder}/**/*.parquet"]))


def same(a, b, tolerance=1e-10):
    """Whether two fleets are the same figures."""
    np.testing.assert_allclose(a.model.estimate.theta, b.model.estimate.theta, rtol=tolerance)
    np.testing.assert_allclose(a.model.estimate.covariance, b.model.estimate.covariance, rtol=1e-6)
    assert [m.name for m in a.members] == [m.name for m in b.members]
    assert [m.effect for m in a.members] == [m.effect for m in b.members]
    assert [(s.robot, s.address) for s in a.skipped] == [(s.robot, s.address) for s in b.skipped]
    for x, y in zip(a.members, b.members, strict=True):
        np.testing.assert_allclose(x.excess, y.excess, rtol=1e-8)
        np.testing.assert_allclose(x.deviation.own.theta, y.deviation.own.theta, rtol=tolerance)


def test_those_that_differ_come_first_and_are_named(alone):
    assert {m.name for m in alone.members[:3]} == {f"r{k:02d}" for k in ALTERED}
    assert len(alone.different) == 3
    for member in alone.different:
        expected = ALTERED[int(member.name[1:])][0]
        assert member.effect.startswith(expected), member.effect
    assert alone.members[0].excess > alone.members[1].excess > alone.members[2].excess > alone.members[3].excess


def test_a_log_with_a_fault_raises_an_alarm(alone, arm, folder, tmp_path):
    """One reversed torque had changed what all robots share; another robot was named, and nothing was said first."""
    assert alone.alarms == ()
    for k in (0, 1, 2):
        log = fr.read_log(folder / f"r{k:02d}" / "log.parquet", arm.joints)
        fr.write_log(replace(log, tau=log.tau * [1, -1 if k == 2 else 1, 1]), tmp_path / f"r{k}.parquet")
    found = identify_fleet(arm, find_logs([f"{tmp_path}/*.parquet"]), FleetOptions(diagnosed=0))
    (alarm,) = found.alarms
    assert (alarm.id, alarm.severity) == ("faulty-log", "severe")
    assert "r2.parquet: shoulder_lift_joint: " in alarm.sentence
    assert found.model.history[0]["alarms"] == [alarm.to_dict()]
    assert fleet_page(found, None).exit_code == 1


def test_two_robots_that_hide_one_another_in_a_small_fleet_are_told(alone):
    """With two of six robots changed, the page said that none differs by more than usual, and no more."""
    values = dict(zip(["r3", "r4", "r0", "r1", "r2", "r5"], [4.3, 3.7, 0.2, 0.2, 0.2, 0.2], strict=True))
    usual = [replace(m, p_value=1.0, excess=0.2) for m in alone.members]
    few = tuple(replace(usual[k], name=name, excess=values[name]) for k, name in enumerate(values))
    (told,) = [x for x in fleet_page(replace(alone, members=few), None).parts if "largest difference" in str(x)]
    assert told.startswith("the largest differences: r3 4.3, r4 3.7 times the usual one; in a fleet of fewer than 12")
    alike = fleet_page(replace(alone, members=tuple(usual)), None)
    assert not any("largest difference" in str(part) for part in alike.parts)


def test_what_they_share_is_found(alone):
    columns = [c.name for c in alone.model.estimate.columns]
    for name, value in FRICTION.items():
        i = columns.index(name)
        assert abs(alone.model.estimate.theta[i] - value) < 0.02 * value
    # Robots vary by one percent: that is what the next one is not known better than.
    spread = np.sqrt(np.diag(np.linalg.inv(alone.model.estimate.information)))[columns.index("fc2")]
    assert 0.02 < spread < 0.5


def test_a_broken_log_is_named_skipped_and_counted(alone, folder, arm):
    (broken,) = alone.skipped
    assert broken.robot == "r07"
    assert broken.address.endswith("r07/broken.parquet")
    assert "copied completely" in broken.reason
    assert next(m for m in alone.members if m.name == "r07").logs == 1
    with pytest.raises(InputError, match=r"broken\.parquet"):
        identify_fleet(arm, find_logs([f"{folder}/r0[67]/*.parquet"]), FleetOptions(strict=True))


def test_a_worker_that_dies_changes_nothing(alone, folder, arm):
    from distributed import Client, LocalCluster

    killed = []
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.CRITICAL
        ) as cluster,
        Client(cluster) as client,
    ):

        def progress(text):
            if text.startswith("moments of 5 ") and not killed:
                (pid, *_) = client.run(os.getpid).values()
                killed.append(pid)
                os.kill(pid, signal.SIGKILL)

        found = identify_fleet(arm, find_logs([f"{folder}/**/*.parquet"]), workers=Dask(client), progress=progress)
    assert killed
    same(found, alone)


def test_a_scheduler_that_is_not_there():
    with pytest.raises(InputError, match="no Dask scheduler answers"), workers("tcp://127.0.0.1:1"):
        pass


def test_a_tree_has_one_shape():
    written = Here().tree(lambda a, b: f"({a}+{b})", list("abcde"))
    assert written == "(((a+b)+(c+d))+e)"


@pytest.mark.parametrize(
    ("pattern", "address", "robot"),
    [
        ("logs/**/*.parquet", "logs/r1/monday/a.parquet", "r1"),
        ("logs/*.parquet", "logs/r2.parquet", "r2"),
        ("logs/{robot}_*.csv", "logs/r3_7.csv", "r3"),
        ("logs/{robot}_[0-9].csv", "logs/r3_7.csv", "r3"),
        ("logs/{robot}_[!^a].csv", "logs/r3_7.csv", "r3"),
        ("logs/{robot}_[^7].csv", "logs/r3_^.csv", "r3"),
        ("/a/{robot}/**/*.parquet", "/a/r4/b/c.parquet", "r4"),
        ("/a/{robot}/**/*.parquet", "/a/r4/c.parquet", "r4"),
        ("s3://bucket/{robot}/*", "s3://bucket/r5/x.parquet", "r5"),
        ("one.parquet", "one.parquet", "one"),
    ],
)
def test_which_robot_a_log_is_of(pattern, address, robot):
    assert robot_of(address, pattern) == robot


def test_names_of_files_are_of_the_robots_of_the_pattern_that_a_shell_made_them_of(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = ["logs/r1/log.csv", "logs/r2/log.csv", "logs/r2/log[old].csv"]
    for name in names:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).touch()
    assert [path.robot for path in find_logs(names)] == ["r1", "r2", "r2"]
    assert find_logs(names) == find_logs(["logs/*/*.csv"])
    assert [path.robot for path in find_logs(names[1:])] == ["log", "log[old]"]
    again = find_logs(["logs/*/log.csv", "./logs/r1/*.csv", f"{tmp_path}/logs/r2/log.csv"])
    assert [path.address for path in again] == names[:2]  # each file once, however its name is written


def test_logs_of_which_none_has_all_joints_are_skipped_by_name(arm, folder, tmp_path):
    """Of two of three robots each joint is recorded, and of none all of them."""
    log = fr.read_log(folder / "r01" / "log.parquet", arm.joints)
    table = log.to_table()
    for joint in arm.joints:
        write_table({n: x for n, x in table.items() if not n.endswith(joint)}, tmp_path / f"{joint}.parquet")
    with pytest.raises(InputError, match=r"none of \d logs can be used; the first: .*parquet"):
        identify_fleet(arm, find_logs([f"{tmp_path}/*.parquet"]))


@pytest.mark.parametrize("more", ["--gain 3", "--kp 100", "--horizon 2", "--held-commands", "--force", "--parameters"])
def test_sums_of_moments_refuse_what_they_cannot_use(folder, more):
    words = ["identify", "planar2", str(folder / "r01" / "log.parquet"), "--scheduler", "none", *more.split()]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 2
    assert "--scheduler sums moments" in done.output


def test_addresses_of_any_file_system(folder, tmp_path):
    import fsspec

    memory = fsspec.filesystem("memory")
    memory.pipe("/bucket/r00/log.parquet", (folder / "r00" / "log.parquet").read_bytes())
    (entry,) = find_logs(["memory://bucket/{robot}/*.parquet"])
    assert entry == LogPath("r00", "memory:///bucket/r00/log.parquet")
    with local(entry.address) as path:
        assert path.read_bytes() == (folder / "r00" / "log.parquet").read_bytes()
    assert not path.exists()
    with pytest.raises(InputError, match="no file matches"):
        find_logs(["memory://bucket/{robot}/*.csv"])
    with pytest.raises(InputError, match="no file matches"):
        find_logs([f"{tmp_path}/*.parquet"])


def test_a_small_fleet_has_no_empirical_null(alone):
    few = Null.of([m.deviation for m in alone.members[3:9]], 6)
    assert few.freedom is None
    assert few.scale == few.within
    many = Null.of([m.deviation for m in alone.members[3:]] * 2, 38)
    assert many.freedom < alone.members[3].deviation.rank
    assert many.scale > many.within


@pytest.fixture(scope="module")
def dozen(folder, arm):
    """Ten robots that are alike, and two that are not."""
    chosen = {"r04", "r11", *(f"r{k:02d}" for k in range(13) if k not in (4, 7, 11))}
    logs = [path for path in find_logs([f"{folder}/{{robot}}/log.parquet"]) if path.robot in chosen]
    assert len(logs) == 12
    return identify_fleet(arm, logs, FleetOptions(diagnosed=0))


def test_a_dozen_robots_stay_a_dozen_when_some_are_taken_out(dozen):
    """Before, the ten others were compared by the sensors' noise alone, and seven of them were called different."""
    different = {m.name for m in dozen.different}
    assert {"r04", "r11"} <= different
    assert len(different) <= 3


def test_a_fleets_model_weighs_what_one_robot_carries(folder, arm):
    """Fewer robots than parameters: the covariance of their mean has directions without any uncertainty."""
    logs = [path for path in find_logs([f"{folder}/{{robot}}/log.parquet"]) if path.robot < "r06"]
    few = identify_fleet(arm, logs, FleetOptions(diagnosed=0))
    found = fr.payload(few.model, [fr.read_log(folder / "r04" / "log.parquet", arm.joints)])
    assert abs(found.mass - 1.0) < found.bound["mass"]
    assert found.bound["mass"] < 0.5


def test_a_joint_that_rests_in_all_logs_of_a_fleet(tmp_path):
    """Before, NumPy refused "infs or NaNs": a joint without samples has no variance and no mean torque."""
    robot = fr.Robot.load("planar2")
    for k in range(3):
        rng = np.random.default_rng(k)
        t = np.arange(1000) * 0.01
        q = np.stack([0.5 * np.sin(1.3 * t + k) + 0.3 * np.sin(3.1 * t), np.full_like(t, 0.4)], axis=1)
        v = np.gradient(q, t, axis=0)
        tau = robot.inverse_dynamics(q, v, np.gradient(v, t, axis=0)) + 0.4 * v + 0.02 * rng.normal(size=q.shape)
        log = fr.Log(t, robot.joints, q=q + 1e-5 * rng.normal(size=q.shape), tau=tau, source=f"r{k}")
        fr.write_log(log, tmp_path / f"r{k}.parquet")
    found = identify_fleet(robot, find_logs([f"{tmp_path}/*.parquet"]), FleetOptions(diagnosed=0))
    assert not found.skipped
    found.model.save(tmp_path / "model.json")
    assert np.isfinite(fr.Model.load(tmp_path / "model.json").mean_torque).all()


def test_a_robot_whose_fitted_joint_rests_is_skipped_by_name(tmp_path):
    """Before, a division by zero ended the fleet of a dozen robots or more."""
    robot = fr.Robot.load("planar2")
    for k in range(13):
        rng, t = np.random.default_rng(k), np.arange(1000) * 0.01
        second = np.full_like(t, 0.4) if k == 5 else 0.4 + 0.5 * np.sin(2.1 * t + k)
        q = np.stack([0.5 * np.sin(1.3 * t + k) + 0.3 * np.sin(3.1 * t), second], axis=1)
        v = np.gradient(q, t, axis=0)
        tau = robot.inverse_dynamics(q, v, np.gradient(v, t, axis=0)) + 0.4 * v + 0.02 * rng.normal(size=q.shape)
        log = fr.Log(t, robot.joints, q=q + 1e-5 * rng.normal(size=q.shape), tau=tau)
        fr.write_log(log, tmp_path / f"r{k:02d}.parquet")
    options = FleetOptions(diagnosed=0, torque_joints=("joint2",))
    found = identify_fleet(robot, find_logs([f"{tmp_path}/*.parquet"]), options)
    assert len(found.members) == 12
    (skipped,) = found.skipped
    assert skipped.robot == "r05"
    assert "joint2 at standstill" in skipped.reason


@pytest.mark.parametrize("fault", [np.linalg.LinAlgError("no convergence"), InputError("no log"), OSError("gone")])
def test_a_robot_that_cannot_be_diagnosed_does_not_stop_the_others(alone, folder, arm, monkeypatch, fault):
    """Before, only frischid's own errors were caught, after all of the fleet's logs had been read."""

    def fails(*_, **__):
        raise fault

    monkeypatch.setattr("frischid.fleet.jobs.diagnose", fails)
    one = RobotMoments("r04", (moments_of(np.ones(3), 0),), (str(folder / "r04" / "log.parquet"),), 1, 1.0, (), ())
    monkeypatch.setattr("frischid.fleet.jobs.changes", lambda *_: [])
    changed, finding, reason = explain((one, True), alone.model.to_dict(), Explaining(None, 1.0))
    assert (changed, finding) == ([], None)
    assert str(fault) in reason


def test_standard_errors_are_those_of_a_mean_over_robots(arm, folder, alone):
    """With a prior, the model's own error is in them too, which all robots share."""
    alike = [m.deviation.own.theta for m in alone.members if not m.differs]
    spread = np.std(alike, axis=0, ddof=1) / np.sqrt(len(alike))
    plain = identify_fleet(arm, find_logs([f"{folder}/**/*.parquet"]), FleetOptions(prior="none", diagnosed=0))
    assert plain.model.prior is None
    assert 0.7 < np.median(plain.model.estimate.stderr / spread) < 1.4
    assert (alone.model.estimate.stderr > 0.7 * spread).all()


def test_short_logs_of_a_fleet_lean_on_the_urdf(arm, folder, tmp_path):
    """Three robots of 1.5 s: least squares predict another motion far worse than with the prior."""
    for path in find_logs([f"{folder}/{{robot}}/log.parquet"])[:3]:
        log = fr.read_log(path.address, arm.joints)
        fr.write_log(log.slice(0, int(1.5 * RATE)), tmp_path / f"{path.robot}.parquet")
    test = fr.read_log(folder / "r15" / "log.parquet", arm.joints)
    found = {
        prior: identify_fleet(arm, find_logs([f"{tmp_path}/*.parquet"]), FleetOptions(prior=prior, diagnosed=0))
        for prior in ("urdf", "none")
    }
    error = {prior: fr.compare(fleet.model, [test]).nrmse for prior, fleet in found.items()}
    assert error["urdf"] < 0.5 * error["none"]
    assert error["urdf"] < 0.5
    kept = found["urdf"].model
    assert kept.prior.to_dict() == fr.Model.from_dict(kept.to_dict()).prior.to_dict()
    assert kept.history[-1]["prior"]["kind"] == "urdf"
    assert all(member.deviation.own is not None for member in found["urdf"].members)


def moments_of(theta, seed, samples=2000):
    """Moments of one joint whose torque is ``Y θ`` and white noise of 0.1 N·m, five columns of different effects."""
    rng = np.random.default_rng(seed)
    Y = rng.normal(size=(samples, len(theta)))
    z = np.column_stack([Y, Y @ theta + 0.1 * rng.normal(size=samples)])
    columns = tuple(Column(f"x{k}", "N·m", "elbow", f"effect {k}") for k in range(len(theta)))
    return Gram(columns, ("elbow",), (z.T @ z)[None], z.sum(axis=0)[None], np.array([float(samples)]))


def test_a_change_must_pay_for_its_parameters():
    theta = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    found = [len(changes(moments_of(theta, seed), theta, 1.0)) for seed in range(40)]
    assert sum(found) <= 2  # chance alone gains 1/2 a parameter, and the price is ½ log 2000 = 3.8
    other = theta + np.array([0.0, 0.05, 0.0, 0.0, -0.02])
    for seed in range(10):
        assert [c.effect for c in changes(moments_of(other, seed), theta, 1.0)] == ["effect 1", "effect 4"]
    # correlated residuals count less: the same figures are then no evidence
    assert changes(moments_of(theta + np.array([0.0, 0.01, 0.0, 0.0, 0.0]), 0), theta, 100.0) == []


def test_a_robot_is_compared_with_the_others_alone():
    theta = np.array([1.0, 2.0, 3.0])
    robots = [moments_of(theta + (k == 0), k) for k in range(5)]
    whole, others, weights = total(robots), total(robots[1:]), np.array([1e2])
    inside = deviation([robots[0]], whole, Centre.of(whole, weights), included=True)
    outside = deviation([robots[0]], others, Centre.of(others, weights), included=False)
    assert inside.statistic == pytest.approx(outside.statistic, rel=1e-6)
    assert inside.shift == pytest.approx(np.ones(3), abs=0.02)


@pytest.mark.parametrize("robots", [10, 300])
def test_a_fleet_of_equal_robots_hardly_ever_raises_an_alarm(robots):
    rng, rank, zero = np.random.default_rng(0), 20, np.zeros(1)
    alike = Null(1.0, None, 1.0)
    alarms = 0
    for _ in range(400):
        largest = rng.chisquare(rank, size=robots).max()
        found = Deviation(None, "", float(largest), rank, np.nan, zero, zero, zero, zero)
        alarms += alike.p_value(found, robots) < 0.05
    assert 8 <= alarms <= 32  # 5 % of 400 fleets


def of_small_fleet(robots, seed, change=0.0):
    """P values of robots whose first two parameters vary by 5 %; the third parameter of the first robot is changed."""
    rng, theta, weights = np.random.default_rng(seed), np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([1e2])
    varied = np.tile(theta, (robots, 1))
    varied[:, :2] *= 1 + 0.05 * rng.normal(size=(robots, 2))
    varied[0, 2] += change
    each = [moments_of(one, 1000 * seed + k, 500) for k, one in enumerate(varied)]
    whole = total(each)
    centre = Centre.of(whole, weights)
    found = [
        replace(
            deviation([x], whole, centre, included=True),
            usual=usual_deviation([other for other in each if other is not x], centre),
        )
        for x in each
    ]
    null = Null.of(found, robots)
    return [null.p_value(x, robots) for x in found]


@pytest.mark.parametrize(("robots", "change"), [(3, 500.0), (6, 2.0)])
def test_robots_of_a_small_fleet_differ_as_much_as_they_usually_do(robots, change):
    """Before, with the noise alone as measure, almost all of these robots were called different."""
    least = [min(of_small_fleet(robots, seed)) for seed in range(100)]
    assert sum(p < SIGNIFICANCE for p in least) <= 1  # 1 % of the fleets
    changed = [of_small_fleet(robots, seed, change) for seed in range(20)]
    assert np.mean([p[0] < SIGNIFICANCE for p in changed]) >= 0.9
    assert all(min(p[1:]) > SIGNIFICANCE for p in changed)  # one robot that differs does not make the others differ


def test_two_robots_leave_no_others_to_compare_with():
    assert np.isnan(usual_deviation([alone := moments_of(np.ones(3), 0)], Centre.of(alone, np.array([1e2]))))


def same_motion(theta, samples=1000):
    """Moments of one joint that always moves alike, without noise."""
    Y = np.random.default_rng(0).normal(size=(samples, len(theta)))
    z = np.column_stack([Y, Y @ theta])
    columns = tuple(Column(f"x{k}", "N·m", "elbow", f"effect {k}") for k in range(len(theta)))
    return Gram(columns, ("elbow",), (z.T @ z)[None], z.sum(axis=0)[None], np.array([float(samples)]))


@pytest.mark.parametrize("robots", [4, 10])
def test_the_spread_of_robots_that_move_alike_is_that_of_a_mean(robots):
    values = np.array([1.0, 2.0, 3.0]) + 0.1 * np.random.default_rng(1).normal(size=(robots, 3))
    each = [same_motion(theta) for theta in values]
    whole = total(each)
    fit = SharedFit(whole, wls([whole]), None, np.eye(3))
    found = [deviation([x], whole, fit.centre, included=True) for x in each]
    spread = with_spread(fit, found, Null.of(found, robots))
    np.testing.assert_allclose(spread.covariance, np.cov(values.T) / robots, rtol=1e-6)


@needs_ss
def test_a_local_cluster_listens_to_this_machine_only():
    with workers("local", 2) as pool:
        assert pool.gather(pool.map(abs, [-1, 2])) == [1, 2]
        addresses = listening()
    assert len(addresses) >= 6
    assert set(addresses) == {"127.0.0.1"}


def test_a_fleet_of_broken_logs_is_refused_by_name(arm, tmp_path):
    path = tmp_path / "r1.parquet"
    path.write_bytes(b"PAR1" + bytes(100) + b"PAR1")
    with pytest.raises(InputError, match=r"none of 1 logs looked at can be read.*r1\.parquet"):
        identify_fleet(arm, find_logs([str(path)]))


def test_a_torque_that_all_robots_record_late_is_read_in_time(arm, folder, tmp_path, alone):
    """One lag of the whole fleet, of a few logs; the parameters are those of the torque in time, and files say it."""
    for k in range(12, 19):
        log = fr.read_log(folder / f"r{k:02d}" / "log.parquet", arm.joints)
        acted = fr.RecordedTorque(log.t + 0.01, log.tau)
        fr.write_log(replace(log, tau=acted.torque(log.t, log.q, log.q)), tmp_path / f"r{k:02d}.parquet")
    paths = find_logs([f"{tmp_path}/*.parquet"])
    in_time = identify_fleet(arm, paths, FleetOptions(diagnosed=0))
    as_recorded = identify_fleet(arm, paths, FleetOptions(diagnosed=0, torque_lag=0.0))
    assert in_time.model.lowpass.torque_lag == pytest.approx(0.01, rel=0.1)
    assert any("ms behind the motion" in note and "on 5 logs" in note for note in in_time.notes)
    assert as_recorded.model.lowpass.torque_lag == 0.0
    off = [
        np.abs(x.model.estimate.theta - alone.model.estimate.theta)[-len(FRICTION) :].max()
        for x in (as_recorded, in_time)
    ]
    assert off[1] < 0.5 * off[0]
    errors = [np.mean([m.deviation.error_fleet.mean() for m in x.members]) for x in (as_recorded, in_time)]
    assert errors[1] < 0.7 * errors[0]
    stated = identify_fleet(arm, paths, FleetOptions(diagnosed=0, torque_lag=0.01))
    assert "the recorded torque counts as 10 ms late" in stated.notes


def test_the_command_line(folder, tmp_path, alone):
    options = ["--joints", "shoulder*,elbow*", "--lock", "wrist_*=0", "--scheduler", "none", "--json"]
    pattern = f"{folder}/**/*.parquet"
    result = CliRunner().invoke(main, ["fleet", "ur5", pattern, *options, "-o", str(tmp_path / "fleet.json")])
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert data["different"] == [m.name for m in alone.different]
    assert len(data["skipped"]) == 1
    assert fr.Model.load(tmp_path / "fleet.json").history[0]["robots"] == ROBOTS
    again = CliRunner().invoke(main, ["identify", "ur5", pattern, *options])
    assert json.loads(again.stdout)["different"] == data["different"]
    refused = CliRunner().invoke(main, ["identify", "ur5", pattern, *options, "--estimator", "iv"])
    assert refused.exit_code == 2
    page = CliRunner().invoke(main, ["fleet", "ur5", pattern, *options[:-1], "--diagnosed", "0"])
    assert page.exit_code == 0, page.output
    assert "1 log skipped" in page.output


@pytest.mark.parametrize(("count", "said"), [(6, "and 1 more warning"), (7, "and 2 more warnings")])
def test_warnings_that_are_not_listed_are_counted(alone, count, said):
    page = fleet_page(replace(alone, warnings=tuple(f"warning {k}" for k in range(count))), None)
    assert said in page.parts


def test_a_prior_of_another_name_is_refused():
    with pytest.raises(InputError, match="unknown prior 'nome'"):
        FleetOptions(prior="nome")


def test_robots_that_rest_in_the_first_chunk_of_large_files(tmp_path, monkeypatch):
    """The cut-off was a guess, and each log was said to stand still throughout."""
    robot, rng = fr.Robot.load("planar2"), np.random.default_rng(0)
    for seed in (1, 2):
        log = fr.simulate(
            robot, fr.random_fourier(robot, 10.0, seed=seed), rate=100.0, noise=fr.Noise(q=1e-5, tau=0.02), channels=()
        )
        q, tau = (
            np.vstack([x[:1] + noise * rng.normal(size=(600, 2)), x]) for x, noise in ((log.q, 1e-5), (log.tau, 0.1))
        )
        fr.write_log(replace(log, t=np.arange(len(q)) / 100, q=q, tau=tau), tmp_path / f"r{seed}.parquet")
    monkeypatch.setattr("frischid.fleet.jobs._WHOLE_FILE", 1000)
    monkeypatch.setattr("frischid.logs.recording.RECORDING_CHUNK", 500)
    chunks = identify_fleet(robot, find_logs([f"{tmp_path}/*.parquet"]))
    assert "the motion's bandwidth" in chunks.model.lowpass.reason
    assert not chunks.warnings
