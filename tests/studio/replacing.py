"""Another function in place of the diagnosis, for a first look at stretches and for the look at all logs."""

from collections.abc import Callable
from typing import Any

import pytest

from frischid.diagnosis import diagnosis, roles


def instead_of_diagnose(monkeypatch: pytest.MonkeyPatch, function: Callable[..., Any]) -> None:
    """Let the studio call `function` wherever it diagnoses."""
    for module in (diagnosis, roles):
        monkeypatch.setattr(module, "diagnose", function)
