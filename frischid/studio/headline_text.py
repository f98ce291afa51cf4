"""The text at the top of the page: the model's error, its last step, and notes on the logs."""

from __future__ import annotations

from frischid.core.text import sentence
from frischid.figures.history import steps_of
from frischid.model.events import test_errors
from frischid.studio.bench import Bench, State
from frischid.studio.words import plain


def error_text(state: State) -> str:
    """The one error of the model with its references, its alarms, and the fall of the error with the last step."""
    error = state.headline
    kinds = {"severe": "Alarm", "doubt": "Doubt"}
    alarms = "".join(f"**{kinds[alarm.severity]}:** {plain(str(alarm))}\n\n" for alarm in error.alarms)
    return (
        f"{alarms}**{error.grade}** {error.grade_in_words}. "
        f"The model misses **{_percent(error.nrmse)}** of the torque's standard deviation "
        f"(NRMSE {error.nrmse:.4f} {error.where}). Sensors alone {_percent(error.noise_floor)}, "
        f"URDF with fitted friction {_percent(error.urdf_nrmse)}, constant torque {_percent(error.constant_nrmse)}."
        f"{_last_step(state)}"
    )


def verdict_errors(state: State) -> dict[str, float]:
    """Error of each joint as the verdict has it: on the test logs if there are any, as in the report's picture."""
    return {name: state.headline.joints.get(name, j.nrmse) for name, j in state.comparison.joints.items()}


def origin_text(bench: Bench) -> str:
    """Notes where logs of the fit are missing, and where the logs that select come from others than those given."""
    count = bench.absent
    few = f"{count} log{'s' * (count > 1)} the model was fitted to {'is' if count == 1 else 'are'} not here"
    absent = f"\n\n{few}: new effects are fitted without {'it' if count == 1 else 'them'}." if count else ""
    return absent + (f"\n\n{plain(sentence(bench.note))}." if bench.note else "")


def _percent(share: float) -> str:
    """As the report has it; no line ends between the number and its sign."""
    return f"{100 * share:.1f}\N{NO-BREAK SPACE}%"


def _last_step(state: State) -> str:
    """The fall of the error with the last step, on its test logs where there were any; empty without a step."""
    steps = steps_of(state.model)
    if len(steps) < 2 or steps[-1][1] is None:
        return ""
    event = state.model.history[-1]
    tested = test_errors(event)
    before, after = tested if len(tested) == 2 else steps[-1][1:]
    where = "on the logs not fitted" if len(tested) == 2 else event.get("measured_on", "cross-validated")
    return f"\n\nLast step, **{plain(steps[-1][0])}**: {before:.4f} → **{after:.4f}** ({plain(str(where))})."
