"""The URDF as a prior: chosen by what it predicts, said aloud, and never where the logs speak for themselves."""

import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases import exact_log, robot
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.effects import BASELINE
from frischid.errors import IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators.least_squares import Prior, wls
from frischid.estimators.urdf_prior import PriorCriteria, urdf_priors
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import prepare
from frischid.model.identification import identify
from frischid.motions.simulation import Noise
from frischid.regression.accumulation import accumulate
from frischid.regression.moments import total
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

DATA = os.environ.get("FRISCHID_DATA")
ARM = tuple(f"panda_joint{i}" for i in range(1, 8))
CUTOFF = 6.0


@cache
def arm():
    return fr.Robot.load("panda", joints=ARM)


@cache
def truth():
    """A robot that differs from its URDF: masses by a third, first moments and inertias with them, friction unknown."""
    rng = np.random.default_rng(4)
    machine = arm()
    blocks = machine.nominal.reshape(-1, 10) * rng.uniform(0.65, 1.35, (7, 1))
    values = dict(zip(machine.all_names, blocks.ravel().tolist(), strict=True))
    for i in range(1, 8):
        values |= {f"fv{i}": rng.uniform(0.2, 1), f"fc{i}": rng.uniform(0.1, 0.5), f"off{i}": rng.normal(0, 0.1)}
        values[f"Ia{i}"] = rng.uniform(0.05, 0.3)
    return values


@cache
def log(seconds, seed=1):
    noise = Noise(q=1e-5, tau=0.03)
    return exact_log(arm(), BASELINE, truth(), seconds=seconds, seed=seed, rate=200.0, noise=noise)


@cache
def found(seconds, prior):
    return identify(arm(), [log(seconds)], valid=[log(20.0, seed=8)], cutoff=CUTOFF, recursion="none", prior=prior)


def test_five_seconds_of_seven_joints_need_the_urdf():
    plain, auto = found(5.0, "none"), found(5.0, "auto")
    assert len(plain.model.base) >= 69
    assert auto.prior.prior is not None
    assert auto.prior.strength in PriorCriteria().strengths
    assert auto.comparison.nrmse < 0.95 * plain.comparison.nrmse
    (said,) = [w for w in auto.warnings if "used as a prior" in w]
    assert f"{auto.prior.errors[0.0]:.4f} by the logs alone" in said
    assert auto.model.history[0]["prior"] == {"kind": "urdf", "strength": auto.prior.strength}
    assert auto.model.estimate.estimator == "map"


def test_every_parameter_says_what_came_from_the_log():
    estimate = found(5.0, "auto").model.estimate
    assert estimate.from_data.shape == estimate.theta.shape
    assert ((estimate.from_data >= 0) & (estimate.from_data <= 1)).all()
    friction = [i for i, c in enumerate(estimate.columns) if c.effect == "coulomb"]
    assert estimate.from_data[friction].min() > 0.5  # the URDF says nothing of it
    assert estimate.from_data.min() < 0.5 < estimate.from_data.max()
    again = fr.Model.from_dict(json.loads(json.dumps(found(5.0, "auto").model.to_dict())))
    np.testing.assert_array_equal(again.estimate.from_data, estimate.from_data)
    assert found(5.0, "none").model.estimate.from_data is None


def test_posterior_bounds_hold_the_truth():
    model, reduction = found(5.0, "auto").model, found(5.0, "auto").reduction
    values = [truth().get(c.name, 0.0) for c in reduction.columns]
    error = (model.estimate.theta - reduction.mapping @ values) / model.estimate.stderr
    assert np.abs(error).max() < 5.0
    assert np.sqrt(np.mean(error**2)) < 1.5


def test_long_logs_are_left_alone():
    plain, auto = found(40.0, "none"), found(40.0, "auto")
    assert auto.prior.prior is None
    np.testing.assert_array_equal(plain.model.estimate.theta, auto.model.estimate.theta)
    assert not any("prior" in w for w in auto.warnings)


def test_a_prior_can_be_asked_for():
    forced = found(40.0, "urdf")
    assert forced.prior.prior is not None
    assert forced.comparison.nrmse < 1.1 * found(40.0, "none").comparison.nrmse


def test_hopeless_logs_are_still_refused():
    still = exact_log(robot("planar2"), BASELINE)
    q, v, a = (np.repeat(x[:1], len(still), axis=0) for x in (still.q, still.v, still.a))
    q[:, 0], v[:, 0], a[:, 0] = still.q[:, 0], still.v[:, 0], still.a[:, 0]
    v[:, 1] = a[:, 1] = 0.0
    quiet = fr.Log(still.t, still.joints, q, v=v, a=a, tau=still.tau)
    with pytest.raises(IdentifiabilityError, match="--prior urdf"):
        identify(robot("planar2"), [quiet], cutoff=None, recursion="none")


def test_bad_choices_are_named():
    with pytest.raises(UnknownNameError, match="unknown prior 'cad'"):
        identify(arm(), [log(5.0)], prior="cad")
    with pytest.raises(InputError, match="a prior needs the estimator wls"):
        identify(arm(), [log(5.0)], prior="urdf", estimator="ols")


def blocks():
    machine = robot("planar2")
    motion = prepare(exact_log(machine, BASELINE, noise=Noise(tau=0.02)), LowPass(None)).motions
    regressor = Regressor(machine, BASELINE)
    reduction = structure(regressor, machine.joints)
    full = accumulate(regressor, motion, LowPass(None), machine.joints)
    return regressor, reduction, [g.select(reduction.base) for g in full]


def test_a_prior_is_more_rows_of_data():
    _, _, parts = blocks()
    whole = total(parts)
    p = len(whole.columns)
    prior = Prior(np.arange(p, dtype=float), np.diag(np.linspace(1, 5, p)))
    estimate = wls(parts, prior=prior)
    H = whole.weighted(estimate.weights)
    expected = np.linalg.solve(H[:-1, :-1] + prior.precision, H[:-1, -1] + prior.precision @ prior.mean)
    np.testing.assert_allclose(estimate.theta, expected, rtol=1e-6)


def test_a_weak_prior_changes_nothing_and_a_strong_one_everything():
    regressor, reduction, parts = blocks()
    expressions = reduction.expressions()
    priors = {s: p.of_base(reduction.mapping) for s, p in urdf_priors(regressor, reduction, total(parts)).items()}
    plain, weak, strong = wls(parts), wls(parts, prior=priors[0.01]), wls(parts, prior=priors[10000.0])
    links = [i for i, c in enumerate(reduction.base_columns()) if c.effect == "rigid" and "Ia" not in expressions[i]]
    np.testing.assert_allclose(weak.theta, plain.theta, rtol=1e-2, atol=1e-2)
    assert np.abs(strong.theta - priors[1.0].mean)[links].max() < np.abs(plain.theta - priors[1.0].mean)[links].max()
    assert weak.from_data.min() > 0.99
    assert strong.from_data[links].max() < weak.from_data[links].min()


def test_command(tmp_path):
    fr.write_log(log(5.0), tmp_path / "short.parquet")
    arguments = ["identify", "panda", str(tmp_path / "short.parquet"), "--joints", "panda_joint*", "--cutoff", "6",
                 "--bbrf", "none"]  # fmt: skip
    text = CliRunner().invoke(main, arguments).output
    assert "from data" in text
    assert "the URDF is used as a prior" in text
    data = json.loads(CliRunner().invoke(main, [*arguments, "--json"]).output)
    assert data["prior"]["used"] is True
    assert all(0 <= p["from_data"] <= 1 for p in data["parameters"])
    data = json.loads(CliRunner().invoke(main, [*arguments, "--json", "--prior", "none"]).output)
    assert data["prior"] is None


@pytest.mark.skipif(DATA is None, reason="FRISCHID_DATA is not set")
def test_five_seconds_of_a_real_panda():
    machine = fr.Robot.load(Path(DATA) / "panda/panda.urdf")
    whole, valid = (fr.read_log(Path(DATA) / f"panda/logs/{n}.parquet", machine.joints)
                    for n in ("ident_0_14s", "valid_14_21s"))  # fmt: skip
    start = len(whole) // 3
    short = whole.slice(start, start + int(5 * whole.rate))
    plain, auto = (identify(machine, [short], valid=[valid], recursion="none", prior=p) for p in ("none", "auto"))
    assert auto.prior.prior is not None
    assert auto.comparison.nrmse < plain.comparison.nrmse
