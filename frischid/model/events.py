"""Errors in the events of a model's history.

Every step measures its error on the logs that *select*: cross-validated on the fitted logs (``cross_validated``, a
whole headline), or in another way that ``measured_on`` names (``error_before``, ``error_after``). A step that was given
*test* logs has an error on these too: ``test``, a whole headline, and of a step that changed a model ``test_before``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np


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


def cross_validated_nrmse(history: Sequence[Mapping[str, Any]], joints: Collection[str] | None = None) -> float | None:
    """The last cross-validated error in a history, NRMSE: the model's own, or the median of a fleet's robots.

    Parameters
    ----------
    history : sequence of mapping
        `Model.history`.
    joints : collection of str, optional
        Joints whose error counts, where the history has the error of each joint; all by default.
    """
    for event in reversed(history):
        found = _nrmse(event, "cross_validated")
        if found is not None and joints is not None and not measured_within(event, joints):
            each = event["cross_validated"]["joints"].items()
            found = float(np.mean([x for name, x in each if name in joints] or [np.nan]))
        found = selection_errors(event)[1] if found is None and event["action"].startswith("identify") else found
        if found is not None:
            return found
    return None


def measured_within(event: Mapping[str, Any], joints: Collection[str]) -> bool:
    """Whether the cross-validated error of an event is one of these joints alone, as far as the event says."""
    each = (event.get("cross_validated") or {}).get("joints")
    return not isinstance(each, Mapping) or all(name in joints for name in each)


def _nrmse(event: Mapping[str, Any], key: str) -> float | None:
    return float(event[key]["nrmse"]) if event.get(key) else None
