"""The paper's case study: Tables 2 to 4 beside the published figures, Figures 1 to 4, and no run discarded.

The planar arm of `urdf/planar2.urdf` moves through the authors' points (when FRISCHID_DATA is set; a random Fourier
motion of the same length otherwise), white noise is added, and every method identifies the same noisy logs. What is
done in a run, and where the authors' code differs from their text, is told in `planar_case.py`.

The JSON file holds `rows` (how often each box is empty, bounded, and covers the truth), the same as `tables.bounds`,
`tables.table2`, `tables.table3`, `tables.table4`, and `settings`.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import planar_case
from common import data_folder, parser, pool, publish
from planar_case import CALIBRATED, PAPER, PAPER_WHOLE, WINDOW, Case, Run, arm, batch, case_study
from planar_tables import (
    UNKNOWN,
    Rows,
    Runs,
    bounds_table,
    cost19,
    friction,
    notes_of_table2,
    statements,
    table2,
    table3,
    table4,
)
from rich.console import Console
from rich.progress import Progress

from frischid.core.files import write_text

SIGMAS = (1e-3, 1e-2)
BATCH = 5


def main() -> None:
    """Run the experiment, print the tables, draw the pictures."""
    options = _options()
    folder = data_folder()
    case = case_study(folder, options.seed)
    start = time.perf_counter()
    runs = monte_carlo(case, options)
    seconds = time.perf_counter() - start
    settings = {
        "motion": case.source,
        "runs": options.runs,
        "sigma_q": list(SIGMAS),
        "window": WINDOW,
        "seed": options.seed,
        "workers": options.scheduler or options.workers,
        "seconds": seconds,
        "joints": len(case.q[0]),
        "samples": len(case.t),
    }
    authors = folder is not None
    costs = np.array([cost19(case.points, draw) for draw in range(options.draws)])
    tables = {
        "table2": table2(case, float(costs.mean()), authors=authors),
        "table3": table3(runs),
        "table4": table4(case, runs),
    }
    notes2 = notes_of_table2(case, costs, authors=authors)
    publish("Table 2: the base regressor", tables["table2"], None, notes2)
    notes3 = [
        "mean ± standard deviation; the paper's estimates are not in this repository's material, its true values are",
        f"'{PAPER}': BBRF and selection as in the authors' code (first half of the log); '{PAPER_WHOLE}': windows to "
        f"the end; '{CALIBRATED}': least squares in the calibrated box; off / sd: of '{PAPER}'",
        *(f"{name} = {text}" for name, text in zip(arm().names, arm().expressions, strict=True) if name != text),
        friction(tables["table3"]),
    ]
    publish("Table 3: parameters", tables["table3"], None, notes3)
    notes4 = [
        "error of W θ against the noise-free torque of the noise-free motion, N·m; the paper's figures: " + UNKNOWN
    ]
    publish("Table 4: predicted torque", tables["table4"], None, notes4)
    notes = [
        "percentages of all runs; parameters covered, and widths (medians), of the boxes that are not empty; "
        f"'calibrated' has windows of {len(case.t)} rows",
        *statements(runs),
        f"{case.source}; {len(SIGMAS)} × {options.runs} runs in {seconds:.0f} s, none discarded",
    ]
    title = f"bounds: {options.runs} runs a noise level, window of {WINDOW} rows"
    publish(title, bounds_table(runs), options.json, notes)
    if options.json is not None:
        _add_tables(options.json, tables, settings, notes2 + notes3 + notes4)
    if not options.no_pictures:
        _draw(case, runs, options)


def _options() -> argparse.Namespace:
    arguments = parser(__doc__)
    arguments.add_argument("--runs", type=int, default=250, help="Monte Carlo runs a noise level (250)")
    arguments.add_argument("--workers", type=int, default=2, help="processes (2); 1 stays in this one")
    arguments.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler to run on, tcp://host:8786")
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--draws", type=int, default=100, help="noise draws for cost (19) and Figure 2 (100)")
    arguments.add_argument("--pictures", metavar="FOLDER", type=Path, default=Path("docs/paper"))
    arguments.add_argument("--no-pictures", action="store_true", help="draw nothing")
    options = arguments.parse_args()
    if options.runs < 2 or options.workers < 1 or options.draws < 1:
        arguments.error("--runs must be at least 2 (a spread is wanted), --workers and --draws at least 1")
    return options


def monte_carlo(case: Case, options: argparse.Namespace) -> Runs:
    """Do all runs, in batches, here or in processes or on a cluster; the result does not depend on where."""
    work = [
        (sigma, options.seed, range(first, min(first + BATCH, options.runs)))
        for sigma in SIGMAS
        for first in range(0, options.runs, BATCH)
    ]
    with Progress(console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task("Monte Carlo", total=len(work))
        with pool(options.scheduler, options.workers, planar_case) as there:
            handles = there.map(job, work, case)
            results = there.gather(handles, lambda done, _: progress.update(bar, completed=done))
    return {
        sigma: [run for item, result in zip(work, results, strict=True) if item[0] == sigma for run in result]
        for sigma in SIGMAS
    }


def job(item: tuple[float, int, range], case: Case) -> list[Run]:
    """One batch, in any process."""
    return batch(case, item)


def _add_tables(path: Path, tables: dict[str, Rows], settings: dict[str, Any], notes: Sequence[str]) -> None:
    """Put the other tables into the file that `publish` wrote."""
    document = json.loads(path.read_text(encoding="utf-8"))
    document["tables"] = {**tables, "bounds": document["rows"]}
    document["settings"] = settings
    document["notes"] += notes
    write_text(path, json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n")


def _draw(case: Case, runs: Runs, options: argparse.Namespace) -> None:
    try:
        from planar_pictures import draw
    except ImportError as error:
        sys.exit(f"pictures need matplotlib ({error}): pip install matplotlib, or --no-pictures")
    for path in draw(case, runs, options.pictures, options.draws):
        print(path)


if __name__ == "__main__":
    main()
