"""Tables and figures of the README, the paper and the site, from the stored results of the benchmark scripts.

No figure of a table is typed by hand. A page holds a pair of marks, and what stands between them comes from a file in
``docs/data``, which a script writes: ``python benchmarks/NAME.py --json docs/data/NAME.json``. A table has the marks
``<!-- table: NAME -->`` and ``<!-- end -->`` on lines of their own, with the version and the machine below it. A figure
within a sentence has ``<!-- figure: NAME -->`` and ``<!-- end -->`` around it.

Run ``python docs/tables.py`` after such a script; a test fails where a page and the data differ.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import figures_of_motion as motion
import tables_of_accuracy as accuracy
import tables_of_cost as cost
import tables_of_diagnosis as diagnosis
import tables_of_logs as logs
import tables_of_robots as robots
from table_parts import DOCS, ROOT, machine, rows_of

TABLE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
FIGURE = re.compile(r"(<!-- figure: (\w+) -->)(.*?)(<!-- end -->)", re.DOTALL)


@dataclass(frozen=True)
class Table:
    """What fills a mark.

    Attributes
    ----------
    text : callable
        Makes the table.
    result : str
        Stored result, whose version and machine stand below the table.
    script : str
        Script that made the result.
    """

    text: Callable[[], str]
    result: str
    script: str


def table_of(text: Callable[[], str], result: str = "", script: str = "") -> tuple[str, Table]:
    """The name of a function, and its table; by default the stored result and the script have the same name."""
    name = text.__name__
    result = result or name
    return name, Table(text, result, script or result)


TABLES = dict(
    (
        table_of(robots.real_robots),
        table_of(robots.trust),
        table_of(robots.go2, "commanded_positions"),
        table_of(robots.go2_drives, "commanded_positions_drives", "commanded_positions"),
        table_of(logs.torque_lag),
        table_of(logs.torque_lag_taken, "torque_lag"),
        table_of(logs.gains_from_masses),
        table_of(accuracy.coverage),
        table_of(accuracy.estimators),
        table_of(accuracy.bbrf),
        table_of(accuracy.excitation_arms, script="excitation"),
        table_of(accuracy.excitation),
        table_of(accuracy.physical_export),
        table_of(accuracy.simulated_motion),
        table_of(accuracy.commanded_mujoco),
        table_of(accuracy.commanded_unknown, script="commanded_mujoco"),
        table_of(accuracy.commanded_free),
        table_of(accuracy.commanded_peers),
        table_of(accuracy.drive_excitation),
        table_of(accuracy.paper_again),
        table_of(accuracy.paper_claims, "paper_again"),
        table_of(diagnosis.hidden_commanded),
        table_of(diagnosis.planted_effects),
        table_of(diagnosis.any_robot),
        table_of(diagnosis.carried_loads),
        table_of(diagnosis.planted_log_faults),
        table_of(diagnosis.planted_measured_faults, script="planted_log_faults"),
        table_of(diagnosis.calibration),
        table_of(diagnosis.found_by_background, "calibration"),
        table_of(diagnosis.healthy, "calibration"),
        table_of(cost.exported_code),
        table_of(cost.studio_page),
        table_of(cost.against_figaroh),
        table_of(cost.against_mujoco),
        table_of(cost.startup),
        table_of(cost.regressor),
        table_of(cost.previous_release),
        table_of(cost.scaling),
        table_of(cost.scaling_diagnose, script="scaling"),
        table_of(cost.fleet),
    )
)
"""Name of a mark -> its table."""
FIGURES: dict[str, Callable[[], str]] = {
    each.__name__: each
    for each in (
        accuracy.sensorwise_cover,
        accuracy.sensorwise_width,
        accuracy.box_width,
        accuracy.estimator_runs,
        accuracy.eiv_error,
        accuracy.eiv_error_least,
        accuracy.paper_psi,
        accuracy.paper_peaks,
        accuracy.paper_excess,
        logs.lag_raises_error,
        logs.gains_doubt,
        logs.clock_ur10e,
        logs.clock_tiago,
        logs.velocity_lag,
        logs.zero_torques,
        logs.missing_hand,
        logs.payload_by_check,
        logs.payload_by_diagnose,
        logs.payload_mass,
        logs.payload_found,
        logs.payload_by_gains,
        logs.gain_ratios,
        logs.set_points_within,
        diagnosis.chance_error,
        diagnosis.chance_errors,
        diagnosis.beside_right,
        diagnosis.beside_right_alone,
        robots.bands_hold,
        cost.moments_us,
        cost.small_fleets_count,
        cost.small_fleets_loads,
        cost.small_fleets_frictions,
        cost.small_fleets_others,
        cost.figaroh_ratio,
        cost.mujoco_ratio,
        cost.loops_for_25,
        cost.regressor_over_loop,
        motion.far_so101,
        motion.identified_so101,
        motion.identified_panda,
        motion.identified_go2,
        motion.identified_right,
        motion.alone_in_a_sum,
        motion.chirps_narrow,
        motion.emps_drift_train,
        motion.emps_drift_test,
        motion.emps_train,
        motion.emps_test,
        motion.emps_recorded_train,
        motion.emps_recorded_test,
        motion.emps_chosen_test,
        motion.emps_chosen_half,
        motion.emps_own_train,
        motion.emps_own_test,
        motion.emps_more_force,
        motion.emps_lag,
        motion.emps_as_recorded,
        motion.calf_without,
        motion.calf_with,
        motion.calves_named,
    )
}
"""Name of a mark within a sentence -> its figure."""


def pages() -> Iterator[Path]:
    """Every page that holds a mark."""
    found = [ROOT / "README.md", ROOT / "paper" / "paper.md", *sorted(DOCS.rglob("*.md"))]
    yield from (page for page in found if re.search("<!-- (?:table|figure): ", page.read_text(encoding="utf-8")))


def between(name: str, prefix: str) -> str:
    """What stands between the marks of a table; `prefix` leads to the robots' pages."""
    if name == "six_robots":
        return robots.six_robots(prefix)
    if name == "six_robots_paper":
        return robots.six_robots_paper()
    if name == "machine":
        return machine("six_robots")
    if name in TABLES:
        made = TABLES[name]
        if not (DOCS / "data" / f"{made.result}.json").exists():
            return f"*Not measured with this version: `benchmarks/{made.script}.py --json` writes the figures.*\n"
        return f"{made.text()}\n{machine(made.result, made.script)}"
    return robots.robot_page(next(row for row in rows_of("six_robots") if row["key"] == name))


def filled(page: Path) -> str:
    """Text of a page with its tables and figures as the data have them."""
    prefix = "docs/robots/" if page.parent == ROOT else ""
    text = TABLE.sub(lambda m: f"{m[1]}\n{between(m[2], prefix)}\n{m[3]}", page.read_text(encoding="utf-8"))
    return FIGURE.sub(lambda m: f"{m[1]}{FIGURES[m[2]]()}{m[4]}", text)


def main() -> None:
    """Fill every page."""
    for page in pages():
        text = filled(page)
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
