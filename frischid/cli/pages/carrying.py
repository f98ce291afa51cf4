"""An identified payload as a page."""

from __future__ import annotations

from typing import Any

from rich.markup import escape

from frischid.cli.pages.page import Page, figure, table_of
from frischid.core.text import percent
from frischid.errors import NoBodyError
from frischid.model.identified_payload import IdentifiedPayload

BODY_UNITS = {"mass": "kg"} | dict.fromkeys("xyz", "m")


def no_body(none: NoBodyError, output: str | None) -> Page:
    """The largest mass that these logs leave possible. A script gets exit code 1 and no numbers to enter."""
    empty = dict.fromkeys(("mass", "center_of_mass", "inertia", "nrmse", "nrmse_without", "enter"))
    data = {
        "frame": none.frame, "carrier": none.carrier, **empty,
        "bound_95": {"mass": none.limit}, "from_log": {}, "notes": [str(none)], "alarms": [],
    }  # fmt: skip
    said = [escape(str(none)), *([f"nothing was written to {output}"] if output else [])]
    return Page(data, said, found_nothing=True)


def payload(found: IdentifiedPayload, output: str | None) -> Page:
    """Numbers with bounds, and the text to enter."""
    table = table_of("quantity", "unit", "value", "± (95 %)", "from the log")
    for name, x in found.values.items():
        numbers = figure(x), f"{found.bound[name]:.2g}", percent(found.from_log[name])
        table.add_row(name, BODY_UNITS.get(name, "kg·m²"), *numbers)
    frame = "the joint's own frame" if found.frame == f"joint {found.carrier}" else f"the frame {found.frame}"
    parts: list[Any] = [
        escape(f"body on the link of {found.carrier}, in {frame}; inertia about the centre of mass"),
        table,
        f"NRMSE {found.error:.4f} with the body, {found.error_without:.4f} without",
        *(escape(note) for note in found.notes),
        escape(f"Franka (SetLoad, setLoad): {found.franka()}"),
        escape(f"UR (URScript): {found.ur()}"),
        escape(f"KUKA (KRL, mm): {found.kuka()}"),
        *([f"written to {output}"] if output else []),
    ]
    return Page(found.to_dict(), parts, found.alarms)
