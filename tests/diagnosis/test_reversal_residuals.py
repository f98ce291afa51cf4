"""Error at reversals and standstill is told from error while the joint moves."""

from dataclasses import replace

import numpy as np
import pytest
from test_diagnosis import NOISE, UR5, healthy, log_of, loose_reversals

from frischid.diagnosis.change_prior import weak_urdf_prior
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.effect_findings import find_effects
from frischid.diagnosis.effect_ranking import Ranking
from frischid.diagnosis.floor import Floor
from frischid.diagnosis.reversal_residuals import absent_in_motion, only_at_reversals
from frischid.diagnosis.verdict import StageResults, decided, notes_on
from frischid.effects import parse_effects
from frischid.logs.log import Log
from frischid.model.identification import identify

FLOOR = np.full(6, NOISE.tau)


def with_wave(log: Log, joint: int) -> Log:
    """The same log with a torque that knows nothing of the joint's speed."""
    tau = np.array(log.tau)
    tau[:, joint] += 0.5 * np.sin(7 * log.t)
    return Log(log.t, log.joints, log.q, tau=tau, source=log.source)


@pytest.mark.parametrize(
    ("log", "expected"),
    [
        (loose_reversals(log_of(1), 4, 2.0), True),
        (with_wave(log_of(1), 4), False),
        (with_wave(loose_reversals(log_of(1), 4, 2.0), 4), False),
        (loose_reversals(log_of(1), 4, 8.0), False),
    ],
    ids=["jumps early and late", "a wave", "both", "more than dry friction can do"],
)
def test_only_small_errors_at_reversals_are_set_aside(log, expected):
    validator = CrossValidator.of(healthy(), [log], weak_urdf_prior(healthy()))
    assert UR5.joints[4] == validator.joints[4]
    assert only_at_reversals(validator, FLOOR)[4] == expected


def test_an_error_at_reversals_stays_one_when_an_effect_spreads_it_over_the_motion():
    loose = loose_reversals(log_of(1), 4, 2.0)
    bare, spread = (CrossValidator.of(healthy(), [x], weak_urdf_prior(healthy())) for x in (loose, with_wave(loose, 4)))
    results = StageResults(bare, "always", FLOOR, FLOOR, (), (), Ranking([], spread, spread), None)
    assert decided(results) == "none"
    assert decided(replace(results, validator=spread)) == "unknown"


def test_no_note_says_at_reversals_of_an_error_that_is_in_motion_too():
    """The probabilities may conclude "none" beside such an error; the note on the EMPS was wrong."""
    loose = loose_reversals(log_of(1), 4, 2.0)
    for log, said in ((loose, True), (with_wave(loose, 4), False)):
        validator = CrossValidator.of(healthy(), [log], weak_urdf_prior(healthy()))
        results = StageResults(validator, "always", FLOOR, FLOOR, (), (), Ranking([], validator, validator), None)
        notes = notes_on(results, "none", None, {"none": 1.0})
        assert any("at reversals and standstill" in note for note in notes) == said


def test_an_error_at_reversals_like_that_of_a_healthy_robot_is_no_effect():
    """Presliding friction of a healthy Z1 was called missing (96 %); its twin had more error at the same reversals."""
    logs = [loose_reversals(log_of(s), 4, 2.0) for s in (1, 2)]
    validator = CrossValidator.of(healthy(), logs, weak_urdf_prior(healthy()))
    (found,) = find_effects(validator, Floor.of(validator), "always", ["time_delay"])[0]
    assert found.floors == 0, "all of the error is at reversals"
    assert found.over_twin > 1, "there the error is compared with that of the twin too"
    whole = replace(found, gain=100.0, p_value=0.0, removed=1.0, share=1.0, absent_in_motion=False)
    assert whole.beyond_twin
    assert not replace(whole, over_twin=1.0).beyond_twin
    assert not replace(whole, share=0.7).beyond_twin


def late(log: Log, what: str, row: int = 4) -> Log:
    """The same log, on which the torque of a joint is 10 ms late: all of it, or only its dry friction."""
    tau = np.array(log.tau)
    if what == "torque":
        tau[1:, row] = log.tau[:-1, row]
    else:
        side = np.sign(np.gradient(log.q[:, row], log.t))
        tau[1:, row] += 2.0 * (side[:-1] - side[1:])
    return Log(log.t, log.joints, log.q, tau=tau, source=f"{log.source}, late {what}")


@pytest.mark.parametrize(("what", "row"), [("torque", 4), ("friction", 2)])
def test_a_delay_that_only_reversals_show_is_not_there_in_motion(what, row):
    """Friction with bristles shorter than the encoder's step was called a delay of one joint, with 98 %."""
    logs = [late(log_of(s), what, row) for s in (1, 2)]
    model = identify(UR5, logs, recursion="none").model
    validator = CrossValidator.of(model, logs, weak_urdf_prior(model))
    (delay,) = validator.candidates(parse_effects(f"time_delay@{UR5.joints[row]}"))
    assert absent_in_motion(validator, delay, [row]) == (what == "friction")
