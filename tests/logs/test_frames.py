"""Data frames as logs."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from frischid.errors import InputError
from frischid.logs.frames import log_of_frame
from frischid.logs.given import as_logs
from frischid.logs.readers import read_log, write_log


def columns(**more):
    t = np.arange(50) / 100.0
    return {"t": t, "q_elbow": np.sin(t), "tau_elbow": np.cos(t), **more}


def test_a_frame_is_the_log_of_the_same_file(tmp_path):
    log = log_of_frame(pa.table(columns()))
    write_log(log, tmp_path / "log.parquet")
    again = read_log(tmp_path / "log.parquet")
    np.testing.assert_array_equal(log.q, again.q)
    np.testing.assert_array_equal(log.tau, again.tau)
    assert log.identity is not None, "a model can say that it was fitted to this frame"


def test_a_frame_takes_a_mapping():
    frame = pa.table({"stamp": 10.0 * np.arange(20), "pos": np.linspace(0, 90, 20)})
    mapping = {"file": {"time": "stamp", "time_unit": "ms"}, "joint": {"elbow": {"q": "pos", "angle_unit": "deg"}}}
    assert log_of_frame(frame, ("elbow",), mapping).q[-1, 0] == pytest.approx(np.pi / 2)


def test_what_is_no_frame_or_no_number_is_refused():
    with pytest.raises(InputError, match="expected a data frame of pandas, polars or pyarrow, got list"):
        log_of_frame([1, 2])
    with pytest.raises(InputError, match="column 'q_elbow' is not numeric: its values are of type"):
        log_of_frame(pa.table(columns(q_elbow=["a"] * 50)))


def test_dates_of_a_frame_are_stamps_as_in_a_file(tmp_path):
    stamps = pa.array((10**7 * np.arange(50)).astype("datetime64[ns]"))
    frame, mapping = pa.table(columns(t=stamps)), {"file": {"time_unit": "ns", "zero_time": True}}
    pa.parquet.write_table(frame, tmp_path / "log.parquet")
    read = read_log(tmp_path / "log.parquet", mapping=mapping)
    np.testing.assert_array_equal(log_of_frame(frame, mapping=mapping).t, read.t)
    assert read.t[-1] == 0.49


def test_two_columns_of_one_name_are_refused():
    frame = pa.table([*columns().values(), np.zeros(50)], names=[*columns(), "q_elbow"])
    with pytest.raises(InputError, match="frame: two columns have the same name; rename one"):
        log_of_frame(frame)
    with pytest.raises(InputError, match=r"logs\[0\]: two columns have the same name; rename one"):
        as_logs(frame, ("elbow",))


def test_columns_of_pandas_may_be_numbers():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(np.column_stack(list(columns().values())))  # as read without a header
    log = log_of_frame(frame, mapping={"file": {"time": 0}, "joint": {"elbow": {"q": 1, "tau": 2}}})
    np.testing.assert_array_equal(log.q[:, 0], frame[1])
