"""A programme as a file that robots take: a table, a ROS JointTrajectory, or URScript.

    t_k = k / rate,   (q, q̇, q̈)(t_k)

A JointTrajectory (trajectory_msgs, YAML) has positions, velocities and accelerations, so that a controller interpolates
by quintics. URScript has one ``servoj`` a sample, after a slow ``movej`` to the first pose.

Sources: ros2 common_interfaces, trajectory_msgs/msg/JointTrajectory; Universal Robots, "The URScript Programming
Language", servoj and movej.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

from frischid.core.files import write_text
from frischid.core.text import quoted
from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.log import Log
from frischid.logs.readers import write_log
from frischid.logs.table_writing import TABLE_FILES
from frischid.motions.programme import Programme

ROBOT_FILES = {".yaml": "ROS JointTrajectory", ".script": "URScript"}
"""Endings of files other than tables."""
UR_JOINTS, UR_RATE = 6, 500.0
"""Joints of a Universal Robots arm, and the largest rate of its controller, Hz."""


def save(programme: Programme, path: str | Path, rate: float = 100.0) -> None:
    """Write a programme: .csv, .parquet or .npz (t, q, v, a), .yaml (JointTrajectory) or .script (URScript).

    Raises
    ------
    InputError
        URScript for a robot without six joints, or at more than 500 Hz; an ending that is none of these.
    """
    check_file(path, programme.joints, rate)
    log, ending = programme.to_log(rate), Path(path).suffix
    if ending == ".yaml":
        write_text(Path(path), "\n".join(_trajectory(log)) + "\n")
    elif ending == ".script":
        write_text(Path(path), "\n".join(_urscript(log, rate)) + "\n")
    else:
        write_log(log, path)


def check_file(path: str | Path, joints: Sequence[str], rate: float) -> None:
    """Refuse a file that cannot hold a motion of these joints at a rate in Hz.

    Raises
    ------
    InputError
        As for `save`.
    """
    ending = Path(path).suffix
    if ending not in ROBOT_FILES and ending.lower() not in TABLE_FILES:
        known = ", ".join([*TABLE_FILES, *ROBOT_FILES])
        raise InputError(f"{path}: cannot write a motion as a file '{ending}'; use one of {known}")
    if ending != ".script":
        return
    if len(joints) != UR_JOINTS:
        raise InputError(
            f"URScript is for arms of {UR_JOINTS} joints, this robot has {len(joints)}: {', '.join(joints)}; "
            "write a .csv or a .yaml, or lock the other joints with --lock"
        )
    if rate > UR_RATE:
        raise InputError(f"a UR controller takes at most {UR_RATE:g} positions a second, got --rate {rate:g}")


def _trajectory(log: Log) -> Iterator[str]:
    assert log.v is not None
    assert log.a is not None
    yield f"joint_names: {quoted(log.joints)}"
    yield "points:"
    for t, q, v, a in zip(log.t, log.q, log.v, log.a, strict=True):
        nanoseconds = round(float(t) * 1e9)
        yield f"- positions: {_numbers(q)}"
        yield f"  velocities: {_numbers(v)}"
        yield f"  accelerations: {_numbers(a)}"
        yield f"  time_from_start: {{sec: {nanoseconds // 10**9}, nanosec: {nanoseconds % 10**9}}}"


def _urscript(log: Log, rate: float) -> Iterator[str]:
    yield "def frischid_excite():"
    yield f"  # joints in order: {json.dumps(log.joints)}"
    yield f"  # {log.t[-1]:.2f} s. The way to the first pose is the controller's own: stand near this pose before."
    yield f"  movej({_numbers(log.q[0])}, a=0.3, v=0.2)"
    for q in log.q:
        yield f"  servoj({_numbers(q)}, 0, 0, {1 / rate:.6g}, 0.1, 300)"
    yield "  stopj(1.0)"
    yield "end"
    yield "frischid_excite()"


def _numbers(row: Array) -> str:
    return "[" + ", ".join(f"{x:.9g}" for x in row) + "]"
