"""Errors in the events of a model's history, on the logs that selected the step and on the test logs.

Every step has an error on the logs that *select*, cross-validated unless the event says otherwise. A step that was
given *test* logs has an error on these too.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from frischid.model.headline import headline_of


def selection_errors(event: Mapping[str, Any]) -> tuple[float | None, float | None]:
    """Error before and after an event on the logs that select, NRMSE; None where there is none."""
    return event.get("error_before"), event.get("error_after", event.get("cross_validated_nrmse"))


def measured_on(event: Mapping[str, Any]) -> str:
    """How these errors are measured, in words; empty where there are none."""
    said = "" if selection_errors(event)[1] is None else "cross-validated on the fitted logs"
    return str(event.get("measured_on", said))


def test_errors(event: Mapping[str, Any]) -> list[float]:
    """Errors on the test logs, NRMSE: before and after, or after alone; empty without test logs."""
    found = (event.get("test_before"), event.get("test_after", event.get("held_out_nrmse")))
    return [float(x) for x in found if x is not None]


def error_after(event: Mapping[str, Any]) -> tuple[float, str] | None:
    """The model's one error after an event, NRMSE, and what it is measured on; None where nobody measured it."""
    found = headline_of(event)
    if found is not None:
        return found.nrmse, found.where
    tested = test_errors(event)  # of a file from before there was a headline
    if tested:
        return tested[-1], "on logs it was not fitted to"
    selected = selection_errors(event)[1]
    return None if selected is None else (float(selected), measured_on(event))
