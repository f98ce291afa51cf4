"""How much faster than its logs a model may move: a figure beside the headline, never a claim beyond the data."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.logs.readers import write_log
from frischid.model.alarms import LEFT_OPEN, AlarmCriteria
from frischid.model.speed_range import LARGEST_FACTOR, speed_range
from frischid.motions.trajectory import random_fourier
from frischid.regression.regressor import Regressor
from frischid.robot.robot import Robot

ROBOT = Robot.load("planar2")
LOG = fr.simulate(ROBOT, random_fourier(ROBOT, 10, seed=1), rate=100, noise=fr.Noise(q=1e-5, tau=0.5))
FOUND = fr.identify(ROBOT, [LOG], recursion="none")
USUAL = float(np.mean(list(FOUND.cross_validation.values())))


def expected(factor):
    """Error to expect where the fitted motion runs faster, over the torque's standard deviation there."""
    model = FOUND.model
    (motion,) = model.motions([LOG])
    states = (motion.t / factor, motion.q, factor * motion.v, factor**2 * motion.a)
    regressor = Regressor(model.robot, model.effects, model.reference)
    Y = regressor(*states)[:, list(model.base)]
    squares = (model.estimate.parameter_variance(Y) * model.fitted.model_share).mean(axis=0)
    return float(np.mean(np.sqrt(model.estimate.sigma**2 + squares) / model.fitted.spread))


def test_at_the_factor_told_the_expected_error_passes_the_limit_of_the_alarm():
    model, criteria = FOUND.model, AlarmCriteria(extrapolation=1.3)
    told = speed_range(model, list(model.motions([LOG])), USUAL, criteria)
    assert 1.0 < told.doubles < told.allowed
    assert expected(told.doubles) <= 1.31 * USUAL
    assert expected(1.1 * told.doubles) > 1.29 * USUAL


def test_the_speed_limits_of_the_urdf_end_the_range(tmp_path):
    assert FOUND.speed_range.allowed == pytest.approx(
        min(ROBOT.limits.velocity / FOUND.model.fitted.velocity), rel=1e-6
    )
    path = tmp_path / "free.urdf"
    path.write_text(ROBOT.urdf.replace('velocity="5"', 'velocity="0"'), encoding="utf-8")
    free = Robot.load(path)
    model = fr.identify(free, [LOG], recursion="none").model
    assert speed_range(model, list(model.motions([LOG])), USUAL, AlarmCriteria(extrapolation=1e9)) == (
        LARGEST_FACTOR,
        LARGEST_FACTOR,
    )


def test_nothing_is_told_without_a_prior_nor_where_the_logs_leave_the_model_open():
    assert fr.identify(ROBOT, [LOG], recursion="none", prior="none").speed_range is None
    short = fr.identify(ROBOT, [LOG.slice(0, 150)], recursion="none", alarm_criteria=AlarmCriteria(disagreement=0.0))
    assert LEFT_OPEN in {alarm.id for alarm in short.alarms}
    assert short.speed_range is None


def test_every_surface_tells_it(tmp_path):
    log, model = tmp_path / "log.parquet", tmp_path / "model.json"
    write_log(LOG, log)
    words = ["identify", "planar2", str(log), "-o", str(model)]
    page = json.loads(CliRunner().invoke(main, [*words, "--json"]).output)
    assert page["speed_range"] == FOUND.speed_range._asdict() == fr.Model.load(model).history[-1]["speed_range"]
    assert str(FOUND.speed_range) in " ".join(CliRunner().invoke(main, words).output.split())
    page = tmp_path / "page.html"
    CliRunner().invoke(main, ["report", str(model), str(log), "-o", str(page)])
    assert "On the path of the fitted logs, the cross-validated error is" in page.read_text(encoding="utf-8")
