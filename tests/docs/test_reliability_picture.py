"""The reliability diagram is drawn from the stored answers, and its intervals are Wilson's."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from scipy.stats import binomtest

SCRIPT = Path(__file__).parents[2] / "docs" / "reliability_picture.py"


@pytest.fixture(scope="module")
def drawn():
    spec = spec_from_file_location("reliability_picture", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_picture_is_that_of_the_stored_answers(drawn):
    assert drawn.TARGET.read_text(encoding="utf-8") == drawn.picture(), "run python docs/reliability_picture.py"


@pytest.mark.parametrize(("right", "cases"), [(0, 5), (3, 7), (12, 12), (85, 90)])
def test_the_bars_are_wilsons_intervals(drawn, right, cases):
    known = binomtest(right, cases).proportion_ci(0.9, method="wilson")
    assert drawn.interval(right, cases) == pytest.approx((known.low, known.high), abs=1e-3)
