"""Probabilities of a diagnosis: they sum to one, follow from the evidence, and agree with the sentences beside them."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from frischid.cli.pages.improving import diagnosis as page_of
from frischid.diagnosis.clause import missing
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.floor import error_of, refuted
from frischid.diagnosis.hypotheses import OTHERS, Evidence, evidence_of
from frischid.diagnosis.probability import DATA, Weights, chances, fitted, probabilities
from frischid.diagnosis.result import Diagnosis
from frischid.diagnosis.rivals import IN_WORDS, beside, command_for, pair_of, rivals, sentence_of
from frischid.diagnosis.situation import cross_validator
from frischid.diagnosis.verdict import concluded
from frischid.effects import BASELINE, EFFECTS, parse_effects
from frischid.model.identification import identify
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot

ARM = Robot.load("planar2")
HIDDEN = {
    "healthy": ("", {}),
    "spring": ("joint_spring@joint2", {"ks2": 2.0}),
    "unknown": ('formula("q2*sign(v1)")@joint1', {"c[q2*sign(v1)]1": 1.5}),
    "two": ("joint_spring@joint2, quadratic_viscous@joint1", {"ks2": 1.0, "fvv1": 0.3}),
    "slow noise": ("", {}),
}


@cache
def found(name: str) -> Diagnosis:
    effect, values = HIDDEN[name]
    logs = [
        simulate(
            ARM,
            random_fourier(ARM, 20, seed=seed),
            rate=50,
            effects=(*BASELINE, *parse_effects(effect)),
            parameters={"fc1": 0.5, "fc2": 0.3, "fv1": 0.4, "fv2": 0.2, **values},
            noise=Noise(q=1e-5, tau=0.02),
            channels=(),
            seed=seed,
            name=f"{name} {seed}",
        )
        for seed in (1, 2)
    ]
    if name == "slow noise":
        rng = np.random.default_rng(0)
        for k, log in enumerate(logs):
            x = rng.normal(size=log.tau.shape)
            for i in range(1, len(x)):
                x[i] = 0.8 * x[i - 1] + 0.6 * x[i]
            logs[k] = replace(log, tau=log.tau + 0.02 * log.tau.std(axis=0) * x)
    return diagnose(identify(ARM, logs[:1], recursion="none").model, logs)


every_case = pytest.mark.parametrize("name", HIDDEN)


@every_case
def test_no_sentence_contradicts_the_table_beside_it(name):
    result = found(name)
    chance = result.probabilities
    assert sum(chance.values()) == pytest.approx(1.0)
    assert set(OTHERS) <= set(chance)
    named = [f for f in result.findings if f.significant]
    for f in result.findings:
        if f.effect in EFFECTS:
            assert f.probability == chance.get(f.effect, 0.0)
    # the verdict and the table
    if result.verdict == "none":
        assert not named
    if result.verdict == "effect":
        assert result.findings[0].significant
    if result.verdict in {"unknown", "several", "contact"}:
        assert result.findings[0].effect == result.verdict
        assert result.findings[0].probability == chance["outside" if result.verdict == "unknown" else result.verdict]
    # sentences and numbers
    text = " ".join(str(part) for part in page_of(result).parts if isinstance(part, str))
    for words in IN_WORDS.values():
        assert words in text
    if named and result.verdict == "unknown":
        assert "known effects explain a part" in text
    told = missing(result)
    if result.verdict in {"effect", "unknown"} and named:
        assert named[0].effect in told
        assert (f"{100 * named[0].probability:.0f} %" in told) == (result.verdict == "effect")
    best = next((f for f in named if f.members), None)
    if result.verdict != "contact" and rivals(result.findings, chance):
        said = f"{best.effect} ({100 * best.probability:.0f} %)"
        assert any(said in note for note in result.notes)
    if best is not None and best.probability >= result.criteria.sure_probability:
        assert not rivals(result.findings, chance)
    # plain JSON values: the judgement is there, a p value is not
    data = json.loads(json.dumps(result.to_dict()))
    assert data["probabilities"] == pytest.approx(chance)
    for one, f in zip(data["findings"], result.findings, strict=True):
        assert one["significant"] == f.significant
        assert one["withheld"] == f.withheld
        assert one["probability"] == f.probability
        assert "p_value" not in one


def test_a_clear_effect_is_probable_and_a_healthy_robot_lacks_none():
    spring, healthy = found("spring"), found("healthy")
    assert (spring.verdict, spring.findings[0].effect) == ("effect", "joint_spring")
    assert spring.findings[0].probability == max(spring.probabilities.values()) > 0.7
    assert healthy.verdict == "none"
    assert healthy.probabilities["none"] > 0.5


def test_slow_noise_is_no_alarm():
    """Torque noise with a memory is no physics: no effect of the catalogue is called probable."""
    result = found("slow noise")
    assert not any(f.significant and f.probability > 0.5 for f in result.findings)


def evidence(**scores: float) -> Evidence:
    return Evidence(tuple(scores), tuple({"score": x} for x in scores.values()))


def test_probability_follows_the_evidence():
    told = chances(evidence(a=0.0, b=np.log(3.0)).to_dict(), Weights({"score": 1.0}))
    np.testing.assert_allclose(told, [0.25, 0.75])
    huge = chances(evidence(a=-1e6, b=1e6, c=0.0).to_dict(), Weights({"score": 1.0}))
    np.testing.assert_allclose(huge, [0.0, 1.0, 0.0])


def test_a_fit_recovers_the_law_that_made_the_cases():
    """Cases drawn from known weights: the fit's probabilities are calibrated, and near the true ones."""
    rng, truth = np.random.default_rng(0), Weights({"a": 2.0, "b": -1.0})
    cases = []
    for _ in range(600):
        told = [{"hypothesis": str(k), "a": float(rng.normal()), "b": float(rng.normal())} for k in range(3)]
        right = str(rng.choice(3, p=chances(told, truth)))
        cases.append((told, [right]))
    weights, _ = fitted(cases)
    assert weights.values["a"] == pytest.approx(2.0, abs=0.4)
    assert weights.values["b"] == pytest.approx(-1.0, abs=0.3)


def test_of_several_right_answers_the_first_has_the_probability():
    """Two of four hypotheses are right: the answer's probability is the share of right answers, not half of it."""
    rng, cases = np.random.default_rng(0), []
    for _ in range(600):
        right = [str(k) for k in rng.permutation(4)[:2]]
        told = [{"hypothesis": str(k), "a": float(rng.normal(1.0 * (str(k) in right)))} for k in range(4)]
        cases.append((told, right))
    weights, _ = fitted(cases[:400])
    stated, correct = [], []
    for told, right in cases[400:]:
        chance = chances(told, weights)
        best = int(np.argmax(chance))
        stated.append(chance[best])
        correct.append(str(best) in right)
    assert np.mean(stated) == pytest.approx(np.mean(correct), abs=0.06)
    assert np.mean(correct) > 0.7


def test_a_case_whose_right_answer_is_no_hypothesis_is_left_out():
    told = [{"hypothesis": name, name: 1.0} for name in "abc"]
    weights, _ = fitted([(told, ["a"])] * 50)
    both, _ = fitted([(told, ["a"]), (told, ["d"])] * 50)
    assert weights == both


def test_of_effects_that_explain_the_same_the_one_with_fewer_shapes_is_likelier():
    named = [f for f in found("two").findings if f.effect in {"joint_spring", "quadratic_viscous"}]
    ripple = EFFECTS["cogging"](joints=named[0].joints)
    first = replace(named[0], effect="cogging", confused_with=("joint_spring",), members=(ripple,))
    second = replace(named[0], effect="joint_spring", confused_with=("cogging",), entered=False, own=0.0)
    noise = np.zeros(2)
    told = evidence_of([first, second], (noise + 0.1, noise + 0.05), (noise, noise), "effect", unmodelled=False)
    many, few = told.values[:2]
    assert many["more shapes"] == pytest.approx(np.log(len(EFFECTS["cogging"].shapes["order"])))
    assert few["more shapes"] == 0.0
    assert Weights.load().values["more shapes"] < 0


def test_two_effects_with_the_same_columns_have_the_same_probability():
    """A tilt of the base of a planar arm is a wrong zero of its first joint."""
    named = [f for f in found("two").findings if f.effect in {"joint_spring", "quadratic_viscous"}]
    zero = replace(named[0], effect="encoder_zero", confused_with=("gravity_tilt",))
    tilt = replace(named[0], effect="gravity_tilt", confused_with=("encoder_zero",), entered=False, own=0.0)
    noise = np.zeros(2)
    for other, alike in ((tilt, True), (replace(tilt, gain=0.9 * tilt.gain), False)):
        told = evidence_of([zero, other], (noise + 0.1, noise + 0.05), (noise, noise), "effect", unmodelled=False)
        chance = probabilities(told)
        assert (abs(chance["gravity_tilt"] - chance["encoder_zero"]) < 1e-9) == alike
        assert chance["encoder_zero"] >= chance["gravity_tilt"]


def test_the_shipped_weights_say_where_they_come_from():
    data = json.loads(DATA.read_text())
    assert sum(data["cases"].values()) >= 100
    assert data["made by"] == "benchmarks/calibration.py --fit"
    used = {k for e in found("spring").evidence.values for k in e}
    assert used <= set(data["weights"]), "every number of evidence has a weight"
    assert probabilities(found("spring").evidence) == found("spring").probabilities


def test_below_four_fifths_the_rivals_are_told_with_the_motion_that_separates_them():
    result = found("two")
    first, second = (f for f in result.findings if f.effect in {"joint_spring", "quadratic_viscous"})
    members = tuple(replace(effect, joints=first.members[0].joints) for effect in second.members)
    elsewhere, second = second, replace(second, probability=0.25, members=members)
    shared = [replace(first, probability=0.6), second]
    chance = {first.effect: 0.6, second.effect: 0.25, "none": 0.0, "several": 0.12, "outside": 0.03, "contact": 0.0}
    assert [r.name for r in rivals(shared, chance)] == [second.effect, "several"]
    command = command_for(pair_of(shared, chance))
    pair = parse_effects(command.split("--separate ")[1].split()[0])
    assert [e.id for e in pair] == [first.effect, second.effect]
    sentence = sentence_of(shared, chance)
    assert f"{first.effect} (60 %), {second.effect} (25 %) or several small effects" in sentence
    assert command in sentence
    named = command_for(pair_of(shared, chance), "my arm.urdf")
    assert named.startswith("frischid excite 'my arm.urdf' --separate ")  # the command works as printed
    assert f"`{named}`" in sentence_of(shared, chance, "my arm.urdf")
    arm = Robot.load("ur10").keep(["elbow_joint", "wrist_1_joint"])
    assert command_for(pair_of(shared, chance), arm).startswith(
        "frischid excite ur10 --joints elbow_joint,wrist_1_joint --separate "
    )
    assert command_for([first, elsewhere]) == "", "effects of different joints differ on every motion"
    whole = replace(second, effect="time_delay", members=parse_effects("time_delay"))
    assert f"--separate time_delay@joint2,{first.effect}@joint2 " in command_for([whole, first])
    tilt = replace(second, effect="gravity_tilt", members=parse_effects("gravity_tilt"))
    assert f"--separate gravity_tilt,{first.effect}@joint2 " in command_for([tilt, first])
    for change in ("payload", "friction_change", "offset_change"):  # excite refuses them: see test_discrimination
        other = replace(second, effect=change, members=parse_effects(f"{change}@joint2"))
        assert command_for([first, other]) == ""
        assert "frischid excite" not in sentence_of([shared[0], other], {**chance, second.effect: 0.0, change: 0.25})
    sure = [replace(first, probability=0.85), *shared[1:]]
    assert rivals(sure, {**chance, first.effect: 0.85}) == []
    assert sentence_of(sure, {**chance, first.effect: 0.85}) == ""


@pytest.mark.parametrize(
    ("rules", "likely", "named", "verdict"),
    [
        ("none", "none", False, "none"),
        ("none", "several", False, "several"),
        ("unknown", "none", False, "none"),
        ("unknown", "none", True, "unknown"),
        ("effect", "several", True, "several"),
        ("effect", "outside", True, "effect"),
        ("unknown", "effect", True, "unknown"),
        ("unknown", "effect", False, "unknown"),
        ("contact", "none", False, "contact"),
    ],
)
def test_the_verdict_is_the_likely_one_that_the_table_allows(rules, likely, named, verdict):
    chance = {"joint_spring": 0.02, **dict.fromkeys(OTHERS, 0.02)}
    chance["joint_spring" if likely == "effect" else likely] = 0.9
    finding = replace(found("spring").findings[0], probability=chance["joint_spring"])
    findings = [finding] if named else [replace(finding, gain=-1.0)]
    assert concluded(rules, findings, chance, unmodelled=False) == verdict
    assert concluded(rules, findings, chance, unmodelled=True) == rules


def test_a_floor_above_a_held_out_error_is_wrong():
    v = found("healthy").validator
    error = error_of(v)
    np.testing.assert_allclose(refuted(2 * error, error, np.ones(2)), error)
    np.testing.assert_allclose(refuted(0.5 * error, error, np.ones(2)), 0.5 * error)


def test_an_effect_that_takes_away_a_part_of_the_noise_refutes_no_floor():
    error = error_of(found("healthy").validator)
    np.testing.assert_allclose(refuted(2 * error, error, np.array([0.5, 0.8])), [2.0, 1.25] * error)
    np.testing.assert_allclose(refuted(2 * error, error, np.array([0.0, 0.8])), [2.0, 1.25] * error)


def test_the_error_of_a_diagnosis_is_without_that_of_uncertain_parameters():
    """The fewer the rows, the more of the held-out error comes from parameters that the other folds leave open."""
    v = found("healthy").validator
    short, _ = cross_validator(v.model, [_short(v)], "always")
    whole, little = ((x.base_nrmse() / x.predictive_nrmse()).mean() for x in (v, short))
    assert little > whole > 1


def _short(v):
    log = simulate(ARM, random_fourier(ARM, 5, seed=3), rate=50, effects=BASELINE, noise=Noise(q=1e-5, tau=0.02))
    return replace(log, source="short")


def test_an_effect_that_explains_error_of_its_own_is_no_rival():
    spring = next(f for f in found("spring").findings if f.significant)
    first = replace(spring, probability=0.5, confused_with=("cable_hose",))
    delay = replace(spring, effect="time_delay", joints=(), probability=0.2)
    memory = replace(delay, effect="hysteresis", probability=0.1)
    hose = replace(delay, effect="cable_hose", probability=0.15)
    chance = {f.effect: f.probability for f in (first, delay, memory, hose)} | dict.fromkeys(OTHERS, 0.01)
    findings = [first, delay, memory, hose]
    assert beside(findings) == [delay, memory]
    assert [r.name for r in rivals(findings, chance)] == ["cable_hose"]
    more = "time_delay on the robot and hysteresis on the robot; each explains error that no other effect explains"
    assert f"Probably also missing, beside joint_spring on joint2: {more}" in sentence_of(findings, chance)
    assert pair_of(findings, chance) == [first, hose]
    assert pair_of(findings[:3], chance) == [delay, memory], "the two look alike, and neither looks like a spring"
    assert len(pair_of([first, delay], chance)) < 2
    assert pair_of([replace(first, probability=0.95), delay, memory], chance) == []
    assert beside([replace(first, entered=False), delay]) == []
    assert beside([first, replace(delay, own=0.0)]) == []
