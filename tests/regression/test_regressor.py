"""The regressor of a motion: what a block says is true of the samples it stands for."""

from dataclasses import replace

import numpy as np
import pytest
from cases import EFFECT_CASES, exact_log, random_values, robot, whole_regressor

from frischid.effects import BASELINE, parse_effects
from frischid.logs.filters import LowPass
from frischid.logs.preprocessing import Motion, prepare
from frischid.regression.accumulation import accumulate, streaming_qr
from frischid.regression.block import Samples, stack
from frischid.regression.joint_rows import JointRows
from frischid.regression.moment_blocks import total
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

LOWPASS = LowPass(6.0)


def motion_of(machine, seconds=6.0, effects=BASELINE):
    log = exact_log(machine, effects, random_values(machine, effects), seconds=seconds)
    return prepare(log, LOWPASS).motions[0]


def test_a_block_stands_at_its_times():
    machine = robot("planar2")
    motion = motion_of(machine)
    ramp = np.outer(motion.t, [0.3, -0.2])  # a zero-phase filter leaves straight lines alone
    for block in Regressor(machine, ()).blocks(replace(motion, q=ramp), LOWPASS, 100):
        np.testing.assert_allclose(block.q, np.outer(block.t, [0.3, -0.2]), atol=1e-12)


def test_standstill_near_the_end_of_a_chunk_counts_in_the_next_one():
    machine = robot("planar2")
    motion = motion_of(machine)
    still = np.zeros_like(motion.standstill)
    still[150:160, 0] = still[400:405, 1] = True
    motion, regressor = replace(motion, standstill=still), Regressor(machine, BASELINE)
    (whole,) = regressor.blocks(motion, LOWPASS, 100_000)
    assert not whole.used.all(axis=0).any()
    for chunk in range(20, 200, 15):
        used = np.concatenate([block.used for block in regressor.blocks(motion, LOWPASS, chunk)])
        np.testing.assert_array_equal(used, whole.used)


def test_torque_at_standstill_may_be_anything():
    """Of all that the filter takes in, at most a hundredth may come from a joint at standstill; the rest counts."""
    machine = robot("planar2")
    motion = motion_of(machine)
    still = np.zeros_like(motion.standstill)
    still[200:260, 0] = True
    motion, regressor = replace(motion, standstill=still), Regressor(machine, BASELINE)
    (clean,) = regressor.blocks(motion, LOWPASS, 100_000)
    (other,) = regressor.blocks(replace(motion, tau=motion.tau + still), LOWPASS, 100_000)
    change = np.abs(other.tau - clean.tau)
    assert change[clean.used].max() < 0.01 + 1e-9
    assert change.max() > 0.9
    assert clean.used[:, 1].all()
    taps = LOWPASS.taps(motion.step)
    touched = (clean.t > motion.t[200 - len(taps)]) & (clean.t < motion.t[260 + len(taps)])
    assert clean.used[~touched].all()


def test_what_is_known_is_taken_off_the_torque_and_told():
    machine = robot("planar2 far_end known")
    motion = motion_of(machine)
    regressor = Regressor(machine, BASELINE)
    (block,) = regressor.blocks(motion, LowPass(None), 100_000)
    known = machine.known_torque(motion.q, motion.v, motion.a)
    assert np.abs(known).max() > 1.0
    np.testing.assert_allclose(block.known, known)
    np.testing.assert_allclose(block.tau + block.known, motion.tau)


def test_known_links_are_part_of_the_load():
    """A gear carries the links whose parameters are known as well; load friction of them had been left out."""
    plain, effects = Robot.load("ur5"), parse_effects("load_friction, drive_gain, hysteresis, elasticity")
    values = dict(zip(plain.all_names, plain.nominal, strict=True))
    known = Robot.load("ur5", known={name: x for name, x in values.items() if name[-1] in "456"})
    motion, rigid = motion_of(plain), len(known.columns)
    one, other = Regressor(plain, effects), Regressor(known, effects)
    some = Samples.of(motion).part(slice(0, 50))
    expected = one.evaluate(some)[:, len(plain.columns) :]
    np.testing.assert_allclose(other.evaluate(some)[:, rigid:], expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(other.of_effects(some), expected, atol=1e-9 * np.abs(expected).max())
    blocks = [next(iter(r.blocks(motion, LOWPASS, 100_000))) for r in (one, other)]
    of_effects = [block.Y[:, len(r.robot.columns) :] for block, r in zip(blocks, (one, other), strict=True)]
    np.testing.assert_allclose(*of_effects, atol=1e-9 * np.abs(of_effects[0]).max())
    sums = [total(accumulate(r, [motion], LOWPASS, plain.joints)) for r in (one, other)]
    squares = [
        g.moments[:, len(r.robot.columns) : -1, len(r.robot.columns) : -1]
        for g, r in zip(sums, (one, other), strict=True)
    ]
    np.testing.assert_allclose(*squares, atol=1e-9 * np.abs(squares[0]).max())


def test_stacked_rows_say_whose_they_are():
    machine = robot("planar2")
    motion = motion_of(machine)
    still = np.zeros_like(motion.standstill)
    still[100:300, 1] = True
    regressor = Regressor(machine, BASELINE)
    motion = replace(motion, standstill=still)
    joints = machine.joints[::-1]
    Y, tau, which = stack(list(regressor.blocks(motion, LOWPASS)), machine, joints)
    rows = JointRows.of(regressor, joints)
    moments = total(rows.gram([chunk]) for chunk in rows.chunks(motion, LOWPASS, 256))
    for j in range(2):
        Z = np.column_stack([Y, tau])[which == j]
        assert len(Z) == moments.counts[j]
        np.testing.assert_allclose(Z.T @ Z, moments.moments[j], atol=1e-9 * np.abs(moments.moments[j]).max())


def test_many_motions_make_blocks_of_equal_length():
    machine = robot("planar2")
    motion = motion_of(machine)
    pieces = [motion.part(slice(k, k + 20)) for k in range(0, 400)]
    regressor = Regressor(machine, ())
    blocks = accumulate(regressor, pieces, LowPass(None), machine.joints)
    assert 32 <= len(blocks) <= 128
    counts = [block.counts[0] for block in blocks]
    assert set(counts[:-1]) == {counts[0]}
    assert counts[0] >= counts[-1] > 0
    assert sum(counts) == sum(len(piece.t) for piece in pieces)


@pytest.mark.parametrize("weights", [(1.0, 1.0), (9.0, 0.04)])
def test_streaming_qr_weighs_squared_residuals(weights):
    machine = robot("planar2")
    motion = motion_of(machine)
    motion = replace(motion, tau=motion.tau + 0.5 * np.sin(40 * motion.t)[:, None] * [1.0, 3.0])
    regressor = Regressor(machine, ())
    base = structure(regressor, machine.joints).base
    found = streaming_qr(regressor, [motion], LOWPASS, machine.joints, base).solve(np.array(weights))
    Y, tau, which = stack(list(regressor.blocks(motion, LOWPASS)), machine, machine.joints)
    root = np.sqrt(np.array(weights))[which]
    expected = np.linalg.lstsq(root[:, None] * Y[:, base], root * tau, rcond=None)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_columns_that_cannot_act_on_a_joint_are_zero_there():
    machine = robot("mixed mimic")
    motion = motion_of(machine)
    regressor = Regressor(machine, BASELINE)
    Y = whole_regressor(regressor, motion.q, motion.v, motion.a)
    for j, active in enumerate(regressor.active):
        rest = np.delete(Y[:, :, j], active, axis=1)
        assert np.abs(rest).max(initial=0.0) < 1e-9


def test_a_known_parameter_builds_the_robot_once(monkeypatch):
    """It was read from XML again for every chunk, which took longer than everything else."""
    machine = Robot.load("planar2", known={"m2": 9.0})
    q, v, a = np.ones((3, 4, 2))
    first = machine.known_torque(q, v, a)
    monkeypatch.setattr("frischid.robot.robot.build_model", lambda *_: pytest.fail("read again"))
    np.testing.assert_array_equal(machine.known_torque(q, v, a), first)


def test_moments_of_some_columns_are_those_columns_of_all_moments():
    machine = Robot.load("ur10")
    regressor, rng = Regressor(machine, BASELINE), np.random.default_rng(1)
    q, v, a, tau = rng.normal(size=(4, 300, 6))
    motion = Motion(np.arange(300) * 0.01, q, v, a, tau, rng.random((300, 6)) < 0.1, "random")
    base = [70, 3, 61, 12, 59]
    some = accumulate(regressor, [motion], LowPass(None), machine.joints, base=base)
    every = accumulate(regressor, [motion], LowPass(None), machine.joints)
    for part, whole in zip(some, every, strict=True):
        assert part.columns == whole.select(base).columns
        np.testing.assert_allclose(part.moments, whole.select(base).moments, rtol=1e-12)
        np.testing.assert_allclose(part.sums, whole.select(base).sums, rtol=1e-12)
        np.testing.assert_array_equal(part.counts, whole.counts)


@pytest.mark.parametrize("name", ["planar2", "mixed mimic", "ur10 far_end tilted"])
@pytest.mark.parametrize("effect", EFFECT_CASES.values(), ids=EFFECT_CASES)
def test_columns_of_effects_alone_are_those_of_the_regressor(name, effect):
    """The same values, whether an effect needs the load of the links or not."""
    machine, rng = robot(name), np.random.default_rng(0)
    effects = (*BASELINE, effect) if effect.id not in {e.id for e in BASELINE} else BASELINE
    q, v, a = rng.normal(size=(3, 8, len(machine.joints)))
    extra = {channel: rng.normal(size=8) for channel in effect.channels(machine)}
    samples = Samples(np.arange(8) / 100, q, v, a, 0.0, extra)
    regressor = Regressor(machine, effects)
    whole = regressor.evaluate(samples)[:, len(machine.columns) :]
    alone = regressor.of_effects(samples)
    np.testing.assert_allclose(alone, whole, rtol=0, atol=1e-12 * np.abs(whole).max(initial=1.0))
