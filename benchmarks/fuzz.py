"""Random inputs of every surface, by the thousand: how they end, and every input that ends in a foreign error.

Surfaces: logs (CSV, Parquet, NPZ, bags, MCAP), URDFs, mapping files, controllers, model files, formulas,
command lines. An input
must be used, or be refused in an error of frischid's own, within ten seconds. What fails is printed and, with `--keep`,
written to a folder; mended, it becomes a file of `tests/fuzz_found`.

    python benchmarks/fuzz.py                                   2,000 inputs of each surface
    python benchmarks/fuzz.py --examples 50000 --only model     the long run of one surface
"""

from __future__ import annotations

import os
import resource
import sys
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from common import parser, publish
from mutated_models import LONGEST, TooLongError, limited

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from fuzzing import SURFACES
from hypothesis import HealthCheck, Phase, given, seed, settings

import frischid as fr

BATCH = 200  # inputs between two looks at the clock


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--examples", type=int, default=2000, help="inputs of each surface")
    options.add_argument("--seconds", type=float, default=3600.0, help="longest time of a surface")
    options.add_argument("--only", help="surfaces, comma separated")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--keep", type=Path, help="folder for the inputs that failed")
    given_options = options.parse_args()
    warnings.simplefilter("ignore")
    names = given_options.only.split(",") if given_options.only else list(SURFACES)
    rows, notes = [], []
    keep = None if given_options.keep is None else given_options.keep.resolve()
    for name in names:
        row, failures = run(name, given_options.examples, given_options.seed, given_options.seconds)
        rows.append(row)
        notes += [f"{name}: {kind}: {value!r:.300}" for kind, value in failures.items()]
        for number, value in enumerate(failures.values() if keep else ()):
            keep.mkdir(parents=True, exist_ok=True)
            (keep / f"{name}-{number}").write_bytes(stored(value))
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    notes.append(f"{sum(row['inputs'] for row in rows)} inputs; most memory {memory} MiB")
    publish("random inputs", rows, given_options.json, notes)
    if any(row["other errors"] for row in rows):
        sys.exit("an input ended in another error than frischid's")


def run(name: str, examples: int, start: int, seconds: float) -> tuple[dict[str, Any], dict[str, Any]]:
    """Try many inputs of one surface, `BATCH` by `BATCH` until they are enough or the time is over."""
    surface, counts, failures = SURFACES[name], Counter[str](), dict[str, Any]()
    longest = 0.0
    with TemporaryDirectory() as folder:
        os.chdir(folder)

        def attempt(value: Any) -> None:
            nonlocal longest
            begin = time.perf_counter()
            try:
                with limited(LONGEST):
                    surface.attempt(Path(folder), value)
                counts["used"] += 1
            except fr.FrischidError:
                counts["refused"] += 1
            except TooLongError as error:
                counts["other errors"] += 1
                failures.setdefault(str(error), value)
            except Exception as error:  # whatever is not frischid's own error is what this script looks for
                counts["other errors"] += 1
                place = traceback.extract_tb(error.__traceback__)[-1]
                kind = f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}: {str(error)[:80]}"
                failures.setdefault(kind, value)
            longest = max(longest, time.perf_counter() - begin)

        checks, end = list(HealthCheck), time.monotonic() + seconds
        chosen = settings(
            max_examples=min(BATCH, examples), database=None, deadline=None, phases=(Phase.generate,),
            suppress_health_check=checks,
        )  # fmt: skip
        batch = 0
        while counts.total() < examples and time.monotonic() < end:
            seed(f"{start} {batch}")(chosen(given(surface.inputs)(attempt)))()
            batch += 1
        os.chdir("/")
    row = {"surface": name, "inputs": counts.total()}
    row |= {kind: counts[kind] for kind in ("used", "refused", "other errors")}
    return row | {"longest [s]": longest}, failures


def stored(value: Any) -> bytes:
    """An input as the content of a file."""
    if isinstance(value, tuple):
        return stored(value[-1])
    if isinstance(value, list):
        return "\n".join(value).encode("utf-8", errors="surrogateescape")
    return value if isinstance(value, bytes) else str(value).encode("utf-8", errors="surrogateescape")


if __name__ == "__main__":
    main()
