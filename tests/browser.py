"""A real browser for tests: Debian's Chromium, driven by Playwright, with what it complained of and asked for."""

import os
import shutil
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
QUIET = ("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-sync", "--no-sandbox")  # fmt: skip
FLAT = ("--disable-gpu",)
SOLID = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
OVERLAPS = r"""(within) => {
  const turned = (t) => /rotate\((-?[\d.]+)/.exec(t.getAttribute('transform'));
  const level = (t) => turned(t) === null || [0, 90].includes(Math.abs(Number(turned(t)[1])));
  const boxes = [...within.querySelectorAll('svg text')]
    .filter((t) => t.textContent.trim() && getComputedStyle(t).visibility != 'hidden' && level(t))
    .map((t) => [t.textContent, t.getBoundingClientRect()]).filter(([, b]) => b.width > 0);
  const meet = (a, b, low, high) => Math.min(a[high], b[high]) - Math.max(a[low], b[low]) > 2;
  return boxes.flatMap(([m, a], i) => boxes.slice(i + 1)
    .filter(([, b]) => meet(a, b, 'left', 'right') && meet(a, b, 'top', 'bottom')).map(([n]) => m + ' / ' + n));
}"""
"""Words of figures that cover each other, in pairs; not slanted ones: their boxes overlap where they do not."""
SETTLED = 120_000  # ms; a page on a busy machine is slow, not wrong


def needs_browser(function):
    """Skip where there is no Chromium, but never in CI: there it is installed, and its absence is a failure."""
    why = "no chromium on this machine: apt-get install chromium"
    return pytest.mark.skipif(CHROMIUM is None and not os.environ.get("CI"), reason=why)(function)


@dataclass
class Seen:
    """A page, and all it said."""

    page: object
    complaints: list = field(default_factory=list)
    requests: list = field(default_factory=list)

    @property
    def outside(self):
        """Addresses asked for that are neither the page's own file nor data."""
        return [r for r in self.requests[1:] if not r.startswith(("data:", "blob:"))]


@contextmanager
def opened(address, width=1280, height=900, scheme="light", flags=FLAT, density=1):
    """Open an address; complaints are errors and warnings of the console and of scripts.

    `density` is the number of the screen's pixels per pixel of the page.
    """
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--headless", *QUIET, *flags])
        page = browser.new_page(
            viewport={"width": width, "height": height}, color_scheme=scheme, device_scale_factor=density
        )
        page.set_default_timeout(SETTLED)
        seen = Seen(page)
        page.on("console", lambda m: seen.complaints.append(m.text) if m.type not in ("log", "info", "debug") else None)
        page.on("pageerror", lambda e: seen.complaints.append(str(e)))
        page.on("request", lambda r: seen.requests.append(r.url))
        page.goto(address)
        try:
            yield seen
        finally:
            browser.close()


def violations(page):
    """Faults that axe-core finds for people who cannot see or use a mouse: rule, number, and the first element."""
    import axe_core_python

    page.evaluate((Path(axe_core_python.__file__).parent / "axe.min.js").read_text(encoding="utf-8"))
    found = page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    return [f"{x['id']}: {len(x['nodes'])}, {x['nodes'][0]['html'][:120]}" for x in found["violations"]]


CONTROLS = """() => [...document.querySelectorAll('a[href], button, input, summary, [tabindex="0"]')]
  .filter((e) => e.checkVisibility() && !e.disabled)"""
FOCUSED = """() => {
  const e = document.activeElement, first = e !== document.body && !e.dataset.reached;
  e.dataset.reached = "1";
  return first;
}"""


def reached(page):
    """Number of controls that the tabulator reaches one after the other, and the controls that it misses."""
    found = 0
    page.keyboard.press("Tab")
    while page.evaluate(FOCUSED):
        found += 1
        page.keyboard.press("Tab")
    missed = f"({CONTROLS})().filter((e) => !e.dataset.reached).map((e) => e.outerHTML.slice(0, 120))"
    return found, page.evaluate(missed)


def settled(condition, seconds=300.0):
    """Wait for something to become true; the limit only ends a test that hangs, also on a busy machine."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it took too long"
        time.sleep(0.05)


def unroll(page):
    """Open every fold of a report, bring every figure into view, and wait until it is drawn."""
    page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    # A figure above that is drawn in the meantime may push this one out of view again.
    into_view = "p => { p.scrollIntoView({behavior: 'instant', block: 'center'}); return p.dataset.drawn; }"
    for plot in page.query_selector_all(".plot"):
        page.wait_for_function(into_view, arg=plot)
