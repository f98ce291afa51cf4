"""A joint-state stream of any size read in bounded memory: python benchmarks/long_bag.py [GiB]  (1 by default).

The script writes an MCAP file of a 7-joint arm at 1 kHz, without compression, so that the file has the size of the
stream. It reads the file in chunks and sums the moments of positions and torques. It prints the file's size, the time,
and the rise of the process's resident memory while reading.
"""

import itertools
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from bag_files import mcap_ros2
from common import parser, publish

from frischid.logs.log import Log
from frischid.logs.readers import read_chunks

JOINTS = tuple(f"panda_joint{k}" for k in range(1, 8))
PIECE = 20_000


def piece(number: int) -> Log:
    rng = np.random.default_rng(number)
    t = (number * PIECE + np.arange(PIECE)) * 1e-3
    q, v, tau = rng.normal(size=(3, PIECE, 7))
    return Log(t, JOINTS, q, v=v, tau=tau)


def peak() -> float:
    """Largest resident memory so far, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Write, read, print."""
    options = parser(__doc__)
    options.add_argument("gib", type=float, nargs="?", default=1.0, help="size of the stream, GiB")
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.mcap"
        mcap_ros2(None, path, pieces=[piece(0)], compressed=False)
        pieces = max(2, round(given.gib * 2**30 / path.stat().st_size))
        mcap_ros2(None, path, pieces=(piece(k) for k in range(pieces)), compressed=False)
        for _ in itertools.islice(read_chunks(path, JOINTS), 2):
            pass  # the memory that the libraries need at the start does not count
        before, start = peak(), time.perf_counter()
        rows, moments = 0, np.zeros((14, 14))
        for log in read_chunks(path, JOINTS):
            z = np.hstack([log.q, log.tau])
            rows, moments = rows + len(log), moments + z.T @ z
        seconds = time.perf_counter() - start
        assert rows == pieces * PIECE
        row = {
            "GiB": path.stat().st_size / 2**30,
            "messages": rows,
            "seconds": seconds,
            "µs per message": 1e6 * seconds / rows,
            "memory before, MiB": before,
            "rise, MiB": peak() - before,
            "moments off by": float(np.abs(moments / rows - np.eye(14)).max()),
        }
    publish("a long bag read in chunks", [row], given.json)


if __name__ == "__main__":
    main()
