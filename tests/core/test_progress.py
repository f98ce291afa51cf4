"""The bar: words of a long function, how much is done, and the time left."""

import io
from itertools import pairwise

import pytest
from rich.console import Console

import frischid as fr
from frischid.cli.inputs import opened
from frischid.core.progress import Stage, progress_bar, stage_of
from frischid.model.log_data import IDENTIFY_STAGES


@pytest.mark.parametrize(
    ("text", "done", "total"),
    [
        ("reading logs", 0, 0),
        ("trying stribeck (3 of 90)", 3, 90),
        ("moments of 7 of 400 robots", 7, 400),
        ("simulated motion, fit 2 of 8", 2, 8),
        ("planning: 40% of the budget, cost 12.5", 40, 100),
    ],
)
def test_counts_and_shares_are_read_from_the_words(text, done, total):
    assert stage_of(text) == Stage(text, done, total)


def test_one_clock_runs_as_long_as_the_count_goes_on():
    at = stage_of("trying stribeck (3 of 90)")
    assert stage_of("trying hysteresis (4 of 90)").follows(at)
    assert not stage_of("trying viscous (1 of 90)").follows(at)
    assert not stage_of("trying viscous (4 of 30)").follows(at)
    assert not stage_of("reading logs").follows(stage_of("comparing"))


def test_the_bar_shows_words_time_so_far_and_time_left():
    seen = io.StringIO()
    with progress_bar(Console(file=seen, force_terminal=True, width=120)) as progress:
        for k in range(1, 6):
            progress(f"trying [b]stribeck (step {k} of 6)")
    text = seen.getvalue()
    assert "trying [b]stribeck (step 5 of 6)" in text  # a name is no markup
    assert "so far" in text
    assert "left" in text


def test_a_diagnosis_counts_every_effect_on_every_log():
    robot = fr.Robot.load("planar2")
    motions = [fr.random_fourier(robot, 8, seed=seed) for seed in (1, 2)]
    logs = [fr.simulate(robot, motion, rate=50, noise=fr.Noise(tau=0.01)) for motion in motions]
    model, told = fr.identify(robot, logs, recursion="none").model, []
    fr.diagnose(model, logs, effects=["joint_spring", "stribeck"], progress=told.append)
    counted = [stage for stage in map(stage_of, told) if stage.total]
    assert [(stage.done, stage.total) for stage in counted] == [(k, 4) for k in range(1, 5)]


def made(count=1):
    robot = fr.Robot.load("planar2")
    motions = [fr.random_fourier(robot, 8, seed=seed) for seed in range(count)]
    return robot, [fr.simulate(robot, motion, rate=50, noise=fr.Noise(tau=0.01)) for motion in motions]


def test_an_identification_counts_its_stages():
    (robot, logs), told = made(), []
    fr.identify(robot, logs, recursion="none", progress=told.append)
    counted = [stage_of(text) for text in told]
    assert [stage.done for stage in counted] == list(range(1, len(IDENTIFY_STAGES) + 1)), told
    assert all(later.follows(stage) for stage, later in pairwise(counted)), "one clock runs"


def test_an_identification_of_a_recording_tells_shares_of_its_samples(tmp_path):
    (robot, logs), told = made(), []
    fr.write_log(logs[0], tmp_path / "log.parquet")
    chunked = fr.Recording("log", lambda _: fr.read_chunks(tmp_path / "log.parquet", robot.joints, samples=150))
    fr.identify(robot, [chunked], recursion="none", progress=told.append)
    shares = [text for text in told if text.startswith("regressor and moments: ")]
    assert [stage_of(text).done for text in shares[:3]] == [37, 75, 100]


def test_a_comparison_tells_shares_or_samples():
    (robot, logs), told = made(2), []
    model = fr.identify(robot, logs[:1], recursion="none").model
    fr.compare(model, logs, progress=told.append)
    assert told == ["comparing", "comparing: 50% of the samples", "comparing: 100% of the samples"]


def test_a_check_counts_the_logs():
    (robot, logs), told = made(2), []
    fr.check(robot, logs, progress=told.append)
    assert [stage_of(text)[1:] for text in told] == [(1, 2), (2, 2)]


def test_adding_an_effect_and_simulating_count_their_work():
    (robot, logs), told = made(2), []
    model = fr.identify(robot, logs[:1], recursion="none").model
    fr.add(model, fr.parse_effects("joint_spring@joint2"), logs[:1], situation="always", progress=told.append)
    assert [stage_of(text)[1:] for text in told] == [(2, 3), (3, 3)], "the situation is named, so nothing looks for it"
    told.clear()
    fr.compare_simulated(model, logs, horizons=[0.1], progress=told.append)
    assert [stage_of(text)[1:] for text in told] == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_reading_counts_the_files(tmp_path):
    (robot, logs), told = made(2), []
    paths = [str(tmp_path / f"{k}.parquet") for k in range(2)]
    for log, path in zip(logs, paths, strict=True):
        fr.write_log(log, path)
    opened(paths, robot, (), told.append)
    assert [stage_of(text)[1:] for text in told] == [(1, 2), (2, 2)]
