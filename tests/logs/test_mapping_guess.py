"""`frischid map`: other people's columns become ours, from names and numbers."""

import numpy as np
import pytest
from bag_files import ros2
from click.testing import CliRunner

from frischid.cli import main
from frischid.errors import InputError
from frischid.logs.mapping_guess import assign, propose, split
from frischid.logs.readers import read_log
from frischid.logs.tables import write_table
from frischid.motions.simulation import simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

UR = Robot.load("ur10")
LOG = simulate(UR, random_fourier(UR, 10, seed=1), rate=100)


def written(path, position, velocity, torque, *, time="t", scale=1.0, angle=1.0, more=None):
    """A file of the same log under other people's names."""
    table = {time: LOG.t * scale}
    for template, values, unit in ((position, LOG.q, angle), (velocity, LOG.v, angle), (torque, LOG.tau, 1.0)):
        for j, joint in enumerate(UR.joints):
            short = joint.removesuffix("_joint")
            table[template.format(j=j, k=j + 1, joint=joint, short=short)] = unit * values[:, j]
    write_table(table | (more or {}), path)
    return path


CASES = {
    "rtde": ("actual_q_{j}", "actual_qd_{j}", "actual_current_{j}", {"time": "timestamp"}),
    "one by one": ("q{k}", "dq{k}", "tau{k}", {"time": "time"}),
    "spoken": ("- {joint}_position", "- {joint}_velocity", "- {joint}_effort", {}),
    "short": ("{short}.pos", "{short}.vel", "{short}.torque", {"time": "stamp", "scale": 1e3}),
    "camel": ("jointPosition{k}", "jointVelocity{k}", "jointTorque{k}", {"time": "timeStamp", "scale": 1e9}),
    "degrees": ("angle_{short}", "speed_{short}", "moment_{short}", {"angle": 180 / np.pi}),
}


@pytest.mark.parametrize("case", CASES)
def test_a_proposed_mapping_reads_the_log(tmp_path, case):
    position, velocity, torque, options = CASES[case]
    more = {"target_q_0": LOG.t, "temperature_1": LOG.t}
    path = written(tmp_path / "log.csv", position, velocity, torque, more=more, **options)
    output = tmp_path / "map.toml"
    result = CliRunner().invoke(main, ["map", str(path), "ur10", "-o", str(output)])
    assert result.exit_code == 0, result.output
    assert "6 joints found" in result.output
    read = read_log(path, UR.joints, output)
    assert read.joints == UR.joints
    np.testing.assert_allclose(read.t, LOG.t, atol=1e-9)
    np.testing.assert_allclose(read.q, LOG.q, atol=1e-9)
    np.testing.assert_allclose(read.v, LOG.v, atol=1e-9)
    effort = read.current if "current" in torque else read.tau
    np.testing.assert_allclose(effort, LOG.tau, atol=1e-9)


def test_a_bag_of_other_joint_names(tmp_path):
    from dataclasses import replace

    renamed = replace(LOG, joints=tuple(f"left_{j.removesuffix('_joint')}" for j in LOG.joints))
    path = ros2(renamed, tmp_path / "bag")
    output = tmp_path / "map.toml"
    output.write_text(propose(path, UR).toml("bag"))
    np.testing.assert_array_equal(read_log(path, UR.joints, output).tau, LOG.tau)


def test_what_does_not_fit_is_said(tmp_path):
    table = {"t": LOG.t} | {f"q_{j}": LOG.q[:, j] for j in range(4)} | {f"v_{j}": LOG.v[:, j] for j in range(4)}
    write_table(table | {"v_1": -LOG.v[:, 1], "v_2": LOG.v[::-1, 3]}, tmp_path / "log.csv")
    found = propose(tmp_path / "log.csv", UR)
    assert found.missing == UR.joints[4:]
    assert any("v_1 is -1 times the slope of q_1" in r for r in found.reasons)
    assert any("v_2 is not the slope of q_2" in r for r in found.reasons)
    assert "v" in found.joints[UR.joints[0]]
    assert "v" not in found.joints[UR.joints[1]]


def test_nothing_to_go_by(tmp_path):
    write_table({"t": LOG.t, "x": LOG.q[:, 0]}, tmp_path / "log.csv")
    with pytest.raises(InputError, match="no column looks like a position"):
        propose(tmp_path / "log.csv", UR)
    write_table({"noise": LOG.q[:, 0]}, tmp_path / "log.csv")
    with pytest.raises(InputError, match="no column grows steadily"):
        propose(tmp_path / "log.csv", UR)


def test_names():
    assert split("actual_q_3") == ("q", "3")
    assert split("- arm_1_joint_effort") == ("tau", "arm_1_joint")
    assert split("target_q_3")[0] is None
    assert split("qd_target_1")[0] is None
    assert split("pos.shoulder_pan") == ("q", "shoulder_pan")
    joints = [f"panda_joint{k}" for k in range(1, 8)]
    assert assign({f"c{k}": f"joint_{k}" for k in range(1, 8)}, joints) == {
        j: f"c{k + 1}" for k, j in enumerate(joints)
    }
    assert assign({"x": "elbow", "y": "shoulder"}, ["shoulder_joint", "elbow_joint"]) == {
        "elbow_joint": "x",
        "shoulder_joint": "y",
    }
