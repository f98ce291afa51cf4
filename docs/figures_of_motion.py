"""Figures within sentences about commanded drives and simulated motion, from the stored results."""

from __future__ import annotations

import re
from collections.abc import Iterator

from table_parts import Row, data, percent, rows_of

QUANTITIES = ("armature %", "viscous %")
DOUBTED = ("delay, delay in doubt %", "armature, delay in doubt %", "viscous, delay in doubt %")


def far_so101() -> str:
    """Values of the SO-101 that are more than 5 % off."""
    return percent(1 - _drives("so101")["within 5 %"])


def identified_so101() -> str:
    """Values of the SO-101 whose range lies within 5 %."""
    return percent(_drives("so101")["range within 5 %"])


def identified_panda() -> str:
    """Values of the Panda whose range lies within 5 %."""
    return percent(_drives("panda")["range within 5 %"])


def identified_go2() -> str:
    """Values of the Go2's leg whose range lies within 5 %."""
    return percent(_drives("go2")["range within 5 %"])


def identified_right() -> str:
    """Values that are called identified and lie within 5 % of the truth, at the worst robot."""
    return percent(min(row["of these within 5 %"] for row in rows_of("commanded_mujoco")))


def alone_in_a_sum() -> str:
    """Motion that a value in a sum causes alone, mrad, over the robots."""
    moved = [row["most alone mrad"] for row in rows_of("commanded_free") if row["known"] == "in a sum"]
    return f"{min(moved):.2g} to {max(moved):.2g}"


def chirps_narrow() -> str:
    """How many times narrower chirps make the ranges of armature, viscous friction and delay, least and most."""
    rows = {(row["robot"], row["motion"]): row for row in rows_of("drive_excitation")}
    ratios = [
        rows[robot, "plain"][key] / rows[robot, "chirps"][key]
        for robot in dict.fromkeys(robot for robot, _ in rows)
        for key in (*QUANTITIES, *DOUBTED)
    ]
    return f"{min(ratios):.0f} to {max(ratios):.0f}"


def emps_drift_train() -> str:
    """Error on the EMPS's fitted log with asymmetric friction and a drifting torque zero, mm."""
    return f"{_emps('with asymmetric_viscous and torque_drift', 'output_error')['train mm']:.1f}"


def emps_drift_test() -> str:
    """Error of the same model on the EMPS's official test, mm."""
    return f"{_emps('with asymmetric_viscous and torque_drift', 'output_error')['test mm']:.1f}"


def emps_train() -> str:
    """Error on the EMPS's fitted log with the usual friction, mm."""
    return f"{_emps('baseline', 'output_error')['train mm']:.1f}"


def emps_test() -> str:
    """Error of the same model on the EMPS's official test, mm."""
    return f"{_emps('baseline', 'output_error')['test mm']:.1f}"


def emps_recorded_train() -> str:
    """Error on the EMPS's fitted log with the torque as recorded, mm."""
    return f"{_emps('baseline, torque as recorded', 'output_error')['train mm']:.1f}"


def emps_recorded_test() -> str:
    """Error on the EMPS's official test with the torque as recorded, mm."""
    return f"{_emps('baseline, torque as recorded', 'output_error')['test mm']:.1f}"


def emps_chosen_test() -> str:
    """Error on the EMPS's official test of the model that was chosen within `train`, mm."""
    return f"{_emps_chosen()['test mm']:.1f}"


def emps_chosen_half() -> str:
    """Error of this model on the other half of `train`, mm."""
    return f"{_emps_chosen()['other half mm']:.1f}"


def emps_own_train() -> str:
    """Error on the EMPS's `train` of a model that was fitted to the test, mm."""
    return f"{_emps('with asymmetric_viscous', 'output_error on test_pulses')['train mm']:.1f}"


def emps_own_test() -> str:
    """Error on the EMPS's official test of a model that was fitted to the test, mm."""
    return f"{_emps('with asymmetric_viscous', 'output_error on test_pulses')['test mm']:.1f}"


def emps_more_force() -> str:
    """How much more force the EMPS needs in its test at the steady speeds, least and most."""
    more = [abs(test) / abs(train) - 1 for train, test in _forces()]
    return f"{100 * min(more):.0f} to {100 * max(more):.0f} %"


def emps_lag() -> str:
    """Time by which the EMPS's torque is ahead of the motion, ms, with its standard error."""
    row = _lag()
    return f"{-row['lag, ms']:.2f} ± {row['standard error, ms']:.2f}"


def emps_as_recorded() -> str:
    """Error of the EMPS's model on the test log with the torque as recorded."""
    return f"{_lag()['error, torque as recorded']:.4f}"


def calf_without() -> str:
    """Simulated position error of the Go2's rear left calf on the fitted part, without position-dependent friction."""
    return f"{_calf('commands'):.3f}"


def calf_with() -> str:
    """The same error with the friction that the diagnosis names."""
    return f"{_calf('found'):.3f}"


def calves_named() -> str:
    """Probability of the first finding on the Go2's commands."""
    said = next(note for note in data("commanded_positions")["notes"] if "names first" in note)
    return percent(float(said.rpartition("probability ")[2]))


def _drives(robot: str) -> Row:
    return next(row for row in rows_of("commanded_mujoco") if row["robot"] == robot)


def _emps(model: str, parameters: str) -> Row:
    return next(row for row in rows_of("simulated_motion") if (row["model"], row["parameters"]) == (model, parameters))


def _emps_chosen() -> Row:
    return next(row for row in rows_of("simulated_motion") if row.get("chosen"))


def _forces() -> Iterator[tuple[float, float]]:
    """Mean force at each steady speed, in the fitted log and in the test log, N."""
    for note in data("simulated_motion")["notes"]:
        if found := re.fullmatch(r"mean force at \S+ m/s: (\S+) N in train, (\S+) N in test_pulses", note):
            yield float(found[1]), float(found[2])


def _lag() -> Row:
    return next(row for row in rows_of("torque_lag") if row["robot"] == "emps" and row["logs"].startswith("train"))


def _calf(model: str) -> float:
    row = next(row for row in rows_of("commanded_positions") if row["model"] == model)
    return float(row["fitted RL_calf_joint rad"])
