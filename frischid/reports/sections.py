"""The report's seven chapters, from the verdict down to the data."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from frischid import figures
from frischid.core.text import listed
from frischid.diagnosis.effect_curves import shape_of
from frischid.diagnosis.findings import HOW_RANKED, Finding
from frischid.effects import EFFECTS
from frischid.figures.style import number
from frischid.reports.html import command, esc, folded, items, plot, plots, said, table
from frischid.reports.study import Study, missing, opened

SHOWN = 6  # findings drawn; the others stand in the ranking
VARIABLES = ("q", "v", "a", "load", "t")
VELOCITY = {
    "auto": "velocity as measured where it agrees with the positions, otherwise from them",
    "measured": "velocity as measured",
    "derived": "velocity from the positions",
}
ESTIMATORS = {
    "wls": "weighted least squares", "ols": "least squares", "map": "least squares with the URDF as a prior",
    "frisch": "best point of the Frisch box", "sensorwise": "sensor-wise Frisch scheme", "eiv": "errors in variables",
    "iv": "instrumental variables",
}  # fmt: skip
RECURSIONS = {
    "strict": "the paper's Algorithm 1", "undo": "windows that would empty the box are left out",
    "calibrated": "every window's box is widened by its sampling error",
}  # fmt: skip


def sections(study: Study, model_path: str) -> list[tuple[str, str, str]]:
    """Anchor, heading and HTML of every chapter."""
    return [
        ("verdict", "The verdict", verdict(study, model_path)),
        ("torque", "Measured against model", torque(study)),
        ("fails", "Where it fails", fails(study)),
        ("missing", "What is missing", lacking(study)),
        ("history", "The error falls", history(study)),
        ("parameters", "Parameters", parameters(study)),
        ("data", "Data quality", data(study)),
    ]


def unit_of(study: Study, joint: str) -> str:
    """Unit of a joint's torque or force."""
    return "N" if sliding(study, joint) else "N·m"


def sliding(study: Study, joint: str) -> bool:
    """Whether a joint is prismatic."""
    robot = study.model.robot
    return bool(robot.prismatic[robot.joints.index(joint)])


# ---------------------------------------------------------------------- 1


def verdict(study: Study, model_path: str) -> str:
    """How good, what is wrong, what to do next; then the warnings."""
    c = study.verdict
    count = len(study.held_out) or len(study.logs)
    which = f"{count} logs" if count > 1 else "a log"
    where = f"On {which} it has never seen" if study.held_out else f"On {which} it was fitted to"
    worst = max(c.joints, key=lambda n: c.joints[n].nrmse)
    good = (
        f"{where}, the model misses <strong>{said(f'{100 * c.nrmse:.1f} %')}</strong> of the torque's spread (NRMSE "
        f"{c.nrmse:.4f}, mean over {len(c.joints)} joints). "
    ) + said(
        f"The URDF alone misses {100 * c.nominal:.0f} %, a constant torque {100 * c.constant:.0f} %, and the sensors' "
        f"noise alone would leave {100 * c.noise_floor:.1f} %."
    )
    wrong = f"Worst is {worst}: {100 * c.joints[worst].nrmse:.1f} %. {figures.failure.worst(study.verdict)} "
    wrong += f"{missing(study.diagnosis)}." if study.diagnosis is not None else ""
    doubts = study.warnings()
    listing = (
        f'<h3>{_count(doubts)}</h3><div class="warnings">{items(doubts)}</div>' if doubts else "<p>No warnings.</p>"
    )
    return f'<p class="lead">{good} {said(wrong)}</p><p class="lead">{_next(study, model_path)}</p>{listing}'


def _count(warnings: Sequence[str]) -> str:
    return f"{len(warnings)} warning{'s' * (len(warnings) != 1)}"


def _next(study: Study, model_path: str) -> str:
    """What to do next."""
    diagnosis = study.diagnosis
    passing = [] if diagnosis is None else [f for f in diagnosis.findings if f.significant and f.members]
    best = passing[0] if passing else None
    if diagnosis is not None and diagnosis.verdict == "unknown":
        return "Next: look below at where the residual lies, and try a formula of your own in the studio."
    if best is not None:
        where = f" --joints {','.join(best.joints)}" if best.joints else ""
        given = Path(model_path).name
        better = "better.json" if given != "better.json" else "still-better.json"
        add = f"frischid add {shlex.quote(given)} {best.effect}{where} LOG... -o {better}"
        fall = f"{best.error_before:.4f} → {best.error_after:.4f}"
        return f"Next: add it. On data held out of its fit the NRMSE goes {fall}: {command(add)}"
    if study.weak:
        return (
            f"Next: {len(study.weak)} parameters are hardly known ({esc(', '.join(study.weak[:4]))}"
            f"{' …' * (len(study.weak) > 4)}); plan a motion that shows them with {command('frischid excite')}."
        )
    return "Next: nothing needs to be done; record another kind of motion to test the model further."


# ---------------------------------------------------------------------- 2


def torque(study: Study) -> str:
    """One figure a joint, and the errors as a table."""
    contacts = study.diagnosis.contacts if study.diagnosis is not None else ()
    drawings = [
        figures.measured(study.prediction, study.comparison, n, contacts, unit_of(study, n)) for n in study.model.joints
    ]
    rows = []
    for name, j in study.comparison.joints.items():
        bias = j.bias if abs(j.bias) > 1e-9 * j.rmse else 0.0  # what is left of a zero
        texts = [number(j.rmse), number(bias), *(f"{x:.4f}" for x in (j.nrmse, j.noise_floor))]
        rows.append([esc(name), unit_of(study, name), *texts, f"{j.nominal:.3f}", f"{j.constant:.3f}", f"{j.fit:.1f}"])
    headings = ["joint", "unit", "rms error", "bias", "NRMSE", "noise floor", "URDF alone", "constant torque", "fit, %"]
    rest = study.comparison.resting
    note = (
        f"<p>{100 * rest:.1f} % of the samples are left out because the joint rests: dry friction is undetermined "
        f"there (NRMSE with them {study.comparison.nrmse_with_rest:.4f}).</p>"
        if rest > 0
        else ""
    )
    caption = (
        "Errors joint by joint, over all logs. NRMSE is the rms error over the torque's standard deviation; so are the "
        "three columns after it: what the sensors alone would leave, and what two simpler models miss. fit = 100 (1 − "
        "NRMSE)"
    )
    touched = " Orange: a contact." if contacts else ""
    several = " Dotted: the next log begins." if len(study.logs) > 1 else ""
    key = (
        f"<p>Band: what the model's own uncertainty allows ({esc(study.prediction.band)}). Grey: the joint rests."
        f"{touched}{several}</p>"
    )
    return table(headings, rows, words=2, caption=caption) + note + key + "".join(plot(d) for d in drawings)


# ---------------------------------------------------------------------- 3


def fails(study: Study) -> str:
    """The matrix, then each joint's residual against what it might depend on; the worst joint is open."""
    c = study.comparison
    left = c.residuals.structure()
    worst = max(c.joints, key=lambda n: c.joints[n].nrmse)
    mixed = 0 < len(study.held_out) < len(study.logs)
    on_all = "<p>On all logs, those the model was fitted to and those it has never seen.</p>" if mixed else ""
    parts = [on_all, plot(figures.matrix(c))]
    for name, fit in c.joints.items():
        on = [figures.style.WORDS[v] for v, p in left[name].depends_on.items() if p < 0.01]
        says = f"depends on {listed(on)}" if on else "depends on nothing that shows"
        slides = sliding(study, name)
        drawings = [figures.against(study.prediction, name, v, slides) for v in VARIABLES]
        drawings.append(figures.plane(study.prediction, name, slides))
        summary = f"<strong>{esc(name)}</strong>: {said(f'{100 * fit.nrmse:.1f} %')} missed; the residual {esc(says)}"
        parts.append(folded(summary, plots(drawings), opened=name == worst))
    return "".join(parts)


# ---------------------------------------------------------------------- 4


def lacking(study: Study) -> str:
    """Ranked findings with their evidence."""
    diagnosis = study.diagnosis
    if diagnosis is None:
        return "<p>The model was not diagnosed on these logs.</p>"
    taken = "changed since it was identified" if diagnosis.situation == "changed" else "was always as it is"
    head = (
        f"<p>{esc(missing(diagnosis))}. Taken as: the robot {taken}. Each effect is refitted with all base parameters "
        f"and judged on data it was not fitted to: held-out NRMSE {diagnosis.error:.4f} without any, "
        f"{diagnosis.noise_floor:.4f} from the sensors alone.</p>"
    )
    contacts = [
        f"Contact in {Path(c.source).name} from {c.start:.2f} to {c.stop:.2f} s on {listed(c.joints)}: left out"
        for c in diagnosis.contacts
    ]
    significant = [f for f in diagnosis.findings if f.significant]
    cards = "".join(_card(study, i, f) for i, f in enumerate(significant[:SHOWN], start=1))
    more = f"<p>{HOW_RANKED}</p>" if len(significant) > 1 else ""
    rows = [
        [esc(f.effect), esc(", ".join(f.joints) or "robot"), f"{f.error_after:.4f}", f"{100 * f.share:.0f} %",
         number(f.gain, 3), "&lt; 10⁻¹⁵" if f.p_value < 1e-15 else number(f.p_value, 2),
         esc(", ".join(f.confused_with)) or "–"]
        for f in diagnosis.findings if f.members
    ]  # fmt: skip
    headings = ["effect", "where", "NRMSE after", "removes", "gain", "p", "confused with"]
    caption = (
        "NRMSE after: with this effect alone; removes: share of the error above the noise floor on its joints; gain: "
        "of log likelihood; p: probability of such a gain by chance. Ranked by how much the error rises when one "
        "effect is taken out of a model that has the others too: what they explain as well is not counted"
    )
    ranking = table(headings, rows, words=2, caption=caption)
    described = "".join(f"<p>{esc(note[:1].upper() + note[1:])}.</p>" for note in diagnosis.notes[1:])
    listed = items(contacts) if contacts else ""
    return head + listed + described + more + cards + folded("The whole ranking", ranking)


def _card(study: Study, rank: int, finding: Finding) -> str:
    kind = EFFECTS.get(finding.effect)
    if kind is None:
        return f"<article><h3>{rank}. {said(opened(finding.sentence, finding.joints))}</h3></article>"
    found = ", ".join(f"{k} = {number(x)} {unit}".rstrip() for k, x, unit in finding.found(study.model.robot))
    confused = listed(finding.confused_with) or "nothing on these logs"
    other = (*finding.confused_with, *kind.confused_with)[0]
    p = "below 10⁻¹⁵" if finding.p_value < 1e-15 else number(finding.p_value, 2)
    facts = [
        ("Evidence", f"held-out NRMSE {finding.error_before:.4f} → {finding.error_after:.4f}; removes "
         f"{100 * finding.share:.0f} % of what is above the noise floor on its joints; log likelihood gained "
         f"{finding.gain:.0f}, probability by chance {p}"),
        ("Effect", f"{finding.effect}: {kind.title}"),
        ("Found", found),
        ("Could also be", f"{confused} (in general: {listed(kind.confused_with)})"),
        ("To be sure", f"{kind.confirmed_by}. To plan a motion that tells it from {other}:"),
    ]  # fmt: skip
    separate = command(f"frischid excite ROBOT --separate {finding.effect},{other} -o motion.csv")
    listing = "".join(f"<dt>{k}</dt><dd>{said(v)}</dd>" for k, v in facts)
    listing = f"{listing.removesuffix('</dd>')} {separate}</dd>"
    shape = shape_of(study.diagnosis, finding, study.prediction) if study.diagnosis is not None else None
    picture = (
        "" if shape is None else plot(figures.shape(shape, kind.title, finding.joints, sliding(study, shape.joint)))
    )
    heading = f"{rank}. {opened(finding.sentence, finding.joints)}"
    return f"<article><h3>{said(heading)}</h3><dl>{listing}</dl>{picture}</article>"


# ---------------------------------------------------------------------- 5


def history(study: Study) -> str:
    """The staircase and its steps."""
    floor = study.diagnosis.noise_floor if study.diagnosis is not None else study.verdict.noise_floor
    rows = []
    for i, event in enumerate(study.model.history):
        after = event.get("error_after", event.get("held_out_nrmse"))
        on = event.get("measured_on", "held out" if after is not None else "cross-validated on the fitted logs")
        after = event.get("cross_validated_nrmse") if after is None else after
        listed = rounded(", ".join(event.get("effects", ())))
        before = event.get("error_before")
        errors = ["–" if x is None else f"{x:.4f}" for x in (before, after)]
        rows.append([str(i), esc(event["action"]), esc(listed), *errors, esc(on)])
    headings = ["step", "action", "effects", "before", "after", "NRMSE measured on"]
    caption = f"Steps of the model. {_shapes(study)}"
    listing = f'<div class="wide steps">{table(headings, rows, words=3, caption=caption)}</div>'
    return plot(figures.staircase(study.model, floor)) + listing


def rounded(effects: str) -> str:
    """Effects with the numbers of their shapes as a person writes them."""
    return re.sub(r"\d+\.\d{5,}", lambda found: number(float(found[0])), effects)


def _shapes(study: Study) -> str:
    """Units of what stands in an effect's parentheses."""
    robot = study.model.robot
    units: dict[str, str] = {}
    for effect in study.model.effects:
        units |= {name: unit for name in effect.parameters if (unit := effect.unit(name, robot))}
    return f"In parentheses an effect's shape: {', '.join(f'{k} in {u}' for k, u in units.items())}" if units else ""


# ---------------------------------------------------------------------- 6


def parameters(study: Study) -> str:
    """Bounds, values, correlation, regrouping, and BBRF over the windows."""
    model, e = study.model, study.model.estimate
    intro = (
        f"<p>{len(e.theta)} base parameters, {esc(ESTIMATORS.get(e.estimator, e.estimator))}, condition number "
        f"{number(e.condition, 3)}. "
        + (f"{len(study.weak)} are known to no better than half their value. " if study.weak else "")
        + (f"Of impossible sign: {esc(listed(study.impossible))}." if study.impossible else "Every known sign holds.")
        + f"</p><p>{_physical(study)}</p>"
    )
    known = [("true", study.truth), ("URDF", study.nominal)]
    given = [(name, values) for name, values in known if values is not None]
    rows = []
    for i, column in enumerate(e.columns):
        flags = []
        if column.name in study.impossible:
            flags.append("impossible sign")
        if column.name in study.weak:
            flags.append("hardly known")
        boxes = [_range(float(b.lower[i]), float(b.upper[i])) for b in model.bounds.values()]
        values = [number(float(x[i])) for _, x in given]
        unit = "–" if column.unit == "1" else column.unit
        row = [esc(column.name), esc(unit), number(e.theta[i]), number(e.stderr[i], 2)]
        rows.append([*row, *values, *boxes, esc(", ".join(flags)), _sum(model.expressions[i])])
    methods = [f"{figures.parameters.title(k)} box" for k in model.bounds]
    headings = ["parameter", "unit", "value", "± s.e.", *(n for n, _ in given), *methods, "flags", "stands for"]
    caption = "Base parameters; R marks one that others are regrouped into; s.e. is the standard error"
    listing = table(headings, rows, words=2, caption=caption)
    listing = f'<div class="wide">{listing}</div>'
    closing = figures.closing(model)
    record = figures.parameters.recursion_of(model)
    return (
        intro
        + plot(figures.intervals(model, study.nominal, study.truth))
        + listing
        + plot(figures.correlation(model))
        + _regrouping(study)
        + "<h3>The bounding-box recursion</h3>"
        + _recursion(record, refitted=model.recursion is None)
        + plots(closing)
    )


def _sum(expression: str) -> str:
    """A regrouped parameter, with minus signs, and factors that stay with what they multiply."""
    return esc(re.sub(r"(?<=\d) (?=[a-zA-Z])", "\u00a0", expression.replace(" - ", " − ")))


def _range(low: float, high: float) -> str:
    """A box's side; an open end is infinite."""
    if np.isinf(low) and np.isinf(high):
        return "open"
    return f"{'−∞' if np.isinf(low) else number(low, 3)} … {'∞' if np.isinf(high) else number(high, 3)}"


def _physical(study: Study) -> str:
    """Whether links that could exist have these base parameters."""
    found = study.physical
    if isinstance(found, str):
        return f"Physical links: none found. {esc(found)}"
    limits: dict[str, list[str]] = {}
    for active in found.active:
        limits.setdefault(active.constraint, []).append(active.where)
    held = "; ".join(f"{listed(where)}: {constraint}" for constraint, where in limits.items())
    demanded = f" What holds them back: {esc(held)}." if held else ""
    return (
        "Physical links: links that could exist (positive mass, possible inertia, centre of mass within the body) "
        f"reproduce these parameters to {said(f'{found.unexplained:.1f} standard errors')} (rms).{demanded}"
    )


def _regrouping(study: Study) -> str:
    reduction = study.reduction
    if reduction is None:
        return ""
    names = [c.name for c in reduction.columns]
    groups = (
        ("identifiable alone", reduction.absolute),
        ("only in combination", reduction.linear),
        ("not at all", reduction.none),
    )
    rows = [[esc(k), str(len(x)), esc(", ".join(names[i] for i in x))] for k, x in groups]
    caption = f"{len(names)} parameters, rank {reduction.rank}"
    return folded(
        "Regrouping: which parameters the torque depends on", table(["", "count", "parameters"], rows, 3, caption)
    )


def _recursion(record: dict[str, Any] | None, *, refitted: bool) -> str:
    if record is None:
        return f"<p>The model was identified without it ({command('frischid identify --bbrf')}).</p>"
    emptied = record["emptied"]
    meant = RECURSIONS.get(record["variant"], record["variant"])
    text = (
        f"Every short window of the logs gives a box of its own, and the recursion intersects them: "
        f"{record['windows']} windows, variant {esc(record['variant'])} ({esc(meant)})."
    )
    if isinstance(emptied, dict):
        text += (
            f" The bounds of {esc(emptied['parameter'])} crossed at window {emptied['window']}: the windows contradict "
            "one another, and the recursion gives no box. Drawn is how far it came."
        )
    if refitted:
        text += " It was done for the model as it was identified, before anything was added."
    return f"<p>{text}</p>"


# ---------------------------------------------------------------------- 7


def data(study: Study) -> str:
    """Logs, what was done to them, noise and excitation."""
    rows = []
    for q in study.qualities:
        short, long = (1e3 * s for s in q.steps)
        role = "held\u00a0out" if q.source in study.held_out else "fitted"
        texts = [str(q.samples), number(q.seconds), number(q.rate), _steps(number(short, 3), number(long, 3))]
        rows.append([esc(Path(q.source).name), role, *texts, str(q.gaps), number(q.kept)])
    headings = ["log", "role", "samples", "seconds", "grid, Hz", "step, ms", "gaps", "seconds kept"]
    done = _grouped(study)
    lowpass = study.model.lowpass
    cut = f"{lowpass.cutoff:g} Hz" if lowpass.cutoff else "nothing"
    done.insert(0, f"low-pass: {cut} ({lowpass.reason}), {VELOCITY[study.model.velocity]}")
    robot = study.model.robot
    speed, acceleration = (np.max([getattr(q, k) for q in study.qualities], axis=0) for k in ("speed", "acceleration"))
    rest = np.average([q.resting for q in study.qualities], axis=0, weights=[q.kept for q in study.qualities])
    moved = []
    for i, n in enumerate(robot.joints):
        units = ("m/s", "m/s²") if robot.prismatic[i] else ("rad/s", "rad/s²")
        level = [number(float(np.nanmedian([q.noise[c][i] for q in study.qualities])), 2) for c in ("q", "tau")]
        noise = f"{level[0]} {'m' if robot.prismatic[i] else 'rad'}", f"{level[1]} {unit_of(study, n)}"
        fastest = f"{number(speed[i], 3)} {units[0]}", f"{number(acceleration[i], 3)} {units[1]}"
        moved.append([esc(n), *fastest, f"{100 * rest[i]:.0f} %", *noise])
    excited = table(
        ["joint", "fastest", "largest acceleration", "at rest", "noise of q", "noise of torque"],
        moved, caption=f"Excitation; condition number of the regression {study.model.estimate.condition:.3g}",
    )  # fmt: skip
    drawings = [figures.reach(robot, study.qualities)]
    drawings += [figures.noise(robot, study.qualities, "tau"), figures.noise(robot, study.qualities, "q")]
    return (
        table(headings, rows, words=2, caption="The logs")
        + "<h3>What was filtered, trimmed and dropped</h3>" + items(done) + excited + plots(drawings)
    )  # fmt: skip


def _steps(short: str, long: str) -> str:
    return short if short == long else f"{short} … {long}"


def _grouped(study: Study) -> list[str]:
    """What was done, each note once with the logs it holds for."""
    found: dict[str, list[str]] = {}
    for q in study.qualities:
        for note in q.notes:
            found.setdefault(note.removeprefix(f"{q.source}: "), []).append(Path(q.source).name)
    every = len(study.qualities)
    # What holds for most logs first.
    return [
        f"{_all(every) if len(logs) == every else listed(logs)}: {note}" if every > 1 else note
        for note, logs in sorted(found.items(), key=lambda item: -len(item[1]))
    ]


def _all(logs: int) -> str:
    return "both logs" if logs == 2 else f"all {logs} logs"
