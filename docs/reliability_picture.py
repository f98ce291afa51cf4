"""Draw docs/benchmarks/reliability.svg: stated probability against the share of right answers.

The answers come from docs/data/calibration.json, which `benchmarks/calibration.py --report` writes. A mark stands for
the answers with a probability in one range. Its bar is the 90 % interval of Wilson 1927 (J. Am. Stat. Assoc. 22) for
the share of right answers, and the number is that of the cases. On the diagonal, answers are as sure as they are right.

Run `python docs/reliability_picture.py` after the benchmark; a test compares the file with the data.
"""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

DATA = Path(__file__).with_name("data")
TARGET = Path(__file__).with_name("benchmarks") / "reliability.svg"
EDGES = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0)
"""Limits of the ranges of probability."""
REACH = 1.645
"""Standard errors on either side of a share that hold 90 % of a normal distribution."""
SIZE, LEFT, TOP, BOTTOM, WIDTH, NEAR = 300, 64, 14, 48, 520, 12
STYLE = (
    "text{font-family:sans-serif;font-size:12px;fill:#1d2733}.frame{fill:none;stroke:#8895a7}"
    ".even{stroke:#8895a7;stroke-dasharray:4 4}.bar{stroke:#4a6fa5}.mark{fill:#4a6fa5}"
    ".middle{text-anchor:middle}.end{text-anchor:end}"
)


def interval(right: int, cases: int) -> tuple[float, float]:
    """Wilson's 90 % interval of a share."""
    share, extra = right / cases, REACH**2 / cases
    middle = (share + extra / 2) / (1 + extra)
    half = REACH * math.sqrt(share * (1 - share) / cases + extra / cases / 4) / (1 + extra)
    return middle - half, middle + half


def points() -> list[tuple[float, int, int]]:
    """Mean stated probability, right answers and cases of each range that has any."""
    rows = json.loads((DATA / "calibration.json").read_text(encoding="utf-8"))["rows"]
    found = []
    for low, high in itertools.pairwise(EDGES):
        here = [r for r in rows if low <= r["probability"] < high or r["probability"] == high == 1.0]
        if here:
            mean = sum(r["probability"] for r in here) / len(here)
            found.append((mean, sum(r["correct"] for r in here), len(here)))
    return found


def picture() -> str:
    """The picture as SVG."""

    def x(p: float) -> float:
        return round(LEFT + SIZE * p, 1)

    def y(p: float) -> float:
        return round(TOP + SIZE * (1 - p), 1)

    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {LEFT + SIZE + 32} {TOP + SIZE + BOTTOM}" '
        f'width="{WIDTH}" role="img">',
        "<title>Stated probability against the share of right answers</title>",
        f"<style>{STYLE}</style>",
        '<rect width="100%" height="100%" fill="#fff"/>',
        f'<rect class="frame" x="{x(0)}" y="{y(1)}" width="{SIZE}" height="{SIZE}"/>',
        f'<line class="even" x1="{x(0)}" y1="{y(0)}" x2="{x(1)}" y2="{y(1)}"/>',
    ]
    for tick in (0.0, 0.25, 0.5, 0.75, 1.0):
        lines.append(f'<text class="middle" x="{x(tick)}" y="{y(0) + 17}">{tick:g}</text>')
        lines.append(f'<text class="end" x="{x(0) - 6}" y="{y(tick) + 4}">{tick:g}</text>')
    lines.append(f'<text class="middle" x="{x(0.5)}" y="{y(0) + 38}">stated probability</text>')
    middle = f"{x(0) - 44} {y(0.5)}"
    lines.append(f'<text class="middle" transform="translate({middle}) rotate(-90)">share of right answers</text>')
    for row, words in enumerate(("number: cases", "bar: 90 % interval")):
        lines.append(f'<text class="end" x="{x(1) - 8}" y="{y(0) - 24 + 16 * row}">{words}</text>')
    for said, right, cases in points():
        low, high = interval(right, cases)
        lines.append(f'<line class="bar" x1="{x(said)}" y1="{y(low)}" x2="{x(said)}" y2="{y(high)}"/>')
        lines.append(f'<circle class="mark" cx="{x(said)}" cy="{y(right / cases)}" r="4"/>')
        if x(1) - x(said) < NEAR:  # beside the frame, where no other bar is
            lines.append(f'<text x="{x(1) + 4}" y="{y(right / cases) + 4}">{cases}</text>')
        else:
            lines.append(f'<text class="middle" x="{x(said)}" y="{round(y(low) + 13, 1)}">{cases}</text>')
    return "\n".join([*lines, "</svg>"]) + "\n"


if __name__ == "__main__":
    TARGET.write_text(picture(), encoding="utf-8")
    print(TARGET)
