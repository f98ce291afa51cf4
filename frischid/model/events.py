"""Errors in the events of a model's history.

Every step measures its error on the logs that *select*: cross-validated on the fitted logs (``cross_validated``, a
whole headline), or in another way that ``measured_on`` names (``error_before``, ``error_after``). A step that was given
*test* logs has an error on these too: ``test``, a whole headline, and of a step that changed a model ``test_before``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


def selection_errors(event: Mapping[str, Any]) -> tuple[float | None, float | None]:
    """Error before and after an event on the logs that select, NRMSE; None where there is none."""
    after = event["error_after"] if "error_after" in event else _nrmse(event, "cross_validated")
    return event.get("error_before"), after


def measured_on(event: Mapping[str, Any]) -> str:
    """How these errors are measured, in words; empty where there are none."""
    said = "" if selection_errors(event)[1] is None else "cross-validated on the fitted logs"
    return str(event.get("measured_on", said))


def test_errors(event: Mapping[str, Any]) -> list[float]:
    """Errors on the test logs, NRMSE: before and after, or after alone; empty without test logs."""
    found = (event.get("test_before"), _nrmse(event, "test"))
    return [float(x) for x in found if x is not None]


def cross_validated_nrmse(history: Sequence[Mapping[str, Any]]) -> float | None:
    """The last cross-validated error in a history, NRMSE: the model's own, or the median of a fleet's robots.

    Parameters
    ----------
    history : sequence of mapping
        `Model.history`.
    """
    for event in reversed(history):
        found = _nrmse(event, "cross_validated")
        found = selection_errors(event)[1] if found is None and event["action"].startswith("identify") else found
        if found is not None:
            return found
    return None


def _nrmse(event: Mapping[str, Any], key: str) -> float | None:
    return float(event[key]["nrmse"]) if event.get(key) else None
