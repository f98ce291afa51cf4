"""Tables of cost: ratios of processor time, growing logs, the search of the diagnosis, a fleet, exported code."""

from __future__ import annotations

from table_parts import Row, data, each, middle, rows_of, table


def exported_code() -> str:
    """Time of a call of the exported C."""
    rows = data("exported_code")["rows"]
    robots = [key for key in rows[0] if key != "model"]
    return table(("ns per call", *robots), [(row["model"], *(f"{row[name]:.0f}" for name in robots)) for row in rows])


def studio_page() -> str:
    """Waits of a user of the studio."""
    rows = [(row["wait"], f"{row['median s']:.1f}", f"{row['worst s']:.1f}") for row in rows_of("studio_page")]
    note = sentence("studio_page", 0)
    return f"{table(('wait', 'median, s', 'longest, s'), rows)}\n{note}.\n"


def sentence(script: str, number: int) -> str:
    """A note of a stored result, with a capital letter."""
    note = str(data(script)["notes"][number])
    return note[0].upper() + note[1:]


def by(script: str, key: str, name: str) -> Row:
    """The row of a stored result whose `key` is `name`."""
    return next(row for row in rows_of(script) if row[key] == name)


def against_figaroh() -> str:
    """The same regression by figaroh, frischid, and a bare loop."""
    head = ("program", "µs per sample", "over the bare loop", "over frischid")
    keys = ("µs per sample", "× bare loop", "× frischid")
    rows = rows_of("against_figaroh")
    words = f"{sentence('against_figaroh', 0)}; {data('against_figaroh')['notes'][3]}"
    return each(head, rows, lambda row: (row["variant"], *(f"{row[key]:.3g}" for key in keys))) + f"\n{words}.\n"


def figaroh_ratio() -> str:
    """Time of figaroh over that of frischid."""
    return f"{by('against_figaroh', 'variant', 'figaroh')['× frischid']:.0f}"


def moments_us() -> str:
    """Time of one sample in moments, µs."""
    return f"{by('regressor', 'variant', 'streamed into moments')['µs per sample']:.1f}"


def loops_for_25() -> str:
    """Bare loops of a whole job that is 25 times faster than figaroh."""
    return f"{by('against_figaroh', 'variant', 'figaroh')['× bare loop'] / 25:.2f}"


def regressor_over_loop() -> str:
    """Time of the full regressor over that of the bare loop."""
    return f"{by('regressor', 'variant', 'full regressor')['ratio']:.2f}"


def against_mujoco() -> str:
    """Armature and damping by mujoco.sysid and by frischid."""
    head = ("program", "samples", "processor time, s", "over frischid", "worst armature", "worst damping")
    worst = ("worst error of an armature %", "worst error of a damping %")

    def line(row: Row) -> tuple[str, ...]:
        errors = (f"{row[key]:.2g} %" for key in worst)
        return row["tool"], f"{row['samples']:,}", f"{row['seconds']:.2g}", f"{row['× frischid']:.2g}", *errors

    return each(head, rows_of("against_mujoco"), line) + f"\n{sentence('against_mujoco', 0)}.\n"


def mujoco_ratio() -> str:
    """Time of mujoco.sysid over that of frischid, least and most."""
    ratios = [row["× frischid"] for row in rows_of("against_mujoco") if row["tool"] != "frischid"]
    least, most = (f"{x:.0f}" for x in (min(ratios), max(ratios)))
    return least if least == most else f"{least} to {most}"


def startup() -> str:
    """Start-up of whole processes against the libraries that they need."""
    rows = rows_of("startup")
    return each(
        ("process", "against", "ratio"), rows, lambda row: (row["process"], row["against"], f"{row['ratio']:.2f}")
    )


def regressor() -> str:
    """A row of the regressor, alone and streamed into moments."""
    rows = rows_of("regressor")
    words = data("regressor")["notes"][0]
    return (
        each(("job", "over the bare loop"), rows, lambda row: (row["variant"], f"{row['ratio']:.2f}")) + f"\n{words}.\n"
    )


def previous_release() -> str:
    """Processor time of the commands in release 0.1.0 and now."""
    head = ("command", "0.1.0, s", "now, s", "now over 0.1.0", "result in 0.1.0", "result now")

    def line(row: Row) -> tuple[str, ...]:
        times = (f"{row['before, s']:.1f}", f"{row['now, s']:.1f}", f"{row['ratio']:.2f}")
        return row["command"], *times, row["result before"] or "–", row["result now"] or "–"

    return each(head, rows_of("previous_release"), line)


def scaling() -> str:
    """Identify and compare on growing logs and robots."""
    head = ("robot", "joints", "base parameters", "samples", "identify", "compare", "peak MiB")
    rows = sorted(rows_of("scaling"), key=lambda row: (row["joints"] != 6, row["joints"], row["samples"]))
    first = by_samples(rows)

    def line(row: Row) -> tuple[str, ...]:
        ratios = (f"{row[key] / first[key]:.2f}" for key in ("identify µs", "compare µs"))
        size = (str(row["joints"]), str(row["base parameters"]), f"{row['samples']:.0e}".replace("e+0", "e"))
        return row["robot"], *size, *ratios, f"{row['peak MiB']:.0f}"

    start = middle(row["MiB at start"] for row in rows)
    own = f"({first['identify µs']:.3g} and {first['compare µs']:.3g} µs)"
    words = (
        f"*identify* and *compare*: time per sample, over that of the UR10 with {first['samples']:,} samples {own}.\n"
        f"The process has {start:.0f} MiB before the first sample (median).\n"
    )
    return f"{each(head, rows, line)}\n{words}"


def by_samples(rows: list[Row]) -> Row:
    """The row of the UR10 with 1e5 samples, or with the fewest."""
    six = [row for row in rows if row["joints"] == 6]
    return next((row for row in six if row["samples"] == 100_000), six[0])


def scaling_diagnose() -> str:
    """The search of the diagnosis, for growing catalogues and logs."""
    head = ("effects", "places × joints", "shapes", "samples", "processor time, s", "peak MiB")

    def line(row: Row) -> tuple[str, ...]:
        sizes = (str(row["effects"]), str(row["places"]), f"{row['shapes']:,}")
        samples = f"{row['samples']:.0e}".replace("e+0", "e")
        return *sizes, samples, f"{row['seconds']:.2g}", f"{row['peak MiB']:.0f}"

    return each(head, rows_of("scaling_diagnose"), line)


def fleet() -> str:
    """The first robots of the simulated fleet."""
    head = ("robot", "altered by", "named", "times the usual distance", "differs")
    rows = rows_of("fleet")

    def line(row: Row) -> tuple[str, ...]:
        differs = "yes" if row["differs"] else "no"
        return row["robot"], row["altered"] or "–", row["named"] or "–", f"{row['× usual']:.3g}", differs

    notes = data("fleet")["notes"]
    return each(head, rows, line) + f"\n{notes[0]}; {notes[4]}.\n"


def small_fleets_count() -> str:
    """Simulated small fleets."""
    return str(len(rows_of("small_fleets")))


def small_fleets_loads() -> str:
    """Fleets in which the arm with a load is found."""
    return str(sum(row["load found"] for row in rows_of("small_fleets")))


def small_fleets_frictions() -> str:
    """Fleets in which the arm with more friction is found."""
    return str(sum(row["friction found"] for row in rows_of("small_fleets")))


def small_fleets_others() -> str:
    """Unchanged arms that are named, in all fleets."""
    return str(sum(row["unchanged arms named"] for row in rows_of("small_fleets")))
