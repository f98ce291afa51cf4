"""A self-test of a few seconds: the demonstration's simulated arm, whose truth is known.

It answers one question: does this installation compute what it should? It shows nothing about a robot or a log.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from frischid.cli.demo import Demo

STANDARD_ERRORS = 4.0
"""How far an identified parameter of the self-test may be from the truth, standard errors."""


@dataclass(frozen=True)
class Trial:
    """One step of the self-test."""

    name: str
    passed: bool
    detail: str
    """A figure, or the error."""
    seconds: float


def self_test() -> list[Trial]:
    """Run all steps; a step that raises has failed, and the next ones still run."""
    done: list[Demo] = []

    def demonstrated() -> tuple[bool, str]:
        from frischid.cli.demo import run

        done.append(run(0))
        return True, "an arm with known parameters, and the same arm with a hidden spring"

    steps: dict[str, Callable[[], tuple[bool, str]]] = {
        "simulate, identify, diagnose": demonstrated,
        "parameters": lambda: _parameters(done[0]),
        "missing effect": lambda: _diagnosis(done[0]),
        "save and load": lambda: _saved(done[0]),
    }
    return [_tried(name, step) for name, step in steps.items()]


def _tried(name: str, step: Callable[[], tuple[bool, str]]) -> Trial:
    start = time.perf_counter()
    try:
        passed, detail = step()
    except Exception as error:  # whatever is broken in an installation is to be shown, not to stop the report of it
        passed, detail = False, f"{type(error).__name__}: {error}"
    return Trial(name, passed, detail, time.perf_counter() - start)


def _parameters(demo: Demo) -> tuple[bool, str]:
    """Every true value lies within a few standard errors."""
    estimate = demo.found.model.estimate
    far = np.abs(estimate.theta - demo.truth) / estimate.stderr
    return bool(far.max() < STANDARD_ERRORS), f"worst of {len(far)}: {far.max():.1f} standard errors from the truth"


def _diagnosis(demo: Demo) -> tuple[bool, str]:
    """The hidden effect is named first, and the error falls when it is added."""
    first = demo.diagnosis.findings[0].effect
    fall = f"NRMSE {demo.step.error_before:.4f} → {demo.step.error_after:.4f}"
    right = demo.diagnosis.verdict == "effect" and first == "joint_spring"
    return right and demo.step.error_after < 0.1 * demo.step.error_before, f"{first}: {fall}"


def _saved(demo: Demo) -> tuple[bool, str]:
    """A model that is saved and loaded has the same torque to the last bit."""
    from frischid.model.model import Model

    log, model = demo.logs[0], demo.model
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.json"
        model.save(path)
        loaded = Model.load(path)
    still = np.zeros_like(log.q)
    same = np.array_equal(model.inverse_dynamics(log.q, still, still), loaded.inverse_dynamics(log.q, still, still))
    return same, "the same torque" if same else "another torque"
