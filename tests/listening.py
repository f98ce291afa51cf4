"""The addresses on which this process and its children listen, as `ss` sees them."""

import re
import shutil
import subprocess

import psutil
import pytest

needs_ss = pytest.mark.skipif(shutil.which("ss") is None, reason="no ss on this machine: apt-get install iproute2")


def listening():
    """Local addresses without their ports, one per socket."""
    own = {process.pid for process in (psutil.Process(), *psutil.Process().children(recursive=True))}
    lines = subprocess.run(["ss", "-Hltnp"], capture_output=True, text=True, check=True).stdout.splitlines()
    mine = (line for line in lines if own & {int(pid) for pid in re.findall(r"pid=(\d+)", line)})
    return [line.split()[3].rpartition(":")[0] for line in mine]
