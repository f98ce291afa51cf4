"""Drive gains as a page."""

from __future__ import annotations

import shlex
from typing import Any

from rich.markup import escape

from frischid.cli.pages.page import Page, figure, plain, table_of
from frischid.core.text import percent
from frischid.export.drive_gains import Gains

UNCERTAIN_GAIN = 0.05  # standard error over value, above which a drive gain is called uncertain

WHAT = {
    "current": "torque per ampere",
    "tau": "factor on the torque channel",
    "qcmd": "kp, torque per position error",
}


def gains(found: Gains) -> Page:
    """Gains by three methods, the given gains, and the payload that the given gains would measure."""
    what = WHAT[found.channel]
    extra = [] if found.given is None else ["given", "ratio"]
    table = table_of("joint", "gain", "± s.e.", "total least squares", "physical", *extra, title=f"drive gains: {what}")
    rows = []
    for j, name in enumerate(found.joints):
        values = [found.gains[j], found.stderr[j], found.total_least_squares[j], found.constrained[j]]
        row: dict[str, Any] = dict(
            zip(("gain", "stderr", "total_least_squares", "constrained"), map(plain, values), strict=True)
        )
        cells = [figure(x) for x in values]
        if found.given is not None:
            ratio = found.gains[j] / found.given[j]
            cells += [figure(found.given[j]), f"{ratio:.3f}"]
            row["given"] = plain(found.given[j])
        table.add_row(name, *cells)
        rows.append({"joint": name, **row})
    weak = [n for n, g, s in zip(found.joints, found.gains, found.stderr, strict=True) if s > UNCERTAIN_GAIN * abs(g)]
    parts: list[Any] = [table]
    if weak:
        parts.append(f"uncertain with this payload (s.e. above {percent(UNCERTAIN_GAIN)}): {', '.join(weak)}")
    if found.channel == "qcmd" and found.given is None:
        named = ",".join(f"{n}={g:.4g}" for n, g in zip(found.joints, found.gains, strict=True))
        parts.append(
            f"to use these gains: frischid identify ROBOT LOGS --controller pd --kp {escape(shlex.quote(named))}"
        )
    cut = "unfiltered" if found.lowpass.cutoff is None else f"low-passed at {found.lowpass.cutoff:g} Hz"
    data: dict[str, Any] = {
        "channel": found.channel,
        "mass": found.mass,
        "joints": rows,
        "samples": found.samples,
        "cutoff_hz": found.lowpass.cutoff,
        "notes": list(found.notes),
        "payload": None,
    }
    if found.payload is not None:
        p = found.payload
        change = p.mass / found.mass - 1
        centre = ", ".join(f"{x:.3f}" for x in p.centre)
        parts.append(
            f"with the given gains the payload would be {p.mass:.3f} ± {p.mass_stderr:.3f} kg ({change:+.1%} off its "
            f"true mass), its centre of mass at ({centre}) m"
        )
        data["payload"] = {
            "mass": p.mass,
            "mass_stderr": p.mass_stderr,
            "centre_of_mass": [plain(x) for x in p.centre],
            "relative_error": change,
        }
    parts += [f"{found.samples} samples, {cut}", *(f"  {escape(n)}" for n in found.notes)]
    return Page(data, parts)
