"""Tables of the README and the site, from the stored results of the benchmark scripts; no figure is typed by hand.

A page holds a pair of marks, ``<!-- table: NAME -->`` and ``<!-- end -->``. What stands between them comes from a file
in ``docs/data``, which a script writes: ``python benchmarks/NAME.py --json docs/data/NAME.json``.

Run ``python docs/tables.py`` after such a script; a test fails where a page and the data differ.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
ROOT = DOCS.parent
MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)

Row = dict[str, Any]


def data(script: str = "six_robots") -> dict[str, Any]:
    """The stored result of a script."""
    return dict(json.loads((DOCS / "data" / f"{script}.json").read_text(encoding="utf-8")))


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


def real_robots() -> str:
    """Errors of three robots on a test log, with default settings."""
    head = ("robot", "cut-off", "base parameters", "NRMSE", "with standstill", "URDF + friction", "constant")
    keys = ("NRMSE", "with standstill", "nominal", "constant")
    return table(
        head,
        [
            (row["robot"], f"{row['cut-off Hz']:.3g} Hz", str(row["rank"]), *(f"{row[key]:.3f}" for key in keys))
            for row in data("real_robots")["rows"]
        ],
    )


def trust() -> str:
    """Models fitted to one log and tested on another, with the URDF as prior and without."""
    head = (
        "robot",
        "fitted",
        "tested on",
        "least squares",
        "URDF + friction",
        "URDF as prior",
        "cross-validated before",
        "90 % band holds",
    )
    rows = [
        (
            row["robot"],
            row["fitted"],
            row["held against"] + (f", {row['cut-off Hz']:.2g} Hz" if row["fitted"] == "5 logs" else ""),
            f"{row['least squares']:.3g}" if math.isfinite(row["least squares"] or math.inf) else "no unique fit",
            *(f"{row[key]:.3f}" for key in ("URDF + friction", "prior", "cross-validated")),
            f"{100 * row['90 % holds']:.0f} %",
        )
        for row in data("trust")["rows"]
    ]
    return f"{table(head, rows)}\n{band_in_words()}"


def band_in_words(good: float = 0.88) -> str:
    """How often the band of a prediction holds the share that it promises."""
    shares = sorted(row["90 % holds"] for row in data("trust")["rows"])
    few = [f"{100 * x:.0f} %" for x in shares if x < good]
    most = f"{len(shares) - len(few)} of {len(shares)} pairs"
    others = f"{', '.join(few[:-1])} and {few[-1]} on the others"
    return f"The 90 % band holds at least {100 * good:.0f} % of the measurements on {most}, and {others}.\n"


def bbrf() -> str:
    """Speed of the bounding-box recursion."""
    head = ("arm", "parameters", "direct port, µs per window", "frischid, µs per window", "ratio")
    keys = ("direct port, µs per window", "frischid, µs per window", "ratio")
    rows = [(row["robot"], str(row["p"]), *(f"{row[key]:.3g}" for key in keys)) for row in data("bbrf")["rows"]]
    return table(head, rows)


def excitation_arms() -> str:
    """Condition numbers of planned motions of whole arms."""
    head = ("robot", "condition number", "over the best random motion", "processor time, s")
    keys = ("condition", "ratio", "CPU s")
    rows = data("excitation_arms")["rows"]
    return table(head, [(row["robot"], *(f"{row[key]:.2g}" for key in keys)) for row in rows])


def excitation() -> str:
    """The paper's cost (19) of motions of the paper's arm."""
    head = ("motion", "cost (19)", "the same with fresh noise", "evaluations")
    rows = [
        (
            row["motion"],
            f"{row['cost']:.2f}",
            f"{row['fresh noise']:.1f}" if row["fresh noise"] else "–",
            f"{row['evaluations']:,}",
        )
        for row in data("excitation")["rows"]
    ]
    return table(head, rows)


def physical_export() -> str:
    """What physically consistent links cost."""
    head = ("robot", "links, base parameters", "all consistent", "χ²", "ratio", "truth in bounds")
    return table(
        head,
        [
            (
                row["robot"],
                f"{row['links']}, {row['p']}",
                "yes" if row["all physical"] else "no",
                f"{row['χ²']:.1f}",
                f"{row['ratio']:.3f}",
                row["truth in bounds"],
            )
            for row in data("physical_export")["rows"]
        ],
    )


def simulated_motion() -> str:
    """Error of the simulated position of the EMPS."""
    head = ("effects", "parameters", "train, mm", "test_pulses, mm")
    words = {"baseline": "viscous, Coulomb, offset", "published": "published (Janot, Gautier and Brunot 2019)"}
    rows = [
        (
            words.get(row["model"], row["model"].replace("_", " ")),
            words.get(row["parameters"], f"`{row['parameters']}`"),
            f"{row['train mm']:.1f}",
            f"{row['test mm']:.1f}",
        )
        for row in data("simulated_motion")["rows"]
    ]
    return table(head, rows)


def hidden_commanded() -> str:
    """Hidden effects of robots that take commands: named or not, and the simulated motion with the finding."""
    rows = data("hidden_commanded")["rows"]
    lines = []
    for kind in dict.fromkeys(row["hidden"] for row in rows):
        mine = [row for row in rows if row["hidden"] == kind]
        ratios = [row["simulated"] for row in mine if row["hit"] and math.isfinite(row["simulated"] or math.nan)]
        fall = f"{100 * (math.exp(sum(map(math.log, ratios)) / len(ratios)) - 1):+.0f} %" if ratios else "not simulated"
        lines.append((f"`{kind}`", str(len(mine)), str(sum(row["hit"] for row in mine)), fall))
    lines.append(("all", str(len(rows)), str(sum(row["hit"] for row in rows)), ""))
    return table(("hidden effect", "cases", "named first", "simulated error with it"), lines)


def exported_code() -> str:
    """Time of a call of the exported C."""
    rows = data("exported_code")["rows"]
    robots = [key for key in rows[0] if key != "model"]
    return table(("ns per call", *robots), [(row["model"], *(f"{row[name]:.0f}" for name in robots)) for row in rows])


def coverage() -> str:
    """How often standard errors hold all true parameters at once."""
    noises = {
        "white": "white, 1 % of the torque",
        "memory of 0.1 s": "torque noise with a memory of 0.1 s",
        "quantised": "quantised encoders, 1.5e-5 rad",
        "jitter": "time stamps off by 0.5 ms",
        "all channels": "noise on all channels",
    }
    head = ("robot", "noise", "runs", "all parameters inside", "width", "least single parameter within 1.96 s.e.")
    rows = [
        (
            row["robot"],
            noises.get(row["noise"], row["noise"]),
            str(row["runs"]),
            f"{100 * row['cover']:.0f} %",
            f"{row['width']:.2f}",
            f"{100 * row['worst']:.0f} %",
        )
        for row in data("coverage")["rows"]
    ]
    return table(head, rows)


def machine(script: str = "six_robots") -> str:
    """Version and machine of a stored result."""
    stored = data(script)
    computer = stored["machine"]
    by = f"`benchmarks/{script.removesuffix('_arms')}.py`"
    return (
        f"*Made by {by} with frischid {stored['frischid']}, Python {computer['python']}, "
        f"{computer['cores']} cores ({computer['processor']}).*\n"
    )


SCRIPTS = {
    "real_robots": real_robots,
    "trust": trust,
    "bbrf": bbrf,
    "excitation_arms": excitation_arms,
    "excitation": excitation,
    "physical_export": physical_export,
    "simulated_motion": simulated_motion,
    "hidden_commanded": hidden_commanded,
    "exported_code": exported_code,
    "coverage": coverage,
}
"""Script -> its table, under which the machine stands."""


def pages() -> Iterator[Path]:
    """The pages that hold a table."""
    yield ROOT / "README.md"
    yield ROOT / "paper" / "paper.md"
    yield from sorted((DOCS / "robots").glob("*.md"))
    yield from sorted((DOCS / "benchmarks").glob("*.md"))
    yield DOCS / "guides" / "export.md"


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
        elif name in SCRIPTS:
            text = f"{SCRIPTS[name]()}\n{machine(name)}"
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
