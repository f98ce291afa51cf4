"""The README's screenshots of the report and the studio, taken in a headless Chromium.

Shows the UR10e when FRISCHID_DATA is set, the demonstration's planar arm otherwise. Needs Chromium, the extra
``frischid[dev]``, and ``tests/browser.py``, which the tests use too.
"""

from __future__ import annotations

import io
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page

import frischid as fr
from frischid.cli import demo
from frischid.reports.page import report
from frischid.studio import studio

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser import SOLID, opened
from common import data_folder
from real_robots import CASES, identified

ROOT = Path(__file__).parents[1]
WIDTH, HEIGHT = 1280, 900
SHRUNK = (960, 675)


def subject() -> tuple[fr.Model, list[fr.Log]]:
    """A model, and logs to show the model on."""
    folder = data_folder()
    if folder is None:
        shown = demo.run(0)
        return shown.model, list(shown.logs)
    case = CASES[0]
    found, _ = identified(case, folder)
    robot = found.model.robot
    return found.model, [fr.read_log(folder / path, robot.joints, case.mapping) for path in (*case.fit, *case.valid)]


def keep(png: bytes, name: str) -> None:
    """Write a small WebP."""
    path = ROOT / "docs" / name
    Image.open(io.BytesIO(png)).convert("RGB").resize(SHRUNK, Image.Resampling.LANCZOS).save(path, quality=82, method=6)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


def main() -> None:
    """Take both screenshots."""
    model, logs = subject()
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        shown = report(model, logs, page)
        with opened(page.as_uri(), WIDTH, HEIGHT) as seen:
            seen.page.evaluate("document.querySelector('#fails').scrollIntoView({behavior: 'instant'})")
            seen.page.wait_for_selector("#fails .plot[data-drawn]")
            seen.page.wait_for_timeout(1500)
            keep(seen.page.screenshot(), "report.webp")
        assert shown.diagnosis is not None
        best = next(f for f in shown.diagnosis.findings if f.significant and f.members)
        running = studio(model, logs, Path(folder) / "model.json", port=8400)
        try:
            with opened(running.address, WIDTH, HEIGHT, flags=SOLID) as seen:
                seen.page.set_default_timeout(120_000)
                seen.page.get_by_role("button", name=f"Add {best.effect}").click()
                seen.page.wait_for_selector("text=Last step,")
                _close_notice(seen.page)
                while running.bench.state.diagnosis is None or running.bench.state.first_look:
                    time.sleep(0.2)
                seen.page.wait_for_timeout(4000)
                keep(seen.page.screenshot(timeout=120_000), "studio.webp")
        finally:
            running.stop()


def _close_notice(page: Page) -> None:
    """Close viser's notice that this machine has no GPU."""
    page.locator(".mantine-Notification-closeButton").first.click()


if __name__ == "__main__":
    main()
