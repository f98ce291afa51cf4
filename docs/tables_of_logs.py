"""Tables of logs: the lag of the torque, and currents without gains."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from table_parts import Row, each, middle, rows_of, table

LAG, ERROR, RATIO = "lag, ms", "standard error, ms", "error over that without the lag"
SAID = {"behind": "the torque is behind the motion", "ahead": "the torque is ahead of the motion"}


def torque_lag() -> str:
    """Lag of the torque by kind of simulated log, then of each measured log that is long enough."""
    rows = rows_of("torque_lag")
    kinds = dict.fromkeys(row["kind"] for row in rows if row["kind"] != "measured")
    lines = [_kind(name, [row for row in rows if row["kind"] == name]) for name in kinds]
    measured = {(row["robot"], row[LAG]): row for row in rows if row["kind"] == "measured" and row[LAG] is not None}
    lines += [
        (f"{row['robot']}, measured: {_fitted(row)}", "1", _lag(row), SAID.get(row["said"], row["said"]))
        for row in measured.values()
    ]
    return table(("logs", "fits", "lag of the torque, ms", "message"), lines)


def _fitted(row: Row) -> str:
    """The fitted logs of a pair, and the cut-off or the effect of the fit if it is a special one."""
    logs, _, there = row["logs"].partition(" → ")
    return logs + (f" ({there.partition(' (')[2]}" if "(" in there else "")


def torque_lag_taken() -> str:
    """Errors of fits whose lag of the torque is taken back, with the torque as recorded and with the lag taken back."""
    rows = [row for row in rows_of("torque_lag") if row["taken back, ms"]]
    head = (
        "logs",
        "taken back, ms",
        "NRMSE, torque as recorded",
        "NRMSE, lag taken back",
        "over the error without a lag",
    )
    return table(head, [_taken(row) for row in rows])


def _taken(row: Row) -> tuple[str, ...]:
    named = f"{row['robot']}, measured: {row['logs']}"
    if row["kind"] != "measured":
        named = f"{row['robot']}, simulated: {row['kind']}, motion {row['seed']}"
    errors = (f"{row[f'error, {how}']:.4f}" for how in ("torque as recorded", "lag taken back"))
    over = row["taken back, over that without the lag"]
    return named, f"{row['taken back, ms']:.2f}".replace("-", "−"), *errors, "–" if over is None else f"{over:.2f}"


def _kind(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    arms = " and ".join(dict.fromkeys(row["robot"] for row in rows))
    least, most = (choose(rows, key=lambda row: row[LAG]) for choose in (min, max))
    said = {row["said"]: sum(other["said"] == row["said"] for other in rows) for row in rows}
    words = "; ".join(f"{SAID.get(word, word)}: {count} of {len(rows)}" for word, count in said.items())
    return f"{arms}, simulated: {name}", str(len(rows)), f"{_lag(least)} to {_lag(most)}", words


def _lag(row: Row) -> str:
    return f"{row[LAG]:.2f} ± {row[ERROR]:.2f}".replace("-", "−")


def _rises() -> Iterator[float]:
    yield from (row[RATIO] for row in rows_of("torque_lag") if row["kind"] == "half a sample late at 200 Hz")


def lag_raises_error() -> str:
    """Least and greatest factor by which a lag of half a sample at 200 Hz raises the error."""
    return f"{min(_rises()):.1f} to {max(_rises()):.1f}"


def gains_from_masses() -> str:
    """Torque per ampere from the URDF's masses, over that of the data set."""
    head = ("joint", "N·m/A of the data set", "from the masses", "ratio", "NRMSE with gains", "NRMSE without gains")

    def line(row: Row) -> tuple[str, ...]:
        doubt = row["relative standard error"]
        found = row["gain from the masses, N·m/A"]
        return (
            row["joint"],
            f"{row['gain of the data set, N·m/A']:.2f}",
            f"{found:.1f} ± {doubt * found:.1f}" if doubt < 1 else f"{found:.1f}, undetermined",
            f"{row['ratio']:.2f}",
            f"{row['NRMSE with gains']:.3f}",
            f"{row['NRMSE without gains']:.3f}",
        )

    return each(head, rows_of("gains_from_masses"), line)


def gains_doubt() -> str:
    """Median relative standard error of the gains that the masses determine, in percent."""
    known = [row["relative standard error"] for row in rows_of("gains_from_masses")]
    return f"{100 * middle(x for x in known if x < 1):.0f} %"


def _measured(name: str) -> Row:
    (found,) = (row for row in rows_of("measured_commands") if row["figure"] == name)
    return found


def _value(name: str, digits: int) -> str:
    return f"{_measured(name)['value']:.{digits}f}".replace("-", "−")


def _with_error(row: Row, digits: int, digits_of_error: int) -> str:
    return f"{row['value']:.{digits}f} ± {row['error']:.{digits_of_error}f}".replace("-", "−")


def clock_ur10e() -> str:
    """Slope of the UR10e's clock."""
    return _with_error(_measured("clock of the UR10e"), 2, 3)


def clock_tiago() -> str:
    """Slope of TIAGo's clock."""
    return _with_error(_measured("clock of TIAGo"), 2, 2)


def velocity_lag() -> str:
    """Lag of TIAGo's velocities, s."""
    return _value("TIAGo's velocity, s late", 2)


def zero_torques() -> str:
    """Least and largest share of TIAGo's torques that are zero, of three joints."""
    least, most = (100 * _measured(f"TIAGo's zeros, {which} share")["value"] for which in ("least", "largest"))
    return f"{least:.0f} to {most:.0f} %"


def missing_hand() -> str:
    """Mass of the hand that the Panda lacks, kg."""
    return _value("missing hand, kg", 2)


def payload_by_check() -> str:
    """The UR10e's payload by `check`, kg."""
    return _value("payload by check, kg", 1)


def payload_by_diagnose() -> str:
    """The UR10e's payload by `diagnose`, kg."""
    return _value("payload by diagnose, kg", 2)


def payload_mass() -> str:
    """The UR10e's payload by `payload`, kg."""
    return _value("payload, kg", 2)


def payload_found() -> str:
    """The same with its bound."""
    return _with_error(_measured("payload, kg"), 2, 2)


def payload_by_gains() -> str:
    """The UR10e's payload with the gains of the data set, kg."""
    return _with_error(_measured("payload by the data set's gains, kg"), 2, 2)


def gain_ratios() -> str:
    """Gains from the payload over those of the data set, joint by joint."""
    rows = [row for row in rows_of("measured_commands") if re.fullmatch(r"gain of \w+, ratio", row["figure"])]
    return ", ".join(_with_error(row, 2, 2) for row in rows)


def set_points_within() -> str:
    """Largest distance of the gains that `map` proposes from those of the data set, in percent."""
    ratios = [row["value"] for row in rows_of("measured_commands") if row["figure"].endswith("by map, ratio")]
    return f"{math.ceil(100 * max(abs(ratio - 1) for ratio in ratios))} %"
