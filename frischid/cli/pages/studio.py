"""The address of a running studio, as a page; a module of its own, because nothing heavy may be imported before."""

from __future__ import annotations

from frischid.cli.pages.page import Page, warning_lines


def studio(address: str, output: str, host: str) -> Page:
    """The studio's address, and a warning if other machines can reach it."""
    open_to = [] if host in ("127.0.0.1", "localhost", "::1") else [
        f"listening on {host}, not only for this machine: anybody who reaches the page can change the model and "
        f"write {output}"
    ]  # fmt: skip
    data = {"address": address, "output": output, "warnings": open_to}
    return Page(data, [f"studio: {address} (Ctrl-C ends it); the model is saved to {output}", *warning_lines(open_to)])
