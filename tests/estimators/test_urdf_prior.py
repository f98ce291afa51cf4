"""What the URDF says before any log, and how far off it usually is."""

from dataclasses import replace

import numpy as np
import pytest
from cases import joint, link, made, robot, urdf

import frischid as fr
from frischid.core.types import Column
from frischid.effects import parse_effects
from frischid.estimators.map_estimate import map_estimate
from frischid.estimators.urdf_prior import PriorCriteria, UrdfPrior, link_spread, urdf_prior
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import prepare
from frischid.motions.simulation import simulate
from frischid.motions.trajectory import random_fourier
from frischid.regression.accumulation import accumulate
from frischid.regression.moment_blocks import total
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure


def problem(machine, effects, seed=1):
    """Prior, reduction, moments and the rows behind them, of an unfiltered log."""
    regressor = Regressor(machine, parse_effects(effects))
    reduction = structure(regressor, machine.joints)
    log = simulate(machine, random_fourier(machine, 10.0, seed=seed), rate=50.0)
    (motion,) = prepare(log, LowPass(None)).motions
    grams = accumulate(regressor, [motion], LowPass(None), machine.joints, base=reduction.base)
    blocks = [replace(g, columns=reduction.base_columns()) for g in grams]
    return regressor, reduction, blocks, motion


def test_a_link_of_mass_m_and_size_l_may_be_off_by_a_and_al_and_all():
    machine, criteria = robot("planar2"), PriorCriteria()
    regressor = Regressor(machine, ())
    spread = dict(zip((c.name for c in regressor.columns), link_spread(regressor), strict=True))
    value = dict(zip(machine.all_names, machine.nominal, strict=True))
    heaviest = max(value["m1"], value["m2"])
    for i in "12":
        if f"m{i}" in spread:
            expected = criteria.mass_share * value[f"m{i}"] + criteria.heaviest_share * heaviest
            assert spread[f"m{i}"] == pytest.approx(expected)
        # Σ m r² over the joint's frame is half the trace of the inertia: its root per mass is the link's size
        size = np.sqrt(0.5 * sum(value[f"I{k}{k}{i}"] for k in "xyz") / value[f"m{i}"])
        mass = criteria.mass_share * value[f"m{i}"] + criteria.heaviest_share * heaviest
        assert spread[f"mx{i}"] == pytest.approx(mass * size)
        assert spread[f"Izz{i}"] == pytest.approx(mass * size**2)


def test_an_effect_alone_makes_no_more_torque_than_any_joint_measured():
    machine = robot("ur10")
    regressor, reduction, blocks, motion = problem(machine, "viscous, gravity_tilt")
    prior = urdf_prior(regressor, reduction, total(blocks))
    Y = regressor(motion.t, motion.q, motion.v, motion.a)
    for name in ("fv2", "tilt_x"):
        k = prior.names.index(name)
        power, torque = np.mean(Y[:, k] ** 2, axis=0), np.mean(motion.tau**2, axis=0)
        felt = power > 1e-12 * power.max()
        assert prior.mean[k] == 0.0
        assert prior.spread[k] == pytest.approx(np.sqrt((torque[felt] / power[felt]).min()), rel=0.05), name


def test_a_spring_varies_smoothly_with_the_angle():
    regressor, reduction, blocks, _ = problem(robot("ur10"), "joint_spring(form=curve)@elbow_joint")
    prior, whole = urdf_prior(regressor, reduction, total(blocks)), total(blocks)
    power = np.einsum("pc,pq,qc->c", reduction.mapping, whole.moments[2, :-1, :-1], reduction.mapping, optimize=True)
    alone = {
        n: s * np.sqrt(p / whole.moments[2, -1, -1]) for n, s, p in zip(prior.names, prior.spread, power, strict=True)
    }
    for order, (sine, cosine) in enumerate(
        (("bs3", "bc3"), ("bss3", "bcc3"), ("bsss3", "bccc3"), ("bssss3", "bcccc3")), 1
    ):
        assert [alone[sine], alone[cosine]] == pytest.approx([order**-2] * 2)


def test_a_rotor_of_a_link_without_mass_is_as_doubtful_as_the_link():
    """A URDF that forgets the last link must not tie this joint's rotor to nothing."""
    text = urdf(
        link("base"), link("a", 3.0), link("b", 1e-9), joint("one", "base", "a"), joint("two", "a", "b", axis="0 0 1")
    )
    machine, criteria = made(text), PriorCriteria()
    regressor, reduction, blocks, _ = problem(machine, "rotor_inertia")
    prior = urdf_prior(regressor, reduction, total(blocks), criteria)
    doubt = dict(zip(prior.names, link_spread(regressor), strict=True))["Izz2"]
    assert doubt > 0
    assert prior.negative[prior.names.index("Ia2")] >= criteria.rotor_opposite * doubt * (1 - 1e-12)


def test_a_parameter_that_is_added_keeps_its_known_sign_and_is_nearly_free():
    machine = robot("planar2")
    regressor, reduction, blocks, _ = problem(machine, "viscous")
    fit = map_estimate(blocks, reduction.mapping, urdf_prior(regressor, reduction, total(blocks)))
    columns = [Column("md2", "N·m", "joint2", "magnet", sign=1), Column("ks2", "N·m/rad", "joint2", "spring")]
    wider = UrdfPrior.of(fit).extended(columns, np.array([3.0, -2.0])).parameters
    assert wider.names[-2:] == ("md2", "ks2")
    assert wider.nonnegative[-2:].tolist() == [True, False]
    np.testing.assert_allclose(wider.spread[-2:], [30.0, 20.0])


@pytest.mark.parametrize("times", [3.0, 300.0, 30_000.0])
def test_rotors_behind_high_gears_may_outweigh_the_links(times):
    """Fingers and small servos: the rotor's inertia is hundreds of times that of the links. The prior does no harm."""
    machine = fr.Robot.load("so101")
    regressor, reduction, blocks, _ = problem(machine, "rotor_inertia")
    prior = urdf_prior(regressor, reduction, total(blocks))
    rotors = {n: times * s / 10 for n, s in zip(prior.names, prior.spread, strict=True) if n.startswith("Ia")}
    logs = [
        simulate(
            machine,
            random_fourier(machine, 20.0, seed=seed),
            rate=100.0,
            parameters=rotors,
            noise=fr.Noise(q=1e-5, tau=0.01),
            channels=(),
            seed=seed,
        )
        for seed in (1, 2)
    ]
    found = fr.identify(machine, logs[:1], valid=logs[1:], recursion="none")
    assert found.comparison.nrmse < 0.02
