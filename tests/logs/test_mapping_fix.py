"""Mapping files that undo faults: what a check found is gone when the log is read with them."""

import numpy as np
import pytest

from frischid.logs.mapping import LogMap
from frischid.logs.mapping_fix import corrected
from frischid.logs.readers import read_log

TIME = np.arange(50) / 10
COLUMNS = {"t": TIME, "q_a": np.sin(TIME), "q_b": np.cos(TIME), "current_a": 1 + TIME, "current_b": 2 - TIME}
TORQUES = {"tau_a": 3 * TIME, "tau_b": 5 - TIME}
GAINS = {"current_gain": {"a": 9.0, "b": 5.0}}


def written(path, columns):
    """The path of a log with these columns."""
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


@pytest.mark.parametrize("measured", [False, True], ids=["currents", "torques beside currents"])
def test_a_unit_of_torques_is_undone_whatever_they_are_made_of(tmp_path, measured):
    path, form = written(tmp_path / "log.csv", COLUMNS | (TORQUES if measured else {})), LogMap.from_dict(GAINS)
    log = read_log(path, mapping=form)
    fixed = corrected(form, [(name, "torque_factor", 1e-3) for name in "ab"], log)
    np.testing.assert_allclose(read_log(path, mapping=fixed).tau, 1e-3 * log.tau, rtol=1e-12)


@pytest.mark.parametrize("measured", [False, True], ids=["currents", "torques beside currents"])
def test_exchanged_torques_are_exchanged_back_whatever_they_are_made_of(tmp_path, measured):
    path, form = written(tmp_path / "log.csv", COLUMNS | (TORQUES if measured else {})), LogMap.from_dict(GAINS)
    log = read_log(path, mapping=form)
    fixed = read_log(path, mapping=corrected(form, [("a", "tau", "b"), ("b", "tau", "a")], log))
    if measured:
        np.testing.assert_array_equal(fixed.tau, log.tau[:, ::-1])
    else:  # each joint keeps its gain
        np.testing.assert_allclose(fixed.tau, [9.0, 5.0] * log.current[:, ::-1], rtol=1e-12)
