"""Errors in the events of a model's history, by the role of the log they were measured on.

Every step has an error on the logs that *select*, cross-validated where nothing else is said. It has one on the *test*
logs where the step was given some.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


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
