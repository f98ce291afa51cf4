"""One effect added to a model, and a finding that may not be added."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from frischid.diagnosis.findings import Finding
from frischid.effects import Effect
from frischid.model.headline import Headline, headline_of
from frischid.model.model import Model


class Refusal(NamedTuple):
    """A finding that is called missing but may not become a step, and why."""

    finding: Finding
    reason: str


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added.

    Attributes
    ----------
    model : Model
        The model with the effect.
    effect : Effect
    error_before, error_after : float
        Mean NRMSE on the logs that select, measured as `measured_on` says.
    measured_on : str
        How these errors are measured: cross-validated, or for a changed robot with the models before and after it.
    finding : Finding or None
        The finding that proposed it, where a diagnosis did.
    test_before, test_after : float or None
        Mean NRMSE on the test logs, which decide nothing; None without test logs.
    """

    model: Model
    effect: Effect
    error_before: float
    error_after: float
    measured_on: str
    finding: Finding | None
    test_before: float | None = None
    test_after: float | None = None

    def __repr__(self) -> str:
        return f"Step({self.effect}: NRMSE {self.error_before:.4f} → {self.error_after:.4f}, {self.measured_on})"

    @property
    def headline(self) -> Headline | None:
        """The new model's error: on the test logs, or cross-validated without any; None where it was not measured."""
        return headline_of(self.model.history[-1])
