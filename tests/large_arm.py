"""A simulated arm for 300 kg with a counterbalance and a friction that grows with the load; its URDF may say little."""

from pathlib import Path
from typing import Literal

from frischid.effects import BASELINE, parse_effects
from frischid.logs.log import Log
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

JOINTS = (("0 0 0.675", "0 0 -1"), ("0.35 0 0", "0 1 0"), ("1.15 0 0", "0 1 0"),
          ("1.0 0 -0.041", "-1 0 0"), ("0 0 0", "0 1 0"), ("0 0 0", "-1 0 0"))  # fmt: skip
"""Place and axis of each joint."""
STATED = (
    (250, "0.1 0 -0.15", (18, 20, 16)),
    (180, "0.5 -0.2 0", (5, 35, 34)),
    (200, "0.15 0.02 0.12", (8, 14, 12)),
    (60, "-0.2 0 0", (0.8, 3, 3)),
    (35, "0.03 0 0.01", (0.4, 0.5, 0.4)),
    (15, "0.18 0.01 0", (0.15, 0.12, 0.12)),
)
"""Mass, centre and moments of each link."""
GUESSED = (
    (8, "0 0 -0.3", (0.3, 0.3, 0.2)),
    (6, "0.57 0 0", (0.05, 0.6, 0.6)),
    (3, "0.5 0 0", (0.02, 0.2, 0.2)),
    (2, "-0.1 0 0", (0.01, 0.01, 0.01)),
    (1, "0 0 0", (0.003, 0.003, 0.003)),
    (0.5, "0.1 0 0", (0.001, 0.001, 0.001)),
)
"""The same of somebody who wanted a simulator to accept the file."""
DRIVES = {f"{name}{k}": value * scale for k, scale in enumerate((1, 1, 0.8, 0.2, 0.2, 0.1), 1)
          for name, value in (("fv", 500.0), ("fc", 200.0), ("Ia", 80.0))}  # fmt: skip


def large(folder: Path, links: Literal["stated", "guessed", "none"]) -> Robot:
    """The arm, with its inertials, with guessed ones, or without."""
    bodies = {"stated": STATED, "guessed": GUESSED, "none": (None,) * 6}[links]
    parts = []
    for k, ((place, axis), body) in enumerate(zip(JOINTS, bodies, strict=True), 1):
        inertial = ""
        if body is not None:
            mass, centre, (xx, yy, zz) = body
            inertia = f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'
            inertial = f'<inertial><origin xyz="{centre}"/><mass value="{mass}"/>{inertia}</inertial>'
        parts += [
            f'<link name="l{k}">{inertial}</link>',
            f'<joint name="a{k}" type="revolute"><origin xyz="{place}"/><parent link="l{k - 1}"/><child link="l{k}"/>'
            f'<axis xyz="{axis}"/><limit effort="0" lower="-2" upper="2" velocity="3"/></joint>',
        ]
    path = folder / f"{links}.urdf"
    path.write_text(f'<robot name="large"><link name="l0"/>{"".join(parts)}</robot>')
    return Robot.load(path)


def log_of_large(robot: Robot, seed: int, seconds: float) -> Log:
    """A log of the arm, for which `robot` states its links."""
    return simulate(
        robot,
        random_fourier(robot, seconds, seed=seed, scale=0.8),
        rate=50.0,
        effects=(*BASELINE, *parse_effects("counterbalance(rest=0.3, ratio=2.5)@a2, load_friction@a3")),
        parameters=DRIVES | {"cp2": -6000.0, "cs2": 1500.0, "fl3": 0.06},
        noise=Noise(q=2e-5, tau=0.01),
        channels=(),
        seed=seed,
    )
