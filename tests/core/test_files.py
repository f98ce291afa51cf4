"""Files appear when they are whole, where they were asked for, and nowhere else."""

import os

import pytest

from frischid.core.files import check_writable, write_text, written
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
