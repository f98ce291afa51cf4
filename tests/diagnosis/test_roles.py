"""Three roles of a log: those given fit and select, those given as `valid` only test; and a step that does no harm."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from frischid.cli import main
from frischid.diagnosis.addition import add
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.improvement import improve
from frischid.diagnosis.step_acceptance import impossible_coefficients, reason_against, worse_joints
from frischid.effects import BASELINE, parse_effects
from frischid.logs.log import Log
from frischid.logs.readers import write_log
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.model.model import Model
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.reports.study import study
from frischid.robot.robot import Robot
from frischid.studio.bench import Bench

PLANAR2 = Robot.load("planar2")
DRY = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.02, "Ia2": 0.01}
SPRING, COGGING = "joint_spring@joint2", "cogging(order=9)@joint1"
TRIED = ["joint_spring", "cogging", "asymmetric_viscous"]
FAST = replace(DiagnosisCriteria(), shapes_screened=4)


@cache
def log_of(seed: int, effects: str = SPRING, seconds: float = 30.0, scale: float = 0.8, **values: float) -> Log:
    """A noisy log of the planar arm with something hidden in it."""
    return simulate(
        PLANAR2,
        random_fourier(PLANAR2, seconds, seed=seed, scale=scale),
        rate=100.0,
        effects=(*BASELINE, *parse_effects(effects)),
        parameters=DRY | values,
        noise=Noise(q=1e-5, tau=0.01),
        channels=(),
        seed=seed,
        name=f"log {seed}",
    )


def fitted() -> list[Log]:
    return [log_of(1, ks2=1.5)]


def of_test() -> list[Log]:
    """Test logs that have nothing in common: the same arm, and another motion of an arm with another effect."""
    return [log_of(2, ks2=1.5), log_of(3, COGGING, 12.0, 0.4, A1=3.0)]


@cache
def model() -> Model:
    return identify(PLANAR2, fitted(), recursion="none").model


def decided(found: Model) -> dict:
    """All that a model's file holds, but the errors on test logs and their names."""
    said = json.loads(json.dumps(found.to_dict()))
    for event in said["history"]:
        for key in ("test", "test_before", "test_logs"):
            event.pop(key, None)
    said.pop("previous", None)
    return said


def without_test(said: dict) -> dict:
    return {k: v for k, v in said.items() if k != "headline"}


def run_identify(valid):
    found = identify(PLANAR2, fitted(), valid=valid, recursion="none")
    return decided(found.model), found.comparison.nrmse


def run_diagnose(valid):
    found = diagnose(model(), fitted(), valid=valid, effects=TRIED)
    return without_test(found.to_dict()), found.headline.nrmse


def run_add(valid):
    step = add(model(), parse_effects(SPRING), fitted(), valid=valid, situation="auto")
    return (decided(step.model), step.error_before, step.error_after, step.measured_on), step.test_after


def run_improve(valid):
    steps, last = improve(model(), fitted(), valid=valid, max_steps=2)
    said = [(decided(s.model), s.error_before, s.error_after, s.finding.to_dict()) for s in steps]
    return (said, without_test(last.to_dict())), last.headline.nrmse


def run_report(valid):
    shown = study(model(), [*fitted(), *valid])
    assert set(shown.held_out) == {log.source for log in valid}
    return without_test(shown.diagnosis.to_dict()), shown.diagnosis.headline.nrmse


def run_report_with_valid(valid):
    shown = study(model(), fitted(), valid=valid)
    assert set(shown.held_out) == {log.source for log in valid}
    assert shown.headline.nrmse == shown.diagnosis.headline.nrmse
    return without_test(shown.diagnosis.to_dict()), shown.headline.nrmse


def run_studio(valid):
    bench = Bench(model(), [*fitted(), *valid], Path("studio.json"))
    bench.diagnose()
    said = without_test(bench.state.diagnosis.to_dict())
    state = bench.add(bench.state.diagnosis.findings[0].members, 0, bench.state.diagnosis.findings[0])
    return (said, decided(state.model)), state.headline.nrmse


@pytest.mark.parametrize(
    "run", [run_identify, run_diagnose, run_add, run_improve, run_report, run_report_with_valid, run_studio]
)
def test_a_change_of_the_test_log_changes_the_test_error_alone(run):
    (said, error), (other, other_error) = (run([valid]) for valid in of_test())
    assert said == other
    assert error != other_error


@pytest.mark.parametrize(
    "words",
    [
        ["identify", "planar2", "FIT", "--bbrf", "none"],
        ["diagnose", "MODEL", "FIT", "--try", ",".join(TRIED)],
        ["add", "MODEL", "joint_spring", "FIT", "--joints", "joint2"],
        ["add", "MODEL", "cogging", "FIT", "--joints", "joint1"],  # its order is searched
        ["improve", "MODEL", "FIT", "--max-steps", "1"],
        ["report", "MODEL", "FIT"],
    ],
    ids=["identify", "diagnose", "add", "add with a shape", "improve", "report"],
)
def test_no_command_lets_the_test_log_decide(words, tmp_path):
    write_log(fitted()[0], tmp_path / "fit.parquet")
    runner, said, errors = CliRunner(), [], []
    model_path = str(tmp_path / "model.json")
    given = {"FIT": str(tmp_path / "fit.parquet"), "MODEL": model_path}
    assert runner.invoke(main, ["identify", "planar2", given["FIT"], "--bbrf", "none", "-o", model_path]).exit_code == 0
    for number, log in enumerate(of_test()):
        path = str(tmp_path / f"test{number}.parquet")
        write_log(log, path)
        command = [given.get(word, word) for word in words]
        command += [path] if words[0] == "report" else ["--valid", path]
        out = str(tmp_path / f"out{number}.{'html' if words[0] == 'report' else 'json'}")
        command += [] if words[0] == "diagnose" else ["-o", out]
        result = runner.invoke(main, [*command, "--json"])
        assert result.exit_code in {0, 1}, result.output  # 1: an alarm, which the test log may raise
        data = json.loads(result.stdout)
        assert data["headline"]["measured"] == "test"
        errors.append(data["headline"]["nrmse"])
        if words[0] in {"identify", "add", "improve"}:
            said.append(decided(Model.load(out)))
        else:
            said.append(without_test(data.get("diagnosis", data)) if words[0] == "diagnose" else None)
    assert said[0] == said[1]
    assert errors[0] != errors[1]


def test_what_is_planted_in_the_test_log_alone_is_not_found():
    healthy = [log_of(5, "joint_spring@joint2", ks2=0.0)]
    planted = [log_of(6, COGGING, A1=1.0)]
    machine = identify(PLANAR2, healthy, recursion="none").model
    found = diagnose(machine, healthy, valid=planted, effects=["cogging"])
    assert found.verdict == "none"
    assert not any(f.significant for f in found.findings)
    assert found.headline.nrmse == compare(machine, planted).nrmse > 3 * found.error
    steps, last = improve(machine, healthy, valid=planted, max_steps=2)
    assert not steps
    assert last.headline.nrmse == found.headline.nrmse
    alone = diagnose(identify(PLANAR2, planted, recursion="none").model, planted, effects=["cogging"])
    assert [str(e) for e in alone.findings[0].members] == [COGGING], "it is there to be found"


def test_without_test_logs_nothing_is_called_held_out(tmp_path):
    write_log(fitted()[0], tmp_path / "fit.parquet")
    model().save(tmp_path / "model.json")
    runner, new = CliRunner(), str(tmp_path / "new.json")
    for words in (["diagnose"], ["improve", "--max-steps", "1", "-o", new], ["history"]):
        logs = [str(tmp_path / "fit.parquet")] if words[0] != "history" else []
        given = [words[0], new if words[0] == "history" else str(tmp_path / "model.json"), *logs, *words[1:]]
        text = runner.invoke(main, given).output.lower()
        assert "cross-validated" in text
        assert "held out" not in text
        assert "held-out" not in text


# ---------------------------------------------------------------- a step that does no harm


UR5 = Robot.load("ur5")
UR5_DRY = {f"{k}{i}": x for i in range(1, 7) for k, x in (("fv", 3.0), ("fc", 2.0), ("Ia", 0.3))}
NOISY = 5


def noisy_log(seed: int) -> Log:
    """An arm whose last joint measures hardly more than noise that wanders, and which has a hidden effect elsewhere."""
    made = simulate(
        UR5,
        random_fourier(UR5, 25.0, seed=seed, scale=0.8),
        rate=100.0,
        effects=(*BASELINE, *parse_effects("joint_spring@wrist_2_joint")),
        parameters=UR5_DRY | {"ks5": 1.0},
        noise=Noise(q=1e-5, tau=0.004),
        channels=(),
        seed=seed,
        name=f"noisy {seed}",
    )
    tau, rng = np.array(made.tau), np.random.default_rng(seed)
    wander = np.convolve(rng.normal(size=len(made.t) + 400), np.hanning(400), "same")[200:-200]
    tau[:, NOISY] += 2.0 * tau[:, NOISY].std() * wander / wander.std()
    return Log(made.t, made.joints, made.q, tau=tau, source=made.source)


def test_improve_beside_a_very_noisy_joint_makes_no_joint_significantly_worse():
    logs, test = [noisy_log(seed) for seed in (1, 2)], [noisy_log(3)]
    start = identify(UR5, logs, recursion="none").model
    steps, _ = improve(start, logs, valid=test, max_steps=4)
    assert "joint_spring" in {step.finding.effect for step in steps}
    before, after = (compare(m, test) for m in (start, steps[-1].model))
    for one, other in zip(before.joints, after.joints, strict=True):
        assert other.nrmse < 1.02 * one.nrmse, other.name
    for step, earlier in zip(steps, [start, *(s.model for s in steps)], strict=False):
        assert not impossible_coefficients(step.model, step.finding.members)
        assert step.error_after < step.error_before, earlier


def test_an_effect_that_the_data_do_not_show_is_refused():
    validator = diagnose(model(), fitted(), effects=["joint_spring"]).validator
    assert reason_against(validator, parse_effects("joint_spring@joint2")) == ""
    assert reason_against(validator, parse_effects("asymmetric_viscous@joint1")) != ""


def test_a_joint_is_worse_where_its_error_rises_in_most_blocks_by_more_than_a_trifle():
    rng, criteria = np.random.default_rng(0), DiagnosisCriteria()
    before = np.array([100.0, 100.0, 100.0])
    steady, single, trifle = 0.1 + 0.02 * rng.normal(size=40), np.zeros(40), 1e-3 + 1e-4 * rng.normal(size=40)
    single[:] = -0.01
    single[7] = 4.0
    rises = [steady, single, trifle]
    after = before + [rise.sum() for rise in rises]
    assert worse_joints(rises, before, after, criteria, np.zeros(3)) == [0]
    assert worse_joints(rises, before, after, replace(criteria, harmless_rise=1e-6), np.zeros(3)) == [0, 2]


def test_a_coefficient_of_impossible_sign_is_named():
    friction = parse_effects("viscous")
    machine = model()
    assert impossible_coefficients(machine, friction) == []
    theta = np.array(machine.estimate.theta)
    names = [c.name for c in machine.estimate.columns]
    theta[names.index("fv2")] = -3.0 * machine.estimate.stderr[names.index("fv2")]
    wrong = replace(machine, estimate=replace(machine.estimate, theta=theta))
    (told,) = impossible_coefficients(wrong, friction)
    assert told.startswith("fv2 = -")
    assert impossible_coefficients(wrong, parse_effects("coulomb")) == []


@pytest.mark.parametrize(("errors", "named"), [(-0.5, 1), (-3.0, 1), (0.0, 0), (3.0, 0)])
def test_a_known_sign_is_a_bound(errors, named):
    machine = model()
    theta, names = np.array(machine.estimate.theta), [c.name for c in machine.estimate.columns]
    theta[names.index("fv2")] = errors * machine.estimate.stderr[names.index("fv2")]
    told = replace(machine, estimate=replace(machine.estimate, theta=theta))
    assert len(impossible_coefficients(told, parse_effects("viscous"))) == named
