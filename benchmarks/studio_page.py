"""Time that a user of the studio waits: from the command to view and findings, and from a click to the new error.

`frischid studio` runs as a process of its own, on the UR10e's five identification logs if FRISCHID_DATA is set, and
otherwise on those of the planar demonstration. A headless Chromium, which is already open, loads the page as soon as it
is served. Without a GPU, the browser draws the robot on the same processor that computes. Needs Chromium. Screenshots
show when the robot is drawn; they take time themselves.
"""

from __future__ import annotations

import io
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

from common import data_folder, parser, publish
from PIL import Image
from playwright.sync_api import sync_playwright
from real_robots import CASES, UR10E_GAIN, identified

import frischid as fr
from frischid.cli import demo

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser import CHROMIUM, QUIET

CURVES = "() => document.querySelectorAll('.js-plotly-plot .scatterlayer .trace path').length >= 2"
SETTLED = "() => !document.body.innerText.includes('A first look')"
PATIENCE = 300_000  # ms; long, because a busy machine is slow
SERVED, VERDICT, DRAWN, ROBOT = "page served", "verdict", "curves", "curves and robot"
FOUND, ALL_FOUND = "first findings", "findings of all logs"
CLICK, AGAIN = "click to new error", "click to first new findings"
ASKED = {SERVED: None, VERDICT: 5.0, DRAWN: 5.0, ROBOT: 5.0, FOUND: 5.0, ALL_FOUND: None, CLICK: 3.0, AGAIN: None}
OFFER = re.compile("^Add .*: error")
OFFERED = "() => [...document.querySelectorAll('button')].some(b => /^Add .*: error/.test(b.textContent))"
NOT_OFFERED = OFFERED.replace("() => ", "() => !")
POLL = 50  # ms; to look at every frame of the page would take much of a processor from the page
MIDDLE = {"x": 560, "y": 300, "width": 160, "height": 300}  # part of the page in which the robot is drawn
SHADES = 20  # shades of grey; a scene with fewer is empty


def main() -> None:
    """Print the table."""
    arguments = parser(__doc__)
    arguments.add_argument("--rounds", type=int, default=7)
    arguments.add_argument("--gl", default="", metavar="SWITCHES", help="how the browser draws in 3D; its own choice")
    options = arguments.parse_args()
    if CHROMIUM is None:
        sys.exit("error: no chromium on this machine: apt-get install chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        arguments_of_studio, shown = subject(Path(folder))
        rounds = []
        for i in range(1 + options.rounds):
            browser = playwright.chromium.launch(
                executable_path=CHROMIUM, args=["--headless", *QUIET, *options.gl.split()]
            )
            rounds.append(waits(browser, arguments_of_studio, 8500 + 10 * i))
            browser.close()
    del rounds[0]  # so that compiled modules and file caches exist for all counted rounds
    rows = []
    for name, asked in ASKED.items():
        seconds = [found[name] for found in rounds]
        rows.append(
            {
                "wait": name,
                "best s": min(seconds),
                "median s": statistics.median(seconds),
                "worst s": max(seconds),
                "asked": "" if asked is None else f"{asked:g}",
                "reached": "" if asked is None else ("yes" if max(seconds) <= asked else "NO"),
            }
        )
    notes = [
        f"{options.rounds} rounds after one that is not counted, each with a new process; the times after a click run "
        "from the click, all others from the start of the command"
    ]
    publish(f"the studio on {shown}", rows, options.json, notes)


def subject(folder: Path) -> tuple[list[str], str]:
    """A model, saved, and the arguments that show it on its logs."""
    model, data = folder / "model.json", data_folder()
    if data is None:
        shown = demo.run(0)
        shown.model.save(model)
        logs = [folder / f"log{i}.parquet" for i in range(len(shown.logs))]
        for log, path in zip(shown.logs, logs, strict=True):
            fr.write_log(log, path)
        return [str(model), *map(str, logs)], "the demonstration's arm"
    case = CASES[0]
    found, _ = identified(case, data)
    found.model.save(model)
    gains = folder / "map.toml"
    lines = [f"{joint} = {gain}" for joint, gain in UR10E_GAIN.items()]
    gains.write_text("\n".join(["[current_gain]", *lines, ""]), encoding="utf-8")
    logs = [data / path for path in case.fit]
    return [str(model), *map(str, logs), "--map", str(gains)], f"the UR10e's {len(logs)} logs"


def waits(browser: Any, arguments: list[str], port: int) -> dict[str, float]:
    """Seconds of one session."""
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.set_default_timeout(PATIENCE)
    start = time.perf_counter()
    command = [sys.executable, "-m", "frischid", "studio", *arguments, "--port", str(port)]
    compiled = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}  # as on a user's machine
    running = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=compiled)
    assert running.stdout is not None
    try:
        address = running.stdout.readline().split()[1]  # studio: http://localhost:8080/TOKEN (Ctrl-C ends it)
        while not served(address):
            time.sleep(0.01)
        found = {SERVED: time.perf_counter() - start}
        page.goto(address, wait_until="commit")
        page.wait_for_selector("text=misses")
        found[VERDICT] = time.perf_counter() - start
        page.wait_for_function(CURVES, polling=POLL)
        found[DRAWN] = time.perf_counter() - start
        while shades(page.screenshot(clip=MIDDLE)) < SHADES:
            if time.perf_counter() - start > PATIENCE / 1000:
                sys.exit("error: the page never draws the robot")
        found[ROBOT] = time.perf_counter() - start
        page.wait_for_function(OFFERED, polling=POLL)
        found[FOUND] = time.perf_counter() - start
        page.wait_for_function(SETTLED, polling=POLL)
        found[ALL_FOUND] = time.perf_counter() - start
        page.wait_for_timeout(1000)
        start = time.perf_counter()
        page.get_by_role("button", name=OFFER).first.click()
        page.wait_for_selector("text=Last step, ")
        found[CLICK] = time.perf_counter() - start
        page.wait_for_function(NOT_OFFERED, polling=POLL)
        page.wait_for_function(OFFERED, polling=POLL)
        found[AGAIN] = time.perf_counter() - start
    finally:
        running.send_signal(signal.SIGINT)
        running.wait()
        page.close()
    return found


def shades(png: bytes) -> int:
    """Number of shades of grey in a picture."""
    return len(Image.open(io.BytesIO(png)).convert("L").getcolors() or ())


def served(address: str) -> bool:
    """Whether the page is served."""
    try:
        with urllib.request.urlopen(address) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


if __name__ == "__main__":
    main()
