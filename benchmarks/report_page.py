"""Size of a report, and the time to its first paint in a headless Chromium.

The reports are those of the demonstration's arm and, if FRISCHID_DATA is set, of a UR10e on six logs. Models given as
MODEL and LOG are added: `--model MODEL LOG...`. Needs Chromium.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from common import data_folder, parser, publish
from playwright.sync_api import sync_playwright
from real_robots import CASES, identified

import frischid as fr
from frischid.cli import demo
from frischid.reports.page import report

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser import CHROMIUM, QUIET

LARGEST, LATEST = 6.0, 2.0  # MB and s that a page may need
PAINTED = """() => new Promise((done) => new PerformanceObserver((list) =>
  done(list.getEntriesByName("first-contentful-paint")[0].startTime)).observe({type: "paint", buffered: true}))"""


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--rounds", type=int, default=7)
    arguments.add_argument("--model", nargs="+", default=[], metavar="FILE", help="a model, then its logs as read")
    options = arguments.parse_args()
    if CHROMIUM is None:
        sys.exit("error: no chromium on this machine: apt-get install chromium")
    rows = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        for name, model, logs in subjects(options.model):
            path = Path(folder) / "page.html"
            report(model, logs, path)
            seconds = [painted(playwright, path) for _ in range(options.rounds)]
            size = path.stat().st_size / 1e6
            rows.append(
                {
                    "report": name,
                    "MB": size,
                    "best s": min(seconds),
                    "median s": statistics.median(seconds),
                    "worst s": max(seconds),
                    "asked": f"{LARGEST:g} MB, {LATEST:g} s",
                    "reached": "yes" if size <= LARGEST and max(seconds) <= LATEST else "NO",
                }
            )
    publish("first paint of a report", rows, options.json, [f"{options.rounds} rounds, each with a new browser"])


def subjects(given: list[str]) -> Iterator[tuple[str, fr.Model, list[fr.Log]]]:
    """Name, model and logs of each report."""
    shown = demo.run(0)
    yield "demonstration, before", shown.model, list(shown.logs)
    yield "demonstration, after", shown.step.model, list(shown.logs)
    folder = data_folder()
    if folder is not None:
        case = CASES[0]
        found, _ = identified(case, folder)
        paths = [folder / path for path in (*case.fit, *case.valid)]
        yield "UR10e", found.model, [fr.read_log(path, found.model.robot.joints, case.mapping) for path in paths]
    if given:
        model = fr.Model.load(given[0])
        yield given[0], model, [fr.read_log(path, model.robot.joints) for path in given[1:]]


def painted(playwright: Any, path: Path) -> float:
    """Seconds from the request of a page to its first text or picture."""
    browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--headless", *QUIET])
    try:
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.goto(path.as_uri(), wait_until="commit")
        return float(page.evaluate(PAINTED)) / 1000
    finally:
        browser.close()


if __name__ == "__main__":
    main()
