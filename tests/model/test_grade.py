"""The words of a grade are true of every error that has it."""

import re

import numpy as np
import pytest

from frischid.model.grade import graded


@pytest.mark.parametrize(("floor", "urdf"), [(0.0202, 0.4809), (0.0037, 0.1585), (0.01, 0.013), (1e-4, 0.9)])
def test_the_words_give_the_two_factors(floor, urdf):
    for nrmse in np.geomspace(1.16 * floor, 0.999 * urdf, 40):
        grade, words = graded(nrmse, floor, urdf, 1.0)
        share, times = re.match(r"([\d.]+) % of the error of .*, (\S+) times the noise", words).groups()
        assert grade in "ABCDE"
        assert float(share) == pytest.approx(100 * nrmse / urdf, abs=0.5)
        assert float(times) == pytest.approx(nrmse / floor, rel=0.05)


def test_the_words_name_the_reference_that_was_used():
    assert graded(1.2, 0.01, 2.0, 1.0) == ("F", "no better than a constant torque")
    assert "of the error of a constant torque" in graded(0.5, 0.01, 2.0, 1.0)[1]
    assert graded(0.011, 0.01, 0.2, 1.0) == ("A", "as good as the noise of the sensors allows")
    assert graded(0.5, 0.0, 0.6, 1.0)[1] == "83 % of the error of the URDF with fitted friction"
