"""Every figure of the page on the paper, from one run of `frischid.reproduce_paper`. Needs FRISCHID_DATA.

The authors' points are read from ``frisch_planar/exciting_points.csv``. The JSON file has one row per table of the
paper: its figures in full precision, as `frischid paper` writes them too.
"""

from __future__ import annotations

import sys
from typing import Any

from common import data_folder, parser, publish, record

import frischid as fr


def main() -> None:
    """Print the claims of the paper and what was found, and write all tables."""
    options = parser(__doc__)
    options.add_argument("--runs", type=int, default=250, help="Monte Carlo runs of each study; the paper has 250")
    given = options.parse_args()
    folder = data_folder()
    points = None if folder is None else folder / "frisch_planar" / "exciting_points.csv"
    if points is None or not points.exists():
        sys.exit("FRISCHID_DATA must name a folder with frisch_planar/exciting_points.csv")
    found = fr.reproduce_paper(points, runs=given.runs, search=False)
    claims: list[dict[str, Any]] = found.table("Equations").numbers["rows"]
    notes = [f"{given.runs} runs of each study, along the authors' points"]
    notes += [drawing.reading for drawing in found.drawings if drawing.title.startswith("Figure 2")]
    publish("The paper, computed again", claims, None, notes)
    if given.json is not None:
        rows = [{"table": table.title.partition(":")[0], "numbers": dict(table.numbers)} for table in found.tables]
        record("The paper, computed again", rows, given.json, notes)


if __name__ == "__main__":
    main()
