"""A small compressed file may hold more numbers than the memory: the numbers count, not the bytes on the disk."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from bag_files import mcap_ros2

import frischid as fr
from frischid.errors import InputError
from frischid.logs import content_size
from frischid.logs.content_size import check_size, content_bytes, fits_in_memory
from frischid.logs.log import Log

ROWS = 200_000
SIZE = 8 * ROWS * 3  # of t, q, tau


@pytest.fixture
def columns():
    return {"t": np.arange(ROWS) * 1e-3, "q_joint1": np.zeros(ROWS), "tau_joint1": np.zeros(ROWS)}


def test_a_compressed_parquet_file_is_as_large_as_its_numbers(tmp_path, columns):
    pq.write_table(pa.table(columns), tmp_path / "log.parquet", column_encoding=None, compression="zstd")
    assert (tmp_path / "log.parquet").stat().st_size < SIZE / 2
    assert content_bytes(tmp_path / "log.parquet") == SIZE


def test_the_numbers_of_lists_count(tmp_path):
    """Before, a column of lists counted as one column: a file of 100 times the memory that is allowed was read."""
    lists = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(ROWS * 7)), 7)
    pq.write_table(pa.table({"t": np.arange(ROWS) * 1e-3, "q": lists}), tmp_path / "log.parquet")
    assert content_bytes(tmp_path / "log.parquet") == 8 * ROWS * 8


def test_a_compressed_npz_archive_is_as_large_as_its_numbers(tmp_path, columns):
    np.savez_compressed(tmp_path / "log.npz", **columns)
    assert (tmp_path / "log.npz").stat().st_size < SIZE / 2
    assert SIZE <= content_bytes(tmp_path / "log.npz") < 1.01 * SIZE


def test_a_compressed_bag_is_as_large_as_its_messages(tmp_path):
    log = Log(np.arange(5000) * 1e-3, ("a", "b"), np.zeros((5000, 2)), tau=np.zeros((5000, 2)))
    mcap_ros2(log, tmp_path / "log.mcap")
    assert content_bytes(tmp_path / "log.mcap") > 8 * 5000 * 4


def test_a_damaged_file_is_left_to_its_reader(tmp_path):
    for name in ("log.parquet", "log.npz", "log.mcap"):
        (tmp_path / name).write_bytes(b"no log")
        assert content_bytes(tmp_path / name) == 6


def test_logs_together_must_fit(tmp_path, columns, monkeypatch):
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    monkeypatch.setattr(content_size, "IN_MEMORY", SIZE)
    assert fits_in_memory([tmp_path / "log.parquet"])
    assert not fits_in_memory([tmp_path / "log.parquet", tmp_path / "log.parquet"])


def test_a_file_of_too_many_numbers_is_refused_and_can_be_read_in_chunks(tmp_path, columns, monkeypatch):
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    monkeypatch.setattr(content_size, "MOST_BYTES", SIZE - 1)
    with pytest.raises(InputError, match=r"log\.parquet: holds 0\.0 GiB of numbers"):
        fr.read_log(tmp_path / "log.parquet")
    assert sum(len(part) for part in fr.read_chunks(tmp_path / "log.parquet")) == ROWS
    check_size(tmp_path / "missing.parquet")
