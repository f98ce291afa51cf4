"""Error at reversals and standstill is told from error while the joint moves."""

from dataclasses import replace

import numpy as np
import pytest
from test_diagnosis import NOISE, UR5, healthy, log_of, loose_reversals

from frischid.diagnosis.change_prior import weak_urdf_prior
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.effect_ranking import Ranking
from frischid.diagnosis.reversal_residuals import only_at_reversals
from frischid.diagnosis.verdict import StageResults, decided
from frischid.logs.log import Log

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
