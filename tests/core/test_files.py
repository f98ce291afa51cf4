"""Files appear when they are whole, where they were asked for, and nowhere else."""

import os
import subprocess
import sys

import pytest

from frischid.core.files import check_writable, read_toml, write_text, written
from frischid.errors import InputError


def test_a_link_is_followed(tmp_path):
    (tmp_path / "deep").mkdir()
    target, link = tmp_path / "deep" / "model.json", tmp_path / "link.json"
    link.symlink_to(target)
    for text in ("one", "two"):  # first it leads nowhere yet
        write_text(link, text)
        assert target.read_text() == text
    assert link.is_symlink()


def test_what_is_no_file_is_refused_and_stays(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="pipe is a device or a pipe; give the name of a file"):
        write_text(pipe, "text")
    assert pipe.is_fifo()
    with pytest.raises(InputError, match="is a folder"):
        check_writable(tmp_path)
    with pytest.raises(InputError, match="there is no folder"):
        check_writable(tmp_path / "missing" / "file")


def test_an_error_leaves_the_old_file_and_no_other(tmp_path):
    path = tmp_path / "file"
    write_text(path, "old")

    def broken(error):
        with written(path) as scratch:
            scratch.write_text("half")
            raise error

    with pytest.raises(ZeroDivisionError):
        broken(ZeroDivisionError)
    with pytest.raises(InputError, match="cannot be written"):
        broken(OSError(28, "No space left on device"))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    assert path.read_text() == "old"


KILLED = """
import os, signal, sys
from frischid.core.files import written
with written(sys.argv[1]) as scratch:
    scratch.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_next_writer_removes_what_a_killed_one_left_behind(tmp_path):
    path = tmp_path / "model.json"
    write_text(path, "old")
    subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False)
    assert len(list(tmp_path.iterdir())) == 2
    assert path.read_text() == "old"
    write_text(tmp_path / "other.json", "new")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["model.json", "other.json"]


def test_two_writers_leave_each_other_alone(tmp_path):
    with written(tmp_path / "one") as one:
        one.write_text("one")
        with written(tmp_path / "one") as two:
            two.write_text("two")
            write_text(tmp_path / "three", "three")
            assert one.exists()
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"one": "one", "three": "three"}


def test_names_up_to_the_systems_limit_and_none_above(tmp_path):
    write_text(tmp_path / ("a" * 255), "text")
    for name in ("a" * 256, "ö" * 128, "x/" * 3000):
        with pytest.raises(InputError, match=r"cannot be written|no folder"):
            write_text(tmp_path / name, "text")


def test_links_in_a_circle_are_said(tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    with pytest.raises(InputError, match="cannot be written"):
        write_text(tmp_path / "a", "text")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_what_is_write_protected_stays(tmp_path):
    path = tmp_path / "file"
    path.write_text("old")
    path.chmod(0o444)
    with pytest.raises(InputError, match="write-protected"):
        write_text(path, "new")
    tmp_path.chmod(0o555)
    with pytest.raises(InputError, match="you may not write in the folder"):
        write_text(tmp_path / "new", "new")
    tmp_path.chmod(0o755)


def test_a_toml_file_of_windows_has_a_byte_order_mark(tmp_path):
    """It had been "not TOML: Invalid statement"."""
    (tmp_path / "map.toml").write_bytes(b'\xef\xbb\xbf[file]\r\ntime = "Zeit"\r\n')
    tables, content = read_toml(tmp_path / "map.toml", "mapping")
    assert tables == {"file": {"time": "Zeit"}}
    assert content == (tmp_path / "map.toml").read_bytes()
