"""Tables of measured robots: the six of the README, each on a page of its own, the Go2, and models on other logs."""

from __future__ import annotations

import math

from table_parts import Row, data, each, geometric_mean, rows_of, table, where


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
        for row in rows_of("six_robots")
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
        for row in rows_of("six_robots")
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
        table(("of the logs and the model", ""), facts),
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
    return f"{table(head, rows)}\n{band_in_words()}\n{trust_in_words()}"


def band_in_words(good: float = 0.88) -> str:
    """How often the band of a prediction holds the share that it promises."""
    shares = sorted(row["90 % holds"] for row in data("trust")["rows"])
    few = [f"{100 * x:.1f} %" for x in shares if x < good]
    most = f"{len(shares) - len(few)} of {len(shares)} pairs"
    others = f"{', '.join(few[:-1])} and {few[-1]} on the others"
    return f"The 90 % band holds at least {100 * good:.0f} % of the measurements on {most}, and {others}.\n"


def bands_hold() -> str:
    """Pairs on which the 90 % band holds at least 88 % of the measurements."""
    rows = rows_of("trust")
    return f"{sum(row['90 % holds'] >= 0.88 for row in rows)} of {len(rows)}"


def trust_in_words() -> str:
    """The prior against the better of the two alternatives, over all pairs."""
    rows = rows_of("trust")
    ratios = [row["prior / best"] for row in rows]
    worst = max(rows, key=lambda row: row["prior / best"])
    return (
        f"Over all pairs, the error with the prior is {geometric_mean(ratios):.2f} times that of the better of two "
        "alternatives (geometric mean): least squares,\nand the URDF with fitted friction. The worst pair is "
        f"{max(ratios):.2f} ({worst['robot']}, fitted to `{worst['fitted']}`).\n"
    )


GO2_MODELS = {
    "authors": "the authors' simulator model: damping 0.6, armature 0.01, frictionloss 0.2",
    "commands": "`identify --controller pd`",
    "found": "the same, and the first finding of `diagnose`: friction that depends on the position",
}


def go2() -> str:
    """Simulated positions of the Go2's legs, and the worst joints of the test part."""
    rows = rows_of("commanded_positions")
    first = rows[0]["held rad"]
    head = (
        "model",
        "cross-validated torque error",
        "fitted part, rad",
        "test part, rad",
        "test part, over the authors'",
    )

    def line(row: Row) -> tuple[str, ...]:
        torque = row.get("cross-validated")
        error, ratio = row["held rad"], row["held rad"] / first
        return (
            GO2_MODELS[row["model"]],
            f"{torque:.3f}" if torque else "–",
            *(f"{x:.4f}" for x in (row["fitted rad"], error)),
            f"{ratio:.2f}",
        )

    return f"{each(head, rows, line)}\n{go2_joints()}"


def go2_joints() -> str:
    """The calves, joint by joint."""
    rows = rows_of("commanded_positions")
    calves = [key.split()[1] for key in rows[0] if key.startswith("held ") and "calf" in key]
    lines = [
        (GO2_MODELS[row["model"]], *(f"{row[f'fitted {joint} rad']:.4f}" for joint in calves))
        for row in rows
        if row["model"] != "authors"
    ]
    words = "The calves on the fitted part, rad:\n\n"
    return words + table(("model", *(joint.removesuffix("_joint") for joint in calves)), lines)


def go2_drives() -> str:
    """What the chirp tells of the Go2's drives, and what stays open."""
    rows = rows_of("commanded_positions_drives")
    lines = []
    for quantity in dict.fromkeys(row["quantity"] for row in rows):
        mine = [row for row in rows if row["quantity"] == quantity]
        known = [f"{short(row)} {row['value']:.2g} ({row['lower']:.2g} to {row['upper']:.2g})" for row in mine]
        by = {state: [k for k, row in zip(known, mine, strict=True) if row["known"] == state] for state in STATES}
        count = sum(row["known"] not in STATES for row in mine)
        lines.append(
            (
                f"{quantity}, {DRIVE_UNITS[quantity]}",
                "; ".join(by["identified"]) or "none",
                "; ".join(by["roughly"]) or "none",
                str(len(by["in a sum"])),
                str(count),
            )
        )
    return table(("quantity", "identified", "roughly, with the 95 % range", "in a sum", "open"), lines)


STATES = ("identified", "roughly", "in a sum")
DRIVE_UNITS = {"armature": "kg·m²", "viscous": "N·m·s/rad", "coulomb": "N·m"}


def short(row: Row) -> str:
    """A joint's name without its last word."""
    return str(row["joint"]).removesuffix("_joint").replace("_", " ")
