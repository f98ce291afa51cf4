"""Readings of torques cost what they must: bounds rule out exchanges, and rows that a fault does not reach are kept."""

from functools import cache

import numpy as np
import pytest

from frischid.checks.position_faults import position_faults
from frischid.checks.row_fits import RowFits
from frischid.checks.sketch import Sketch
from frischid.checks.torque_faults import local_fits
from frischid.core.types import Array
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import prepare
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

TWO_ARMS = Robot.load("baxter")
LEFT = [name for name in TWO_ARMS.joints if name.startswith("l")]


@cache
def sketch() -> Sketch:
    lowpass = LowPass(5.0)
    log = simulate(TWO_ARMS, random_fourier(TWO_ARMS, 10.0, seed=1), rate=100.0, noise=Noise(q=1e-5, tau=0.05))
    return Sketch.of(TWO_ARMS, prepare(log, lowpass).motions, lowpass, TWO_ARMS.joints).thinned(200)


def with_torques(tau: Array) -> Sketch:
    whole = sketch()
    return Sketch(whole.motion, whole.t, tau, whole.rows, whole.noise, whole.ends, whole.criteria)


@pytest.mark.parametrize("factor", [1.0, -1.0, 0.01])
def test_no_error_of_a_row_is_below_its_bound(factor: float):
    fits = RowFits(sketch())
    least, R = fits.least_errors(factor), len(fits.rows)
    spreads = np.abs(factor) * fits.spreads
    exact = np.array(
        [
            [fits.error(i, factor * fits.of(i, fits.sketch.tau, j), spreads[i, k]) for k, j in enumerate(fits.rows)]
            for i in range(R)
        ]
    )
    assert (least <= exact * (1 + 1e-9) + 1e-9).all()
    assert np.median(least / exact) > 0.8  # and the bound is worth its cost


@pytest.fixture(params=["error"])
def solved(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the rows to which a method of the fits was applied."""
    names, method = [], getattr(RowFits, request.param)

    def counting(fits: RowFits, k: int, *args: object) -> object:
        names.append(fits.names[k])
        return method(fits, k, *args)

    monkeypatch.setattr(RowFits, request.param, counting)
    return names


def test_exchanges_that_are_ruled_out_gain_nothing(monkeypatch: pytest.MonkeyPatch, solved: list[str]):
    tau = sketch().tau.copy()
    tau[:, [2, 5]] = tau[:, [5, 2]]
    best = local_fits(RowFits(with_torques(tau)), simple=True)
    few = len(solved)
    monkeypatch.setattr(RowFits, "least_errors", lambda fits, factor: np.zeros((len(fits.rows), len(fits.rows))))
    every = local_fits(RowFits(with_torques(tau)), simple=True)
    assert [(x.score, [f.where for f in x.faults]) for x in best] == [
        (x.score, [f.where for f in x.faults]) for x in every
    ]
    assert best[0].faults[0].where == (TWO_ARMS.joints[2], TWO_ARMS.joints[5])
    assert few < (len(solved) - few) / 3


@pytest.mark.parametrize("solved", ["beside"], indirect=True)
def test_a_wrong_position_of_one_arm_leaves_the_other_arm_as_it_was_read(solved: list[str]):
    """Each of hundreds of faults of positions read every torque of the robot again."""
    tau = sketch().tau + 20 * sketch().q  # a spring on every joint: nothing explains these torques
    whole = RowFits(with_torques(tau))
    local_fits(whole)
    moved = [x for x in position_faults(whole.sketch) if x.fault.where[0] in LEFT and x.fault.where[-1] in LEFT]
    assert {x.fault.kind for x in moved} == {"position sign", "swapped positions", "joint zero"}
    arm: list[str] = []
    for item in moved:
        solved.clear()
        kept = local_fits(RowFits(item.sketch, whole))
        arm += solved
        anew = local_fits(RowFits(item.sketch))
        assert [x.score for x in kept] == [x.score for x in anew]
    assert "right_s1" not in arm
    assert "left_s1" in arm
