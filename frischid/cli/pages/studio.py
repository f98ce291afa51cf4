"""A studio that runs, as a page; apart from the others, for it is printed before anything heavy is imported."""

from __future__ import annotations

from frischid.cli.pages.page import Page, warning_lines


def studio(address: str, output: str, host: str) -> Page:
    """Where the studio is, and who can reach it."""
    open_to = [] if host in ("127.0.0.1", "localhost", "::1") else [
        f"listening on {host}, not only on this machine: whoever reaches it can change the model and write {output}"
    ]  # fmt: skip
    data = {"address": address, "output": output, "warnings": open_to}
    return Page(data, [f"studio: {address} (Ctrl-C ends it); it saves to {output}", *warning_lines(open_to)])
