"""Recordings: read in pieces, nothing lost, nothing counted twice."""

import json
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest

import frischid as fr
from frischid.errors import InputError
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.preprocessing import prepare
from frischid.logs.recording import Motions, Recording, moving_part
from frischid.model.log_examination import report_issues
from frischid.regression.accumulation import MAX_BLOCKS, accumulate
from frischid.regression.joint_rows import JointRows
from frischid.regression.moment_blocks import Blocks, total
from frischid.regression.regressor import Regressor

ROBOT = fr.Robot.load("planar2")


def log_of(seconds=60.0, rate=200.0, seed=1):
    motion = fr.random_fourier(ROBOT, seconds, seed=seed)
    return fr.simulate(ROBOT, motion, rate=rate, noise=fr.Noise(q=1e-5, tau=0.01), channels=(), seed=seed)


def recording_of(log, at=None):
    """The log cut into pieces of the size asked for, or at given samples."""

    def read(samples):
        edges = [0, *(at or range(samples, len(log) - 10, samples)), len(log)]
        return (log.slice(a, b) for a, b in pairwise(edges))

    return Recording(log.source, read)


@pytest.mark.parametrize(("cutoff", "lag"), [(None, 0.0), (1.5, 0.0), (8.0, 0.0), (8.0, 0.3), (8.0, -0.3)])
def test_motions_of_pieces_make_the_same_outputs(cutoff, lag):
    log, lowpass = log_of(), LowPass(cutoff, torque_lag=lag)
    regressor = Regressor(ROBOT, fr.BASELINE)
    whole = [b for m in prepare(log, lowpass).motions for b in regressor.blocks(m, lowpass)]
    pieces = Motions([recording_of(log, [1111, 5000, 5900, 9003])], ROBOT.joints, lowpass)
    parts = [b for m in pieces for b in regressor.blocks(m, lowpass)]
    t = np.concatenate([b.t for b in whole])
    np.testing.assert_allclose(np.concatenate([b.t for b in parts]), t, atol=1e-9)
    Z, expected = (np.concatenate([b.Z for b in blocks]) for blocks in (parts, whole))
    # Coulomb friction's smoothed sign magnifies rounding of the speed two hundredfold
    np.testing.assert_allclose(Z, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_identify_and_compare_agree_with_the_whole_log():
    log, other = log_of(), log_of(seed=2)
    found = fr.identify(ROBOT, [log], valid=[other], recursion="none")
    pieces = fr.identify(
        ROBOT, [recording_of(log, [4000, 8000])], valid=[recording_of(other, [5000])], recursion="none",
        cutoff=found.model.lowpass.cutoff,
    )  # fmt: skip
    assert pieces.samples == found.samples
    difference = pieces.model.estimate.theta - found.model.estimate.theta
    assert (np.abs(difference) < 0.2 * found.model.estimate.stderr).all()  # where a joint rests is judged per piece
    assert pieces.comparison.nrmse == pytest.approx(found.comparison.nrmse, rel=1e-3)
    assert pieces.comparison.samples == found.comparison.samples


def test_a_gap_between_pieces_ends_a_motion():
    log = log_of(30.0)
    late = Log(log.t[3000:] + 5.0, log.joints, log.q[3000:], tau=log.tau[3000:])
    lowpass = LowPass(5.0)
    motions = list(Motions([Recording("two", lambda _: iter([log.slice(0, 3000), late]))], ROBOT.joints, lowpass))
    assert len(motions) == 2
    assert motions[1].t[0] > late.t[0]
    assert motions[1].start == log.t[0]


def test_blocks_do_not_grow_with_the_logs():
    log, lowpass = log_of(20.0), LowPass(5.0)
    regressor = Regressor(ROBOT, fr.BASELINE)
    motions = list(prepare(log, lowpass).motions)
    once = accumulate(regressor, motions, lowpass, ROBOT.joints)
    many = accumulate(regressor, motions * 40, lowpass, ROBOT.joints, seconds=20.0)
    assert len(many) <= 2 * MAX_BLOCKS
    total = sum(g.moments for g in many)
    np.testing.assert_allclose(total, 40 * sum(g.moments for g in once), rtol=1e-12)
    assert sum(g.rows for g in many) == 40 * sum(g.rows for g in once)


def test_blocks_are_their_grams_in_half_the_room(monkeypatch):
    monkeypatch.setattr("frischid.regression.moment_blocks.HALVED_ABOVE", 0)
    robot, lowpass = fr.Robot.load("ur5"), LowPass(5.0)
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=100.0)
    regressor = Regressor(robot, fr.BASELINE)
    rows = JointRows.of(regressor, robot.joints)
    grams = [rows.gram([c]).whole() for m in prepare(log, lowpass).motions for c in rows.chunks(m, lowpass, 256)]
    blocks = Blocks(grams)
    assert blocks.nbytes < 0.5 * sum(g.moments.nbytes for g in grams)
    for block, gram in zip(blocks, grams, strict=True):
        np.testing.assert_array_equal(block.moments, gram.moments)
        np.testing.assert_array_equal(block.counts, gram.counts)
    np.testing.assert_array_equal(total(blocks).moments, total(grams).moments)
    np.testing.assert_array_equal(total(blocks[1:3]).moments, (grams[1] + grams[2]).moments)
    blocks.merge(grams[0])
    np.testing.assert_allclose(blocks[-1].moments, (grams[-1] + grams[0]).moments)


def test_the_sensor_wise_scheme_reads_recordings():
    log = log_of()
    whole = fr.identify(ROBOT, [log], recursion="none", estimator="sensorwise", effects=fr.BASELINE)
    pieces = fr.identify(
        ROBOT, [recording_of(log, [4000, 8000])], recursion="none", estimator="sensorwise", effects=fr.BASELINE,
        cutoff=whole.model.lowpass.cutoff,
    )  # fmt: skip
    box, other = whole.model.bounds["sensorwise"], pieces.model.bounds["sensorwise"]
    np.testing.assert_allclose(other.width, box.width, rtol=0.2)


@pytest.mark.parametrize("estimator", ["eiv", "iv"])
def test_estimators_that_correct_states_read_recordings(estimator):
    log = log_of()
    options = {"recursion": "none", "estimator": estimator, "effects": fr.BASELINE, "cutoff": 8.0}
    whole = fr.identify(ROBOT, [log], **options).model.estimate
    pieces = fr.identify(ROBOT, [recording_of(log, [4000, 8000])], **options).model.estimate
    assert pieces.estimator == estimator
    # of every piece the noise is read off anew, and a reference's ends are trimmed
    assert (np.abs(pieces.theta - whole.theta) < 0.5 * whole.stderr).all()


@pytest.mark.parametrize("estimator", ["eiv", "iv"])
def test_memory_of_such_estimators_does_not_grow(estimator, monkeypatch):
    monkeypatch.setattr("frischid.core.array_store.LIMIT", 0)
    log, peaks = log_of(20.0), []
    options = {"recursion": "none", "prior": "none", "estimator": estimator, "cutoff": 8.0}

    def identify_repeated(times):
        def read(_):
            later = (k * (log.t[-1] + log.t[1]) for k in range(times))
            return (Log(start + log.t, log.joints, log.q.copy(), tau=log.tau.copy()) for start in later)

        fr.identify(ROBOT, [Recording("long", read)], effects=fr.BASELINE, **options)

    identify_repeated(1)  # what is remembered once and for all
    for times in (4, 8):  # up to 80 s, stretches of the jackknife are gathered; beyond, neighbours are added
        tracemalloc.start()
        identify_repeated(times)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / (4 * len(log)) < 8  # bytes a sample; a filtered state alone has 10 numbers, a log 5


def test_a_recording_without_motion_is_refused():
    log = log_of(20.0)
    still = Log(log.t, log.joints, np.zeros_like(log.q), tau=log.tau, source="still")
    with pytest.raises(InputError, match="no joint moves"):
        fr.identify(ROBOT, [recording_of(still, [2000])])


def test_a_piece_of_rest_does_no_harm():
    log = log_of(30.0)
    step = log.t[1]
    rest = Log(log.t[-1] + step * (1 + np.arange(2000)), log.joints, np.tile(log.q[-1], (2000, 1)),
               tau=np.tile(log.tau[-1], (2000, 1)))  # fmt: skip
    both = Recording("moves, then rests", lambda _: iter([log, rest]))
    found = fr.identify(ROBOT, [both], cutoff=8.0, recursion="none")
    alone = fr.identify(ROBOT, [log], cutoff=8.0, recursion="none")
    assert any("no motion" in w or "no joint moves" in w for w in found.warnings) or found.samples >= alone.samples
    np.testing.assert_allclose(found.model.estimate.theta, alone.model.estimate.theta, rtol=0.02, atol=1e-3)


def test_faults_are_looked_for_where_the_arm_moves():
    """An angle in degrees passed unseen behind a chunk of rest, and the joints were said to be at standstill."""
    robot = fr.Robot.load("ur5")
    log = fr.simulate(
        robot, fr.random_fourier(robot, 20.0, seed=1), rate=100.0, noise=fr.Noise(q=1e-5, tau=0.02), channels=()
    )
    q, tau = (np.vstack([np.repeat(x[:1], 2000, axis=0), x]) for x in (log.q, log.tau))
    q[:, 1] = np.rad2deg(q[:, 1])
    wrong = Log(np.arange(len(q)) / 100, log.joints, q, tau=tau, source="degrees")
    assert len(moving_part(recording_of(wrong, [2000]), log.joints)) == len(q) - 2000
    (whole,), (pieces,) = (report_issues(robot, [x]) for x in (wrong, recording_of(wrong, [2000])))
    assert "degrees" in [issue.kind for issue in whole.issues]
    assert [issue.kind for issue in pieces.issues] == [issue.kind for issue in whole.issues]


def test_the_command_line_reads_long_files_in_pieces(tmp_path, monkeypatch):
    from click.testing import CliRunner

    from frischid.cli import main

    log = log_of(30.0)
    fr.write_log(log, tmp_path / "log.parquet")
    plain = [str(tmp_path / "log.parquet"), "--bbrf", "none", "--cutoff", "8", "--json"]
    whole = CliRunner().invoke(main, ["identify", "planar2", *plain])
    monkeypatch.setattr("frischid.logs.content_size.IN_MEMORY", 0)
    monkeypatch.setattr("frischid.logs.recording.RECORDING_CHUNK", 1000)
    pieces = CliRunner().invoke(main, ["identify", "planar2", *plain])
    assert whole.exit_code == pieces.exit_code == 0, pieces.output
    one, many = (json.loads(result.output)["parameters"] for result in (whole, pieces))
    for a, b in zip(one, many, strict=True):
        assert abs(a["value"] - b["value"]) < 0.5 * a["stderr"]


def test_samples_that_the_next_piece_takes_over_are_not_called_dropped():
    """A gap 10 samples before the end of a piece: these 10 were said to be dropped, and were used."""
    log = log_of(30.0)
    late = Log(np.append(log.t[:2990], log.t[2990:] + 5.0), log.joints, log.q, tau=log.tau, source="two")
    pieces = [late.slice(0, 3000), late.slice(3000)]
    for given, dropped in ((pieces, False), (pieces[:1], True)):
        motions = Motions([Recording("two", lambda _, given=given: iter(given))], ROBOT.joints, LowPass(5.0))
        assert len(list(motions)) == (1 if dropped else 2)
        assert any("10 samples dropped" in note for note in motions.notes) == dropped
