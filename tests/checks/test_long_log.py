"""A long log is examined piece by piece: the same findings, each said once, and nothing of it is kept."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from frischid.checks import long_log
from frischid.checks.long_log import pieces_of
from frischid.errors import InputError
from frischid.logs.log import Log
from frischid.logs.readers import write_log
from frischid.logs.recording import Recording
from frischid.model.log_examination import check
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

ROBOT = Robot.load("planar2")


@cache
def clean():
    return simulate(ROBOT, random_fourier(ROBOT, 60.0, seed=1), rate=100.0, noise=Noise(q=1e-5, v=1e-4, tau=0.01))


@pytest.fixture
def short_pieces(monkeypatch):
    """Logs above 2,000 samples are long, and have pieces of 1,000."""
    monkeypatch.setattr(long_log, "PIECE", 1000)
    monkeypatch.setattr(long_log, "WHOLE", 2000)


def changed(log, column, rows, change):
    """A log with some rows of a column changed."""
    values = getattr(log, column).copy()
    values[rows] = change(values[rows])
    return replace(log, **{column: values})


def test_pieces_are_the_whole(short_pieces):
    pieces = list(pieces_of(clean()))
    assert len(pieces) == 6
    assert sum(len(p) - 1 for p in pieces) + 1 == len(clean())
    for before, after in pairwise(pieces):
        assert before.t[-1] == after.t[0]
    np.testing.assert_array_equal(np.concatenate([p.q[:-1] for p in pieces]), clean().q[:-1])


def test_a_long_log_has_the_figures_of_the_whole(monkeypatch, tmp_path):
    (whole,) = check(ROBOT, [clean()])
    monkeypatch.setattr(long_log, "PIECE", 1000)
    monkeypatch.setattr(long_log, "WHOLE", 2000)
    write_log(clean(), tmp_path / "log.parquet")
    for log in (clean(), Recording.open(tmp_path / "log.parquet", ROBOT.joints)):
        (pieces,) = check(ROBOT, [log])
        assert (whole.issues, pieces.issues) == ((), ())
        for key in ("samples", "channels", "joints", "rigid_parameters", "unseen_parameters", "gaps"):
            assert pieces.facts[key] == whole.facts[key], key
        for key in ("seconds", "rate_hz", "mean_rate_hz", "steps_ms"):
            assert pieces.facts[key] == pytest.approx(whole.facts[key], rel=1e-9), key
        assert pieces.facts.keys() == whole.facts.keys()
        for name in ROBOT.joints:
            assert pieces.joints[name].keys() == whole.joints[name].keys()
            assert pieces.joints[name]["noise_q"] == pytest.approx(whole.joints[name]["noise_q"], rel=0.1)


def test_a_certain_fault_of_one_piece_is_found_and_placed(short_pieces):
    (report,) = check(ROBOT, [changed(clean(), "tau", slice(3100, 3900), lambda x: 0 * x)])
    (issue,) = (i for i in report.issues if i.kind == "dead band")
    assert "(in 1 of 6 pieces, first from 29.99 s on)" in issue.what
    assert issue.where == ROBOT.joints


def test_a_fault_of_all_pieces_is_said_once(short_pieces):
    (report,) = check(ROBOT, [replace(clean(), v=-clean().v)])
    (issue,) = (i for i in report.issues if i.kind == "velocity sign")
    assert issue.where == ROBOT.joints
    assert "pieces" not in issue.what


def test_a_gap_between_two_pieces_is_found(short_pieces):
    t = clean().t.copy()
    t[2000:] += 0.5
    (report,) = check(ROBOT, [replace(clean(), t=t)])
    assert [i.kind for i in report.issues] == ["gap"]
    assert report.facts["gaps"] == 1


def test_a_joint_that_rests_for_a_while_is_no_fault(short_pieces):
    def rests(log, rows):
        still = changed(log, "q", rows, lambda x: np.column_stack([x[:, 0], np.full(len(x), x[0, 1])]))
        return replace(still, v=None, a=None)

    (report,) = check(ROBOT, [rests(clean(), slice(1000, 2200))])
    assert "no motion" not in [i.kind for i in report.issues]
    (report,) = check(ROBOT, [rests(clean(), slice(None))])
    assert "no motion" in [i.kind for i in report.issues]


def test_a_log_of_which_no_piece_can_be_used_is_refused(short_pieces):
    still = Log(clean().t, ROBOT.joints, 0 * clean().q, tau=clean().tau)
    with pytest.raises(InputError, match="no joint moves"):
        check(ROBOT, [still])
