"""A real browser for tests: Debian's Chromium, driven by Playwright, with what it complained of and asked for."""

import os
import shutil
from contextlib import contextmanager
from dataclasses import dataclass, field

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
QUIET = ("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
         "--disable-sync", "--no-sandbox")  # fmt: skip
FLAT = ("--disable-gpu",)
SOLID = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
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
def opened(address, width=1280, height=900, scheme="light", flags=FLAT):
    """Open an address; complaints are errors and warnings of the console and of scripts."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--headless", *QUIET, *flags])
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
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
