"""Tables of the README and the site, from the stored results of the benchmark scripts; no figure is typed by hand.

A page holds a pair of marks, ``<!-- table: NAME -->`` and ``<!-- end -->``. What stands between them comes from
``docs/data/six_robots.json``, which ``python benchmarks/six_robots.py --json docs/data/six_robots.json`` writes.

Run ``python docs/tables.py`` after that script; a test fails where a page and the data differ.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
ROOT = DOCS.parent
MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

Row = dict[str, Any]


def data() -> dict[str, Any]:
    """The stored result of the script."""
    return dict(json.loads((DOCS / "data" / "six_robots.json").read_text(encoding="utf-8")))


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def where(joints: Sequence[str]) -> str:
    """Joints in a few letters, in brackets; nothing for the whole robot."""
    names = [re.sub(r"^panda_|_joint$", "", joint).replace("_", " ") for joint in joints]
    return f" ({', '.join(names)})" if names else ""


def found(row: Row) -> str:
    """The effects that were added, in order."""
    return "; ".join(step["title"] + where(step["joints"]) for step in row["steps"]) or "nothing passes"


def source(row: Row) -> str:
    """Address of the data, as a link."""
    links = [f"[{part.split('/')[-1]}](https://{part})" for part in row["source"].split("; ")]
    return ", ".join(links)


def six_robots(prefix: str) -> str:
    """The table of the README and of the robots' page; `prefix` leads to the robots' pages."""
    head = ("robot, torque from", "URDF + friction", "identified", "with added effects", "added effects", "data")
    rows = [
        (
            f"[{row['robot']}]({prefix}{row['key']}.md), {row['sensor']}",
            f"{row['urdf_with_friction']:.3f}",
            f"{row['identified']:.3f}",
            f"**{row['improved']:.3f}**",
            found(row),
            source(row),
        )
        for row in data()["rows"]
    ]
    return table(head, rows)


def six_robots_paper() -> str:
    """The table of the paper: figures alone."""
    head = ("robot", "torque from", "URDF + friction", "identified", "with effects", "first effect found")
    keys = ("urdf_with_friction", "identified", "improved")
    rows = [
        (
            row["robot"],
            row["sensor"],
            *(f"{row[key]:.3f}" for key in keys),
            (row["steps"] or [{"title": "–"}])[0]["title"],
        )
        for row in data()["rows"]
    ]
    return table(head, rows)


def robot_page(row: Row) -> str:
    """Figures of one robot: errors, steps, joints."""
    joints = ", ".join(row["torque_joints"]) or "all"
    facts = [
        ("data", f"{source(row)}, licence: {row['licence']}"),
        ("torque from", row["sensor"]),
        ("fitted", f"{', '.join(row['logs']['fitted'])}: {row['fitted_seconds']:.0f} s"),
        ("test log", f"{', '.join(row['logs']['test'])}: {row['test_seconds']:.0f} s"),
        ("joints whose torque is used", joints),
        ("cut-off", f"{row['cutoff_hz']:.3g} Hz"),
        ("base parameters", str(row["base_parameters"])),
        ("alarms", ", ".join(f"`{name}`" for name in row["alarms"]) or "none"),
        ("verdict after the last step", row["verdict_after"]),
    ]
    errors = [
        ("constant torque", row["constant"]),
        ("URDF's links with fitted friction", row["urdf_with_friction"]),
        ("identified", row["identified"]),
        ("identified, samples at standstill too", row["identified_with_standstill"]),
        ("with the effects that `improve` adds", row["improved"]),
        ("sensors alone (noise floor)", row["noise_floor"]),
    ]
    steps = [
        (step["title"] + where(step["joints"]), f"{step['test_before']:.3f}", f"{step['test_after']:.3f}")
        for step in row["steps"]
    ]
    each = [
        (name, f"{j['rmse']:.3g}", f"{j['identified']:.3f}", f"{j['improved']:.3f}", f"{j['noise_floor']:.3f}")
        for name, j in row["joints"].items()
    ]
    parts = [
        table(("", ""), facts),
        "**Error on the test log** (NRMSE, mean over the joints):\n",
        table(("model", "NRMSE"), [(name, f"{x:.4f}") for name, x in errors]),
        "**Effects added, in order.** The test log decides nothing, so a step may also raise its error:\n",
        table(("effect", "before", "after"), steps) if steps else "None passes.\n",
        "**Joint by joint** (RMSE in N·m or N):\n",
        table(("joint", "RMSE identified", "NRMSE identified", "NRMSE improved", "noise floor"), each),
    ]
    return "\n".join(parts)


def machine() -> str:
    """Version and machine of the stored result."""
    stored = data()
    computer = stored["machine"]
    return (
        f"*Made by `benchmarks/six_robots.py` with frischid {stored['frischid']}, Python {computer['python']}, "
        f"{computer['cores']} cores ({computer['processor']}).*\n"
    )


def pages() -> Iterator[Path]:
    """The pages that hold a table."""
    yield ROOT / "README.md"
    yield ROOT / "paper" / "paper.md"
    yield from sorted((DOCS / "robots").glob("*.md"))


def filled(page: Path) -> str:
    """Text of a page with its tables as the data have them."""
    rows = {row["key"]: row for row in data()["rows"]}
    prefix = "docs/robots/" if page.parent == ROOT else ""

    def between(match: re.Match[str]) -> str:
        name = match[2]
        if name == "six_robots":
            text = six_robots(prefix)
        elif name == "six_robots_paper":
            text = six_robots_paper()
        elif name == "machine":
            text = machine()
        else:
            text = robot_page(rows[name])
        return f"{match[1]}\n{text}\n{match[3]}"

    return MARKED.sub(between, page.read_text(encoding="utf-8"))


def main() -> None:
    """Fill every page."""
    for page in pages():
        text = filled(page)
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
