"""Rules of evidence: many tries, many shapes and correlated logs make a finding less certain, never more."""

from dataclasses import asdict, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from frischid.diagnosis import stepwise_selection
from frischid.diagnosis.block_test import p_value_of
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.candidate_fits import Score
from frischid.diagnosis.change_prior import evidence_prior, prior_before_change, weak_urdf_prior
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.hypotheses import possible
from frischid.diagnosis.improvement import improve
from frischid.diagnosis.scored_candidate import (
    ScoredCandidate,
    parameters_of,
    passes,
    price,
    scored,
    usable_candidates,
)
from frischid.diagnosis.situation import cross_validator
from frischid.diagnosis.stepwise_selection import excluded, likeliest, likeliest_passing, own_parts, with_all
from frischid.diagnosis.verdict import asks_for_explanation
from frischid.diagnosis.weighted_fit import predictive_squares
from frischid.effects import BASELINE, EFFECTS, Formula, JointCoupling, parse_effects
from frischid.estimators.least_squares import Prior
from frischid.logs.log import Log
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

ARM = Robot.load("planar2")
DRY = {"fv1": 0.2, "fv2": 0.2, "fc1": 0.3, "fc2": 0.3}
ONE_COLUMN = ("joint_spring", "quadratic_viscous", "asymmetric_viscous")  # on each joint, one column, no shape
SEARCHED = parse_effects("stribeck(speed=0.1, exponent=2)@joint2")[0]


def log_of(seed: int, effects: str = "", noise: float = 0.01, **values: float) -> Log:
    return simulate(
        ARM,
        random_fourier(ARM, 20.0, seed=seed),
        rate=100.0,
        effects=(*BASELINE, *parse_effects(effects)) if effects else BASELINE,
        parameters=DRY | values,
        noise=Noise(q=0.0, tau=noise),
        channels=(),
        seed=seed,
    )


@cache
def validator() -> CrossValidator:
    log = log_of(1)
    model = identify(ARM, [log], recursion="none").model
    return CrossValidator.of(model, [log], weak_urdf_prior(model))


def found(effect, ratio: float, rows: int = 1000) -> ScoredCandidate:
    """A candidate with one coefficient and some log likelihood ratio, on so many rows."""
    candidate = Candidate(effect, {0: None}, (0,))
    cost = 0.5 * parameters_of(candidate) * np.log(rows)
    return ScoredCandidate(candidate, Score(np.ones((1, 1)), np.ones((1, 1)), np.ones(1)), ratio, cost, 0.1)


# ---------------------------------------------------------------------- many tries


@pytest.mark.parametrize("tried", [10, 100, 1000])
def test_of_many_null_candidates_hardly_ever_one_passes(tried):
    """The family-wise error rate: where no candidate is true, a diagnosis reports one no more often than it says."""
    level, families, rng = 0.05, 400, np.random.default_rng(tried)
    ratios = 0.5 * rng.chisquare(1, (families, tried))  # Wilks: the null law of a likelihood ratio of one parameter
    best = [found(Formula(("joint1",), "t"), float(x), rows=3).p_value(tried) for x in ratios.max(axis=1)]
    alarms = float(np.mean(np.array(best) < level))
    assert alarms < level + 3 * np.sqrt(level * (1 - level) / families)
    assert alarms > 0.2 * level, "and the test is not so strict that it never speaks"


def test_the_p_value_of_the_best_grows_with_the_number_tried():
    best = found(Formula(("joint1",), "t"), 15.0)
    assert 0 < best.p_value(1) < 1e-6
    for tried in (2, 30, 5000):
        assert best.p_value(tried) == pytest.approx(tried * best.p_value(1))
    assert best.p_value(10**9) == 1.0


def test_a_diagnosis_corrects_for_all_that_it_tried():
    """The same spring in the same logs is the less certain the more effects were tried beside it."""
    logs = [log_of(seed, "joint_spring@joint2", noise=0.05, ks2=1.0) for seed in (3, 4)]
    model = identify(ARM, logs[:1], recursion="none").model
    few, many = (diagnose(model, logs, effects=names) for names in (ONE_COLUMN[:1], ONE_COLUMN))
    p = [next(f for f in d.findings if f.effect == "joint_spring").p_value for d in (few, many)]
    assert 1e-200 < p[0] < 1e-3, "a spring that is found, with a p value that is not lost in rounding"
    assert p[1] / p[0] == pytest.approx(len(ONE_COLUMN))


# ---------------------------------------------------------------------- blocks of time


def test_a_short_lived_effect_is_judged_by_the_blocks_in_which_it_acts():
    """Gains of two of forty blocks count for what they are; blocks in which nothing happens do not vote against."""
    rng = np.random.default_rng(3)
    energy = np.full(40, 1e-6)
    energy[[5, 12, 20, 31]] = 1.0
    gains = energy * 2.0 + np.sqrt(energy) * rng.normal(scale=0.3, size=40)
    gains[energy < 1] -= 1e-4  # the fit of another fold is a little worse there
    assert p_value_of(gains) > 0.01
    assert p_value_of(gains, energy) < 1e-4


def test_one_moment_is_no_evidence_however_large_its_gain():
    """A log that begins with a creep out of the standstill: 80 % of the energy of a friction at low speed is there."""
    rng = np.random.default_rng(5)
    energy = np.full(18, 3e-3)
    energy[[0, 3]] = 0.8, 0.15
    gains = energy * rng.normal(scale=3.0, size=18)
    gains[0] = 66.0
    assert p_value_of(gains, energy) > 0.05
    energy[[0, 3]] = 0.5, 0.45
    gains[[0, 3]] = 41.0, 37.0
    assert p_value_of(gains, energy) < 1e-3, "two moments that agree are"


def test_blocks_without_an_effect_are_found_significant_as_often_as_the_level_says():
    rng, level, trials = np.random.default_rng(4), 0.05, 600
    energy = rng.exponential(size=30) ** 2
    alarms = np.mean([p_value_of(np.sqrt(energy) * rng.normal(size=30), energy) < level for _ in range(trials)])
    assert alarms < 2 * level, "the smaller of two p values: at most the sum of their levels"


# ---------------------------------------------------------------------- many shapes


def test_searched_shapes_have_their_price():
    """A shape searched over some parameters pays for each of them as for a coefficient: ½ log n."""
    v = validator()
    (with_shapes,) = v.candidates([SEARCHED])
    (without,) = v.candidates([Formula(("joint2",), "q2*sign(v2)")])
    half_log_n = 0.5 * np.log(v.counts.sum(axis=0)[1])
    searched = len(SEARCHED.searched)
    assert searched > 0
    assert price(v, without) == pytest.approx(half_log_n)
    assert price(v, with_shapes) == pytest.approx((1 + searched) * half_log_n)
    for candidate in (with_shapes, without):
        result = scored(v, [candidate])
        assert result.price == price(v, candidate)
        assert result.gain == result.ratio - result.price


def test_the_same_likelihood_is_worth_less_with_a_searched_shape():
    plain, searched = (found(effect, 9.0) for effect in (Formula(("joint2",), "q2*sign(v2)"), SEARCHED))
    assert plain.ratio == searched.ratio
    assert plain.gain > searched.gain
    assert plain.p_value(1) < 1e-4
    assert searched.p_value(1) > 100 * plain.p_value(1)


def test_a_gain_that_does_not_pay_for_its_shapes_is_none():
    one, three = (found(effect, 5.0) for effect in (Formula(("joint2",), "t"), SEARCHED))
    assert one.gain > 0
    assert one.p_value(1) < 0.01
    assert three.gain < 0
    assert three.p_value(1) == 1.0


# ---------------------------------------------------------------------- folds that excite little


@pytest.mark.parametrize("strength", [1e-3, 1.0, 1e3])
def test_the_predictive_error_is_the_held_out_error_by_its_covariance(strength):
    """Q of `weighted_fit`, computed the long way: with the covariance of a fold's residual."""
    rng = np.random.default_rng(4)
    rows, omega = 40, np.array([2.0, 0.5])
    blocks, tau = rng.normal(size=(2, rows, 5)), rng.normal(size=(2, rows))
    Y, weights = np.concatenate(blocks), np.repeat(omega, rows)
    others = rng.normal(size=(30, 5)) * strength
    H, theta = others.T @ others, rng.normal(size=5)
    whole = np.linalg.solve(H + Y.T @ (weights[:, None] * Y), H @ theta + Y.T @ (weights * tau.ravel()))
    left = np.stack([tau - blocks @ theta, tau - blocks @ whole], axis=-1)  # (2, rows, 2)
    products = left.swapaxes(1, 2) @ left
    residual = left[..., 0].ravel()
    expected = residual @ np.linalg.solve(np.diag(1 / weights) + Y @ np.linalg.solve(H, Y.T), residual)
    found = predictive_squares(products, omega)
    assert omega @ found == pytest.approx(expected, rel=1e-9)
    assert (found > 0).all()


def test_less_error_on_a_fold_that_another_fold_hardly_predicts_is_no_evidence():
    """A small motion leaves parameters open, so any candidate may happen to predict a large motion better.

    The arm is healthy. Held-out errors alone would name a spring, with a likelihood ratio of e^70.
    """
    arm, logs = Robot.load("z1"), []
    dry = {f"{kind}{n}": x for n in range(1, len(arm.joints) + 1) for kind, x in (("fv", 0.2), ("fc", 0.3))}
    for seed, scale in ((0, 0.1), (50, 0.7)):
        motion, noise = random_fourier(arm, 20.0, seed=seed, scale=scale), Noise(q=0.0, tau=0.05)
        logs.append(simulate(arm, motion, rate=100.0, effects=BASELINE, parameters=dry, noise=noise, seed=seed))
    model = identify(arm, logs[:1], recursion="none").model
    v = CrossValidator.of(model, logs, weak_urdf_prior(model))
    kinds = [EFFECTS[name] for name in ("joint_spring", "asymmetric_viscous", "joint_coupling")]
    tried = usable_candidates(v, [places for kind in kinds for places in kind.candidates(arm)])
    found = [x for shapes in tried if shapes and (x := scored(v, shapes)) is not None]
    outside = [v.log_likelihood(v.base_sse(), x.score.sse, v.effective) for x in found]
    assert max(outside) > 30
    assert not any(passes(v, x, len(found)) for x in found)


# ---------------------------------------------------------------------- certainty of an identification


def with_slow_noise(log: Log, seed: int, correlation: float = 0.98, size: float = 0.1) -> Log:
    """The log with torque noise that remembers itself for about a second: an autoregression of first order."""
    x, tau = np.random.default_rng(seed).normal(size=log.tau.shape), np.array(log.tau)
    for k in range(1, len(x)):
        x[k] = correlation * x[k - 1] + np.sqrt(1 - correlation**2) * x[k]
    return replace(log, tau=tau + size * x)


@cache
def identified(seed: int):
    return identify(ARM, [with_slow_noise(log_of(1, noise=0.0), seed)], effects=BASELINE, recursion="none").model


def test_the_prior_of_a_changed_robot_has_the_spread_that_the_estimate_has_on_another_motion():
    """Noise averages out over a log and the model's error does not, so a share of the covariance is there elsewhere."""
    model = identified(1)
    prior = prior_before_change(model)
    np.testing.assert_array_equal(prior.mean, model.estimate.theta)
    ratio = np.diag(np.linalg.inv(prior.precision)) / np.diag(model.estimate.covariance)
    np.testing.assert_allclose(ratio, model.fitted.model_share.mean(), rtol=1e-3)


def test_under_the_evidence_prior_the_squared_residual_is_the_evidence():
    """Both sides of e'(I + Y P Y')⁻¹e = ‖τ − Y θ'‖², with θ' fitted under the stronger prior."""
    rng = np.random.default_rng(3)
    Y, mean, root = rng.normal(size=(40, 5)), rng.normal(size=5), rng.normal(size=(5, 5)) * 10.0 ** np.arange(-2, 3)
    tau = Y @ mean + rng.normal(size=40)
    known = Prior(mean, np.linalg.inv(root.T @ root))
    stronger = evidence_prior(known, Y.T @ Y)
    theta = np.linalg.solve(Y.T @ Y + stronger.precision, Y.T @ tau + stronger.precision @ mean)
    e = tau - Y @ mean
    evidence = e @ np.linalg.solve(np.eye(40) + Y @ root.T @ root @ Y.T, e)
    assert np.square(tau - Y @ theta).sum() == pytest.approx(evidence, rel=1e-6)


def test_a_change_is_not_put_into_the_parameters_from_before():
    """A small payload leaves a residual on new logs, because the old parameters are known too well to explain it."""
    hidden = (*BASELINE, *parse_effects("payload@joint2"))
    before = [simulate(ARM, random_fourier(ARM, 30.0, seed=1), rate=100.0, noise=Noise(tau=0.05), seed=1)]
    after = [
        simulate(
            ARM,
            random_fourier(ARM, 30.0, seed=seed),
            rate=100.0,
            effects=hidden,
            parameters={"dm2": 0.1, "dmx2": 0.04},
            noise=Noise(tau=0.05),
            seed=seed,
        )
        for seed in (2, 3)
    ]
    found = diagnose(identify(ARM, before, recursion="none").model, after)
    assert (found.verdict, found.situation) == ("effect", "changed")
    assert max(found.probabilities, key=found.probabilities.__getitem__) == "payload"


def test_a_changed_robot_is_not_held_to_more_certainty_than_there_is():
    """In units of the prior the error of p parameters has the expected square p, also where noise is correlated."""
    truth = identify(ARM, [log_of(1, noise=0.0)], effects=BASELINE, recursion="none").model.estimate.theta
    squares = []
    for seed in range(12):
        prior = prior_before_change(identified(seed))
        error = prior.mean - truth
        squares.append(error @ prior.precision @ error / len(truth))
    assert 0.2 < np.mean(squares) < 3.0


# ---------------------------------------------------------------------- criteria


def test_results_carry_the_criteria_that_were_used():
    model, log = validator().model, log_of(1)
    strict = replace(DiagnosisCriteria(), significance=1e-9, max_entered=1)
    result = diagnose(model, [log], effects=ONE_COLUMN[:1], criteria=strict)
    assert result.to_dict()["criteria"] == asdict(strict)
    assert all(f.criteria is strict for f in result.findings if f.members)
    assert improve(model, [log], max_steps=0, criteria=strict)[1].criteria is strict


@pytest.mark.parametrize("change", [{"significance": 0.0}, {"smallest_error": 1.0}, {"block_p_value": 0.0}])
def test_each_criterion_of_a_finding_decides(change):
    """A spring that everybody finds is not found under a criterion that nothing meets."""
    logs = [log_of(seed, "joint_spring@joint2", noise=0.05, ks2=1.0) for seed in (3, 4)]
    model = identify(ARM, logs[:1], recursion="none").model
    assert diagnose(model, logs, effects=ONE_COLUMN[:1]).findings[0].significant
    strict = replace(DiagnosisCriteria(), **change)
    assert not any(f.significant for f in diagnose(model, logs, effects=ONE_COLUMN[:1], criteria=strict).findings)


def test_a_shift_that_explains_as_much_as_the_opposite_one_is_no_delay():
    late = [log_of(seed, "time_delay", delay=0.02) for seed in (1, 2)]
    found = diagnose(identify(ARM, late[:1], recursion="none").model, late, effects=["time_delay"])
    assert found.findings[0].effect == "time_delay"
    assert found.findings[0].significant
    assert found.findings[0].parameters["delay"] == pytest.approx(0.02, rel=0.1)
    noisy = [
        simulate(
            ARM,
            random_fourier(ARM, 20.0, seed=seed),
            rate=100.0,
            parameters=DRY,
            noise=Noise(q=3e-4, tau=0.01),
            channels=(),
            seed=seed,
        )
        for seed in (1, 2)
    ]
    model = identify(ARM, noisy[:1], recursion="none", cutoff=10.0).model  # too high for these positions
    seen = diagnose(model, noisy, effects=["time_delay"])
    assert seen.verdict == "none", "a mean over shifts hides noise in the accelerations, and is no delay"
    assert any("identify with a lower cut-off than 10 Hz" in note for note in seen.notes)


def test_effects_with_the_same_parameters_exclude_each_other():
    def of(text):
        effect, *beside = parse_effects(text)
        candidate = Candidate(effect, {}, (), beside=tuple(beside))
        return SimpleNamespace(effect=effect, candidate=candidate)

    total, difference = of("joint_coupling(ratio=1)@joint1+joint2"), of("joint_coupling(ratio=-1)@joint1+joint2")
    assert not excluded(total, difference), "the two motors of a differential"
    assert excluded(of("cogging(order=6)@joint1"), of("cogging(order=12)@joint1"))  # A1 and B1 of both
    assert not excluded(of("joint_spring@joint1"), of("hysteresis@joint1"))
    spring, offset = of("joint_spring@joint1, offset_change@joint1"), of("offset_change@joint1")
    assert excluded(spring, offset), "both have the column of the offset"
    assert excluded(offset, spring)
    assert excluded(spring, of("cable_hose@joint1, offset_change@joint1"))
    assert not excluded(spring, of("cable_hose@joint2, offset_change@joint2"))
    assert not excluded(spring, of("hysteresis@joint1, friction_change@joint1"))


@pytest.mark.parametrize(("rubbing", "effect"), [(0.0, "joint_spring"), (0.3, "cable_hose")])
def test_a_spring_is_named_in_place_of_a_hose_only_where_nothing_rubs(rubbing, effect):
    """A hose contains a spring, which explained nine tenths: the spring was named at 92 %, the hose at 7 %."""

    def with_hose(log: Log) -> Log:
        q, z = log.q[:, 1], np.zeros(len(log.t))
        for k, step in enumerate(np.diff(q), 1):  # the strands of the hose rub over 0.12 rad
            z[k] = z[k - 1] + (step - abs(step) * z[k - 1]) / 0.12
        return replace(log, tau=log.tau + np.outer(2.0 * q + rubbing * z, [0.0, 1.0]))

    logs = [with_hose(log_of(seed)) for seed in (3, 4)]
    found = diagnose(identify(ARM, logs[:1], recursion="none").model, logs)
    first = found.findings[0]
    assert (first.effect, first.joints) == (effect, ("joint2",))
    assert first.probability > 0.8
    names = {f.effect: f for f in found.findings}
    assert names["joint_spring"].removed > 0.9 * names["cable_hose"].removed, "nearly all of the error"


@pytest.mark.parametrize(("known", "tried"), [("viscous, coulomb, offset", 0), ("viscous, coulomb", 1)])
def test_what_differs_from_the_model_at_standstill_alone_is_no_candidate(known, tried):
    """A gantry stood still for a tenth of a second twice; direction-dependent dry friction had a probability of 0.99.

    Beside an offset this friction differs from the model only where dry friction is undetermined.
    """
    log = log_of(1)
    model = identify(ARM, [log], effects=parse_effects(known), recursion="none").model
    asymmetric = parse_effects("asymmetric_coulomb@joint2")
    base = CrossValidator.of(model, [log], weak_urdf_prior(model))
    assert [len(c) for c in usable_candidates(base, [asymmetric])] == [tried]
    said = [note for note in diagnose(model, [log], effects=["asymmetric_coulomb"]).notes if "not tried" in note]
    assert len(said) == 1 - tried
    assert all("as offset, and at standstill" in note for note in said)


@pytest.mark.parametrize("ratio", [1.0, -0.4, 2.7, 0.8, -1.2])
def test_the_ratio_of_a_coupling_is_searched_and_that_of_a_sum_needs_none(ratio):
    """A wrist of ratio -0.4 had its motor found at ratio -1, and improve then saw somebody touch the robot 25 times."""

    def coupled(log: Log) -> Log:
        speed = np.gradient(log.q, log.t, axis=0) @ [1.0, ratio]
        torque = 0.4 * speed + 0.5 * np.sign(speed)
        return replace(log, tau=log.tau + np.outer(torque, [1.0, ratio]))

    logs = [coupled(log_of(seed)) for seed in (3, 4)]
    first = diagnose(identify(ARM, logs[:1], recursion="none").model, logs).findings[0]
    assert first.effect == "joint_coupling"
    assert first.probability > 0.8
    (found,) = first.members
    assert found.ratio == (1.0 if ratio == 1.0 else pytest.approx(ratio, rel=0.1))
    number = "1_m2" if ratio < 0 else "1_2"
    assert first.parameters[f"fvm{number}"] == pytest.approx(0.4, rel=0.15)
    assert first.parameters[f"fcm{number}"] == pytest.approx(0.5, rel=0.15)


def test_improve_adds_both_motors_of_a_differential():
    """One motor turns with the sum of two joints, one with their difference; their parameters had the same names."""

    def driven(log: Log) -> Log:
        motors = np.array([[1.0, 1.0], [1.0, -1.0]])
        speeds = np.gradient(log.q, log.t, axis=0) @ motors.T
        return replace(log, tau=log.tau + (np.array([0.4, 0.7]) * np.tanh(speeds / 0.02)) @ motors)

    logs = [driven(log_of(seed)) for seed in (3, 4)]
    model = identify(ARM, logs[:1], recursion="none").model
    better = improve(model, logs, effects=["joint_coupling"])[0][-1].model
    added = {e for e in better.effects if e.id == "joint_coupling"}
    assert {e.ratio for e in added} == {1.0, -1.0}
    estimate = {c.name: x for c, x in zip(better.estimate.columns, better.estimate.theta, strict=True)}
    found = {name: estimate[name] for name in ("fcm1_2", "fcm1_m2")}
    assert found == pytest.approx({"fcm1_2": 0.4, "fcm1_m2": 0.7}, rel=0.15)


def test_a_coupling_needs_the_torques_of_both_joints():
    """Without one of them, the other's torque only follows a motion that is not its own."""
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 8.0, seed=0), rate=50.0, noise=Noise(tau=0.01))
    for joints, count in ((None, 1), (("joint1",), 0)):
        model = identify(robot, [log], torque_joints=joints, recursion="none").model
        validator, _ = cross_validator(model, [log], "always")
        places = JointCoupling.candidates(robot)
        assert [len(x) for x in usable_candidates(validator, places)] == [count * len(shapes) for shapes in places]


@pytest.mark.parametrize(("residual", "asks"), [(0.00407, False), (0.0046, True), (0.0022, False)])
def test_an_error_asks_for_an_explanation_where_an_effect_could_explain_more_than_a_negligible_one(residual, asks):
    # without its noise, an error of 0.0041 is below the 0.004 that an effect must explain
    criteria = DiagnosisCriteria()
    found = asks_for_explanation(np.array([residual]), np.array([0.0019]), SimpleNamespace(criteria=criteria))
    assert found.tolist() == [asks]
    assert asks == (residual**2 - 0.0019**2 > criteria.smallest_error**2)


@pytest.mark.parametrize(
    ("share", "negligible", "words"), [(0.0, True, "–"), (0.0, False, "0 %"), (0.5, False, "50 %")]
)
def test_an_effect_has_no_share_of_a_negligible_error(share, negligible, words):
    one = Finding("stribeck", (), 0.004, 0.002, 50.0, 2e-5, share, 2.5, 2.5, 0.0, 1e-6, {}, (), "", ())
    finding = replace(one, negligible=negligible)
    assert finding.explains == words
    assert ("is negligible" in finding.withheld) == negligible


@pytest.mark.parametrize("absent", [False, True])
def test_what_explains_an_error_at_reversals_is_a_cause_only_if_the_motion_shows_it(absent):
    one = Finding("time_delay", ("joint3",), 0.04, 0.02, 50.0, 2e-3, 0.9, 0.0, 0.0, 0.0, 1e-6, {}, (), "", ())
    one = replace(one, absent_in_motion=absent)
    assert one.sure
    assert one.significant != absent
    assert one.pays != absent
    assert bool(possible([one])) != absent
    assert ("the motion shows less than half of the effect" in one.refused) == absent


@pytest.mark.parametrize(("by_noise", "cause"), [(0.0, True), (1e-3, True), (2e-3, False), (3e-3, False)])
def test_an_effect_that_explains_no_more_than_on_the_healthy_twin_is_no_cause(by_noise, cause):
    """A healthy SCARA had an asymmetric friction with 99 %, and its twin had as much of it."""
    one = Finding("stribeck", (), 0.04, 0.02, 50.0, 2e-3, 0.9, 2.5, 2.5, by_noise, 1e-6, {}, (), "", ())
    assert one.significant == cause
    assert bool(possible([one])) == cause
    assert one.pays == cause
    assert cause or "a robot that misses nothing" in one.refused


@pytest.mark.parametrize(("distance", "said"), [(0.0005, "rad or less"), (0.002, "rad"), (0.06, "rad or more")])
def test_a_shape_at_the_end_of_the_values_tried_is_a_bound(distance, said):
    (member,) = parse_effects(f"hysteresis(distance={distance})@joint1")
    values = {"fh1": 0.2}
    one = Finding("hysteresis", ("joint1",), 0.04, 0.02, 50, 2e-3, 0.9, 3, 3, 0.0, 1e-6, values, (), "", (member,))
    assert one.found(ARM)[1] == ("distance", distance, said)


def imitators():
    """Two joints of one log with a spring each, scored alone; and the validator of the model without them."""
    hidden = "joint_spring@joint1,joint_spring@joint2"
    log = log_of(7, hidden, ks1=2.0, ks2=2.0)
    base = CrossValidator.of(model := identify(ARM, [log], recursion="none").model, [log], weak_urdf_prior(model))
    kinds = parse_effects("joint_spring@joint1,joint_spring@joint2,asymmetric_viscous@joint1")
    return base, [scored(base, [c]) for c in base.candidates(list(kinds))]


def test_the_parts_of_effects_add_up_to_all_that_they_explain_together():
    base, (one, two, third) = imitators()
    parts = own_parts(base, [one, two, third])
    before, after = (x.predictive_nrmse() ** 2 for x in (base, with_all(base, [one, two, third])))
    assert sum(x.part for x in parts) == pytest.approx(float((before - after).sum()), rel=1e-9)
    assert all(x.new == 0.0 for x in parts), "no residual was known before"
    alone = own_parts(base, [one])[0]
    assert alone.part == pytest.approx(alone.unique)
    assert own_parts(base, []) == []
    swapped = own_parts(base, [third, two, one])
    # the weights of the joints follow the candidates one by one, so the order changes a little
    np.testing.assert_allclose(np.array(swapped[::-1]), np.array(parts), atol=1e-2 * sum(x.part for x in parts))


def test_an_error_that_two_candidates_explain_counts_half_for_each():
    base, (one, two, _) = imitators()
    (first, second) = own_parts(base, [one, two])
    worth = {k: own_parts(base, [k])[0].unique for k in (one, two)}
    both = first.part + second.part
    assert first.part == pytest.approx((worth[one] + both - worth[two]) / 2)
    assert first.unique == pytest.approx(both - worth[two])


def test_places_of_one_effect_count_together_against_an_effect_of_all_their_joints():
    base, (one, two, third) = imitators()
    wide = replace(one, candidate=base.joined([one.candidate, two.candidate]))
    wide = replace(wide, candidate=replace(wide.candidate, effect=parse_effects("time_delay")[0]))

    def fresh(explained):
        found = [(one, 0.6), (two, 0.5), (third, 0.1), (wide, explained)]
        return [(c, replace(c, explained=x * one.explained)) for c, x in found]

    together = scored(base, [base.joined([one.candidate, two.candidate])]).explained / one.explained
    assert likeliest(base, fresh(0.9 * together)) is one, (
        "the springs explain more than the delay, though neither alone"
    )
    assert likeliest(base, fresh(1.1 * together)) is wide
    assert likeliest(base, fresh(0.4)) is one


def test_what_does_not_pass_takes_the_place_of_no_other(monkeypatch):
    """A SCARA warmed on one joint, and a few reversals of another joint were worse: these had taken the place."""
    base, (one, two, third) = imitators()
    found = [(c, c) for c in sorted((one, two, third), key=lambda c: -c.explained)]
    (large, _), (small, _), (third, _) = found
    for refused, expected in (((), large), ((large,), small), ((large, small), third)):
        names = [c.effect for c in refused]
        monkeypatch.setattr(stepwise_selection, "passes", lambda v, x, tried, names=names: x.effect not in names)
        assert likeliest_passing(base, found, third, 3) is expected
    monkeypatch.setattr(stepwise_selection, "passes", lambda v, x, tried: False)
    assert likeliest_passing(base, found[:2], third, 3) is None
