"""The report for everybody: axe-core finds nothing, the keyboard reaches all, on a large and a small screen."""

import pytest
from browser import needs_browser, opened, reached, unroll, violations

from frischid.cli import demo
from frischid.reports.page import report


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Reports on the demonstration's arm before and after the missing effect is added."""
    shown, folder = demo.run(0), tmp_path_factory.mktemp("accessible")
    before = report(shown.model, shown.logs, folder / "before.html", diagnosis=shown.diagnosis)
    after = report(shown.step.model, shown.logs, folder / "after.html")
    assert after.headline.nrmse < 0.1 * before.headline.nrmse
    return {name: (folder / f"{name}.html").as_uri() for name in ("before", "after")}


@needs_browser
@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    [("before", 1280, "light"), ("before", 390, "dark"), ("after", 1280, "dark"), ("after", 390, "light")],
)  # each page at each width and in each scheme, and each scheme at each width
def test_axe_finds_nothing(pages, name, width, scheme):
    with opened(pages[name], width=width, scheme=scheme) as seen:
        assert violations(seen.page) == []  # as it opens
        unroll(seen.page)
        assert violations(seen.page) == []
        assert seen.complaints == []


@needs_browser
def test_the_keyboard_reaches_every_control(pages):
    with opened(pages["after"]) as seen:
        unroll(seen.page)  # a figure that is drawn behind the focus has buttons that the focus has passed
        found, missed = reached(seen.page)
        assert missed == []
        assert found > 20


@needs_browser
@pytest.mark.parametrize("name", ["before", "after"])
def test_the_first_screen_answers_five_questions(pages, name):
    """How good, compared to what, what is wrong, where, what next: without scrolling, at 1280 × 900."""
    with opened(pages[name], width=1280, height=900) as seen:
        for part in (".grade", ".lead", ".ladder", "text=What is wrong, and where", ".robot svg", ".next"):
            box = seen.page.locator(part).first.bounding_box()
            assert box["y"] + box["height"] <= 900, part
