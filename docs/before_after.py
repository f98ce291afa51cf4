"""The README's picture: measured torque and the model's, before and after the effect that `improve` found.

Draws two joints of the Stäubli TX40 on its test log, from the data in FRISCHID_DATA.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import frischid as fr
from frischid.model.prediction import predict

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from common import data_folder
from six_robots import ROBOTS
from trust import Part, read


def subject() -> tuple[fr.Model, fr.Model, list[fr.Log], list[str], str]:
    """Model before and after, test logs, the joints to draw, and the name of the effect."""
    folder = data_folder()
    if folder is None:
        sys.exit("error: FRISCHID_DATA is not set; it names the folder with the logs of the Stäubli TX40")
    case = next(case for case in ROBOTS if case.key == "staubli_tx40")
    robot = fr.Robot.load(folder / case.key / case.urdf)
    fit, test = ([read(folder, robot, case.key, Part(name)) for name in names] for names in (case.fit, case.test))
    before = fr.identify(robot, fit, recursion="none").model
    (step, *_), _ = fr.improve(before, fit, max_steps=1)
    assert step.finding is not None
    return before, step.model, test, list(step.finding.joints), fr.EFFECTS[step.finding.effect].title.split(":")[0]


def main() -> None:
    """Write the picture."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("-o", "--output", type=Path, default=Path(__file__).with_name("before_after.png"))
    before, after, logs, joints, effect = subject()
    draw(before, after, logs, joints, effect, options.parse_args().output)


def draw(before: fr.Model, after: fr.Model, logs: list[fr.Log], joints: list[str], effect: str, output: Path) -> None:
    """A row per joint, before on the left and after on the right; standstill is left out."""
    mpl.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    size = (9, 1.0 + 1.7 * len(joints))
    figure, axes = plt.subplots(len(joints), 2, figsize=size, sharex=True, sharey="row", squeeze=False)
    titles = ("identified", f"with what frischid found: {effect}")
    for column, (model, title) in enumerate(zip((before, after), titles, strict=True)):
        seen, error = predict(model, logs), fr.compare(model, logs)
        for line, name in enumerate(joints):
            j, axis = seen.joints.index(name), axes[line, column]
            used = seen.used[:, j]
            axis.plot(seen.t, seen.measured[:, j], color="0.6", lw=1.8, label="measured")
            axis.plot(seen.t, np.where(used, seen.fitted[:, j], np.nan), color="#0072b2", lw=1.1, label="model")
            axis.set_title(f"{name}: {title}\nNRMSE {error.joints[name].nrmse:.2f}", loc="left", fontsize=9)
            if column == 0:
                axis.set_ylabel("N·m")
    axes[0, 1].legend(frameon=False, ncols=2, loc="upper right", fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("time, s")
    figure.tight_layout()
    output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(output, dpi=110)


if __name__ == "__main__":
    main()
