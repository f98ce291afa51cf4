"""The README's picture: measured torque, the model's, and the residual error, on a motion that was not fitted.

Draws the UR10e's validation log when FRISCHID_DATA is set, the demonstration's planar arm otherwise.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import frischid as fr
from frischid.cli import demo

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from common import data_folder
from real_robots import CASES, identified


def main() -> None:
    """Write the picture."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("-o", "--output", type=Path, default=Path("docs/ur10e.png"))
    output = options.parse_args().output
    folder = data_folder()
    if folder is None:
        found = demo.run(0).found
        robot = found.model.robot
        motion = fr.random_fourier(robot, 40.0, seed=1)
        logs = [fr.simulate(robot, motion, rate=200.0, parameters=demo.TRUTH, noise=demo.NOISE)]
    else:
        case = CASES[0]
        found, _ = identified(case, folder)
        logs = [fr.read_log(folder / path, found.model.robot.joints, case.mapping) for path in case.valid]
    draw(found, logs, output)


def draw(found: fr.Identification, logs: list[fr.Log], output: Path) -> None:
    """Three joints, torque above, residual below, standstill shaded."""
    mpl.rcParams.update({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False})
    blocks = list(found.model.blocks(logs))
    t = np.concatenate([b.t for b, _ in blocks])
    measured = np.concatenate([b.tau for b, _ in blocks])
    fitted = np.concatenate([f for _, f in blocks])
    used = np.concatenate([b.used for b, _ in blocks])
    joints = list(range(measured.shape[1]))[:3] if measured.shape[1] < 6 else [1, 3, 4]
    ratios = [3, 1] * len(joints)
    figure, axes = plt.subplots(2 * len(joints), 1, figsize=(8, 6.4), sharex=True, height_ratios=ratios)
    comparison = found.comparison
    for k, j in enumerate(joints):
        upper, lower = axes[2 * k], axes[2 * k + 1]
        name = found.model.robot.joints[j]
        fit = "" if comparison is None else f", NRMSE {comparison.joints[name].nrmse:.3f}"
        upper.plot(t, measured[:, j], color="0.55", lw=1.6, label="measured")
        upper.plot(t, np.where(used[:, j], fitted[:, j], np.nan), color="#0072b2", lw=1.0, label="model")
        upper.set_ylabel("N·m")
        upper.set_title(f"{name}{fit}", loc="left", fontsize=8)
        lower.plot(t, np.where(used[:, j], measured[:, j] - fitted[:, j], np.nan), color="#d55e00", lw=0.8)
        lower.axhline(0, color="0.7", lw=0.5)
        lower.set_ylabel("residual")
        for axis in (upper, lower):
            axis.fill_between(t, 0, 1, where=~used[:, j], transform=axis.get_xaxis_transform(), color="0.93", lw=0)
    axes[0].legend(frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1, 1))
    axes[-1].set_xlabel("time, s (grey: standstill, where dry friction is undetermined)")
    figure.align_ylabels()
    figure.tight_layout(h_pad=0.4)
    output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(output, dpi=110)


if __name__ == "__main__":
    main()
