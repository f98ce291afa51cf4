"""Tables of accuracy: standard errors, estimators, the paper, planned motions, physical links, simulated motion."""

from __future__ import annotations

import math
import re

from table_parts import Row, data, each, percent, rows_of, table


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
    head = ("effects", "parameters", "train, mm", "other half of train, mm", "test_pulses, mm")
    words = {"baseline": "viscous, Coulomb, offset", "published": "published (Janot, Gautier and Brunot 2019)"}
    words["baseline, torque as recorded"] = "viscous, Coulomb, offset; torque as recorded"
    words["linear"] = "least squares"
    words["output_error"] = "`output_error`, the whole log at once"
    words["output_error in stretches"] = "`output_error`, stretches of 1 s"
    words["output_error on test_pulses"] = "`output_error`, fitted to `test_pulses`: no score"
    rows = [
        (
            words.get(row["model"], row["model"].replace("_", " ")),
            words.get(row["parameters"], f"`{row['parameters']}`"),
            f"{row['train mm']:.1f}",
            f"{row['other half mm']:.1f}" if "other half mm" in row else "",
            f"**{row['test mm']:.1f}, chosen**" if row.get("chosen") else f"{row['test mm']:.1f}",
        )
        for row in data("simulated_motion")["rows"]
    ]
    return table(head, rows)


METHODS = {
    "ols": "least squares ± Bonferroni t · s.e.",
    "frisch box": "classical Frisch box",
    "bbrf calibrated": "BBRF, calibrated (`--bbrf calibrated`)",
    "sensor-wise": "**sensor-wise Frisch** (`--estimator sensorwise`)",
    "eiv, estimated": "errors in variables ± Bonferroni t · s.e. (`--estimator eiv`)",
}
"""Method of `benchmarks/estimators.py` -> its name on the pages."""


def method(name: str) -> list[Row]:
    """Rows of a method on the planar arm, by rising noise."""
    rows = [row for row in rows_of("estimators") if row["robot"] == "planar2" and row["method"] == name]
    return sorted(rows, key=lambda row: float(row["σ_q"]))


def estimators() -> str:
    """Cover and width of bounds, and the error of the estimate, on the paper's arm."""
    levels = [f"{row['σ_q']:.0e}".replace("e-0", "e-") for row in method("ols")]

    def line(name: str) -> tuple[str, ...]:
        rows = method(name)
        cover = ", ".join(f"{row['cover %']:.0f} %" for row in rows)
        width = ", ".join(f"{row['width']:{'.0f' if row['width'] > 10 else '.2g'}}".replace("inf", "–") for row in rows)
        error = ", ".join(f"{row['error']:.2f}" if math.isfinite(row["error"]) else "–" for row in rows)
        return METHODS[name], cover, width, error

    head = ("bounds", f"cover at σ_q = {', '.join(levels)}", "width", "error over least squares'")
    words = f"{method('ols')[0]['runs']} runs per noise level, none discarded.\n"
    return f"{table(head, [line(name) for name in METHODS if method(name)])}\n{words}"


def sensorwise_cover() -> str:
    """Share of runs in which the sensor-wise bounds hold, at the least noise."""
    return f"{method('sensor-wise')[0]['cover %']:.3g} %"


def sensorwise_width() -> str:
    """Their width for friction, over the true values."""
    return f"{method('sensor-wise')[0]['width']:.2f}"


def box_width() -> str:
    """The width of the classical box."""
    return f"{method('frisch box')[0]['width']:.0f}"


def estimator_runs() -> str:
    """Runs per noise level."""
    return str(method("ols")[0]["runs"])


def eiv_error() -> str:
    """Error of `eiv` over that of least squares at the most noise."""
    return f"{method('eiv, estimated')[-1]['error']:.2f}"


def eiv_error_least() -> str:
    """The same at the least noise."""
    return f"{method('eiv, estimated')[0]['error']:.2f}"


def commanded_mujoco() -> str:
    """Drives from logs of positions and commands."""
    head = ("robot", "seeds", "values", "called identified or roughly known", "median error",
            "90 % of the errors below", "within 5 %", "inside")  # fmt: skip

    def line(row: Row) -> tuple[str, ...]:
        first = row["first seed"]
        shares = (percent(row[key]) for key in ("within 5 %", "inside, identified"))
        errors = (f"{100 * row[key]:.1f} %" for key in ("median error", "90 % error"))
        seeds = f"{first} to {first + row['runs'] - 1}" if row["runs"] > 1 else str(first)
        return DRIVES[row["robot"]], seeds, str(row["values"]), percent(row["identified"]), *errors, *shares

    return each(head, rows_of("commanded_mujoco"), line)


def commanded_unknown() -> str:
    """Gains and delay that nobody named."""
    head = ("robot", "quantity", "values", "found", "median error", "largest error", "standard error", "inside 95 %")

    def line(row: Row) -> tuple[str, ...]:
        delay = row["value"] == "delay"
        sizes = [row[key] for key in ("median error", "worst", "median standard error")]
        shown = [f"{1e3 * x:.1f} ms" if delay else percent(x) for x in sizes]
        counts = str(row["values"]), str(row["found"])
        robot = DRIVES[row["robot"]].partition(",")[0]
        return robot, row["value"], *counts, *shown, percent(row["inside 95 %"])

    return each(head, rows_of("commanded_unknown"), line)


def commanded_free() -> str:
    """Values moved to the ends of their ranges, and how far the simulated motion moves."""
    head = ("robot", "called", "moves", "by, median", "motion, others fitted again", "the same on another motion",
            "motion, others kept", "encoder noise", "moves below it")  # fmt: skip

    def line(row: Row) -> tuple[str, ...]:
        again, kept = row["most moved mrad"], row["most alone mrad"]
        sizes = (f"{x:.2g}" for x in (again, row["most moved elsewhere mrad"], kept, row["noise mrad"]))
        below = f"{round(row['below noise'] * row['moves'])} of {row['moves']}"
        robot = DRIVES[row["robot"]].partition(",")[0]
        return robot, row["known"], str(row["moves"]), percent(row["by"]), *sizes, below

    return each(head, rows_of("commanded_free"), line)


def commanded_peers() -> str:
    """Drives from commands by frischid and by other tools."""
    head = ("robot", "program", "processor time, s", "over frischid", "median error", "largest error",
            "truth inside 95 % range", "simulated error, mrad", "with fine steps, mrad")  # fmt: skip

    def line(row: Row) -> tuple[str, ...]:
        errors = [
            f"{x:.2g} %" if (x := row[key]) < 99.5 else f"{x:.0f} %" for key in ("median error %", "largest error %")
        ]
        share = row["inside 95 % range %"]
        inside = "no range" if share is None else f"{share:.0f} %"
        moved = (f"{row[key]:.2g}" for key in ("simulated error mrad", "with fine steps mrad"))
        times = (
            ("", "")
            if not row["seconds"]
            else (f"{row['seconds']:.{'0f' if row['seconds'] > 99 else '2g'}}", f"{row['× frischid']:.3g}")
        )
        return DRIVES[row["robot"]].partition(",")[0], row["tool"], *times, *errors, inside, *moved

    return each(head, rows_of("commanded_peers"), line)


def drive_excitation() -> str:
    """Ranges of the drives' values after planned commands and after other motions of the same length."""
    names = {
        "random": "25 random harmonics",
        "plain": "`excite`",
        **{x: f"`excite --drives --family {x}`" for x in ("fourier", "steps", "chirps", "steps+chirps")},
    }
    late = ", delay in doubt"
    keys = ("armature", "viscous", "coulomb", f"delay{late}", f"armature{late}", f"viscous{late}", f"coulomb{late}")
    head = ("robot", "motion", *keys, "truth inside")

    def line(row: Row) -> tuple[str, ...]:
        widths = (f"{x:.2g} %" if (x := row[f"{key} %"]) < 99.5 else f"{x:.0f} %" for key in keys)
        robot = DRIVES[row["robot"]].partition(",")[0]
        return robot, names[row["motion"]], *widths, f"{row['inside']} of {row['ranges']}"

    return each(head, rows_of("drive_excitation"), line)


DRIVES = {
    "so101": "SO-101, 4096 counts per turn",
    "go2": "a Go2's leg, 32768 counts",
    "panda": "Panda, 524288 counts",
}


def numbers_of(title: str) -> Row:
    """Figures of a table of the paper, computed again."""
    return dict(next(row["numbers"] for row in rows_of("paper_again") if row["table"] == title))


def paper_again() -> str:
    """The paper's printed figures beside ours."""
    design = numbers_of("Table 2")
    lines = [
        (f"Table 2, {name}", *(figure(design[kind].get(name)) for kind in ("printed", "as published", "as corrected")))
        for name in design["printed"]
    ]
    fresh = (figure(design[kind]["fresh mean"]) for kind in ("as published", "as corrected"))
    lines.append(("Table 2, cost (19), mean over fresh noise", "–", *fresh))
    for title in ("Table 3", "Table 4"):
        distances = numbers_of(title)["distances"]
        words = f"each within {max(distances):.1f} standard errors"
        lines.append((f"{title}, {2 * len(distances)} means", "", words, "another arm"))
    return (
        f"{table(('result', 'printed', 'as published', 'as corrected'), lines)}\n{data('paper_again')['notes'][0]}.\n"
    )


def paper_psi() -> str:
    """The part ψ of the paper's printed cost (19) that is not λ1 cond + λ2 / σ_min, with λ1 = λ2 = 1."""
    printed = numbers_of("Table 2")["printed"]
    return f"{printed['cost (19)'] - printed['condition number'] - 1 / printed['σ_min']:.4f}"


def paper_peaks() -> str:
    """Largest position, speed and acceleration of the motion through the authors' points, and their limits."""
    q, v, a = paper_motion()
    return f"|q| {q} rad of 3, |q̇| {v} rad/s of 5, |q̈| {a} rad/s² of 10"


def paper_excess() -> str:
    """How far the motion exceeds the limits of its points, at most."""
    return f"{max(float(x) / limit for x, limit in zip(paper_motion(), (3, 5, 10), strict=True)):.0f}"


def paper_motion() -> list[str]:
    """The peaks that the benchmark's note on Figure 2 says."""
    return re.findall(r"up to ([\d.]+)", data("paper_again")["notes"][1])


def figure(value: float | None) -> str:
    """Four decimals, or that there is no figure."""
    return "–" if value is None else f"{value:.4f}"


def paper_claims() -> str:
    """Each claim of the paper, what was found, and whether the claim holds."""
    head = ("equation", "claim", "found", "holds")
    return each(
        head, numbers_of("Equations")["rows"], lambda row: (row["equation"], row["says"], row["found"], row["holds"])
    )
