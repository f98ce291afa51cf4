"""The whole pipeline: logs in, a model with bounds out.

logs → one cut-off → motions → moments of [Y τ] → base parameters → least squares with standard errors → Frisch simplex
and box → bounding-box recursion → (on request) the best point of the box → model → held-out comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import islice
from typing import Any, Literal, cast

import numpy as np

from frischid.checks import LogReport, inspect
from frischid.core.types import Array
from frischid.effects import BASELINE, Effect
from frischid.errors import EmptyBoxError, IdentifiabilityError, InputError, UnknownNameError
from frischid.estimators.bbrf import Recursion, Variant, bbrf
from frischid.estimators.box_qp import Selection, select
from frischid.estimators.errors_in_variables import eiv
from frischid.estimators.friction_smoothing import baseline, dry_friction
from frischid.estimators.frisch import Box, Simplex, simplex
from frischid.estimators.instrumental_variables import iv
from frischid.estimators.least_squares import Estimate, cross_validated, ols, wls
from frischid.estimators.sensor_noise import noise_limits, samples, sensor_moments
from frischid.estimators.sensorwise import sensorwise
from frischid.estimators.urdf_prior import Choice, chosen, urdf_priors
from frischid.logs.cutoff_choice import choose_lowpass
from frischid.logs.filters import LowPass
from frischid.logs.log import Log
from frischid.logs.preprocessing import Motion, prepare
from frischid.logs.recording import Motions, Recording, check_logs, chunks_of, preview_of
from frischid.logs.summary import Data, LogSummary, check_usable, held_by, moving_but_locked, summarise
from frischid.logs.summary import torque_joints as torque_joints_of
from frischid.model.comparison import Comparison, compare
from frischid.model.model import Model
from frischid.regression.base_parameters import Reduction
from frischid.regression.moments import Gram, total
from frischid.regression.regressor import Block, Regressor, accumulate, stack, streaming_qr
from frischid.regression.streaming_qr import SAFE_CONDITION
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

FIRST_PIECES = 4  # of a recording, on which the width of dry friction's sign is chosen
HOPELESS = 0.8  # cross-validated NRMSE above which a joint is not explained but wrong
MOST_ROWS = 100_000  # of the bounding-box recursion, which needs them all in memory and inverts a matrix for each
ESTIMATORS = ("wls", "ols", "frisch", "sensorwise", "eiv", "iv")
RECORDED = 40  # steps of the recursion kept with the model
PRIORS = ("auto", "none", "urdf")
RECURSIONS = ("strict", "undo", "calibrated", "none")


@dataclass(frozen=True, eq=False)
class Identification:
    """Everything `identify` found out.

    Attributes
    ----------
    model : Model
    reduction : Reduction
        Which parameters the torque depends on, and how they combine.
    simplex : Simplex
        The p + 1 least-squares solutions.
    recursion : Recursion or None
        BBRF; None when not asked for, or when the log is too short for two windows.
    selection : Selection or None
        The point chosen in the box, for the estimator ``"frisch"``.
    cross_validation : dict of str to float
        NRMSE of each joint on stretches of the identification logs that were left out of the fit.
    comparison : Comparison or None
        On the validation logs.
    samples : int
        Filtered samples fitted.
    notes : tuple of str
        What was done to the data.
    warnings : tuple of str
        What should make the reader doubt.
    prior : Choice or None
        Whether the URDF was used as a prior, and why; None when it was not considered.
    """

    model: Model
    reduction: Reduction
    simplex: Simplex
    recursion: Recursion | None
    selection: Selection | None
    cross_validation: dict[str, float]
    comparison: Comparison | None
    samples: int
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    prior: Choice | None = None

    def __repr__(self) -> str:
        error = "" if self.comparison is None else f", held-out NRMSE {self.comparison.nrmse:.4f}"
        return f"Identification({self.model!r}{error}, warnings: {len(self.warnings)})"


def identify(
    robot: Robot,
    logs: Sequence[Data],
    *,
    valid: Sequence[Data] = (),
    effects: Sequence[Effect] | None = None,
    torque_joints: Sequence[str] | None = None,
    cutoff: float | Literal["auto"] | None = "auto",
    velocity: str = "auto",
    estimator: str = "wls",
    prior: str = "auto",
    recursion: str = "strict",
    window: int | None = None,
    reference: Mapping[str, float] | None = None,
    force: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """Identify a robot's dynamic parameters from logs.

    Parameters
    ----------
    robot : Robot
        Joints that some log does not hold are locked, and a note says so.
    logs : sequence of Log or Recording
        Logs to fit, each on its own; a `Recording` is read piece by piece and never held as a whole.
    valid : sequence of Log or Recording
        Logs to measure the error on.
    effects : sequence of Effect, optional
        What acts besides the rigid links. By default `BASELINE`, with the speed over which dry friction changes its
        direction chosen by cross-validation.
    torque_joints : sequence of str, optional
        Joints whose torque is fitted; all with a torque channel by default.
    cutoff : float, "auto" or None
        Cut-off of the parallel filter, Hz; None filters nothing.
    velocity : {"auto", "measured", "derived"}
    estimator : {"wls", "ols", "frisch", "sensorwise", "eiv", "iv"}
        Whose values become the model's. ``"frisch"`` is the paper's: the best point in the Frisch box. ``"sensorwise"``
        adds the box of `sensorwise`, with the sensors' noise limited to what the log shows; ``"eiv"`` and
        ``"iv"`` are errors-in-variables likelihood and instrumental variables.
    prior : {"auto", "none", "urdf"}
        ``"urdf"``: the URDF's parameters are a prior with a stated uncertainty, as strong as predicts best in
        cross-validation. ``"auto"``: so if the logs are too short to determine the parameters alone and
        cross-validation says that it helps. Only with the estimator ``"wls"``.
    recursion : {"strict", "undo", "calibrated", "none"}
        Variant of the bounding-box recursion.
    window : int, optional
        BBRF window in rows; by default the larger of 1000 and 20 a parameter, at most half the rows.
    reference : mapping of str to float, optional
        Parameter values from which effects that depend on the load take it; the URDF's own by default.
    force : bool
        Go on in spite of an issue of `frischid.checks` that is certain and makes the logs worthless.
    progress : callable
        Told what is being done.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        A log is not usable.
    IdentifiabilityError
        The logs do not determine the parameters.
    EmptyBoxError
        The estimator is ``"frisch"`` and BBRF contradicted itself.
    """
    _check_options(estimator, recursion, prior)
    check_logs(logs, valid)
    robot, notes = held_by(robot, logs)
    rows = torque_joints_of(robot, logs, torque_joints, notes)
    streamed = any(isinstance(log, Recording) for log in logs)
    seen, pieces, motions = _prepared(robot, logs, valid, rows, cutoff, velocity, force)
    lowpass = seen.lowpass
    notes.append(_filtering(lowpass))
    progress("checking the logs")
    reports = _reports(robot, logs, None if streamed else (lowpass, list(motions)))
    warnings = [f"{report.source}: {issue.short}" for report in reports for issue in report.issues]
    if not force:
        _refuse_worthless(reports)
    if effects is None:
        effects = _default_effects(robot, motions, lowpass, rows, notes)

    progress("regressor and moments")
    regressor = Regressor(robot, effects, reference)
    reduction = structure(regressor, rows)
    columns = reduction.base_columns()
    blocks = accumulate(
        regressor, motions, lowpass, rows, seconds=seen.seconds if streamed else None, base=reduction.base
    ).described(columns)
    notes += pieces.notes
    if reduction.gap < 100:
        warnings.append(
            f"the rank is not clear (gap {reduction.gap:.1f}): some base parameter hardly acts on the torque"
        )

    progress("estimate")
    choice = None
    if estimator == "wls" and prior != "none":
        beliefs = urdf_priors(regressor, reduction, total(blocks))
        independent = _independent_rows(seen, lowpass) * len(rows)
        choice = chosen(blocks, beliefs, always=prior == "urdf", independent=independent)
    estimate = choice.estimate if choice is not None else ols(blocks) if estimator == "ols" else wls(blocks)
    used = None if choice is None else choice.prior
    if estimate.condition > SAFE_CONDITION and used is None:
        progress("streaming QR")
        theta = streaming_qr(regressor, motions, lowpass, rows, reduction.base).solve(estimate.weights)
        estimate = replace(estimate, theta=theta)
        notes.append(f"condition number {estimate.condition:.1e}: solved by a streaming QR, moments would lose digits")
    whole = total(blocks)
    moments = (whole.weighted(estimate.weights) + (0.0 if used is None else used.moments)) / whole.rows
    triangle = simplex(moments, whole.names)
    bounds = {"frisch": triangle.box()}
    progress("bounding-box recursion")
    recursed = _recursion(regressor, motions, lowpass, rows, reduction, estimate, recursion, window, warnings)
    if recursed is not None and recursed.box is not None:
        bounds["bbrf"] = recursed.box
    selection = None
    if estimator == "frisch":
        selection = select(moments, recursed.require_box() if recursed is not None else bounds["frisch"])
        estimate = replace(estimate, theta=selection.theta, estimator="frisch")
    if estimator in {"sensorwise", "eiv", "iv"}:
        progress(f"estimator {estimator}")
        estimate, box = _by_sensors(estimator, regressor, motions, lowpass, rows, reduction, estimate)
        if box is not None:
            bounds["sensorwise"] = box
    warnings += [*estimate.notes, *moving_but_locked(seen.moving), *_doubts(triangle, recursed)]

    model = Model(
        robot,
        tuple(effects),
        lowpass,
        velocity,
        reduction.base,
        tuple(reduction.expressions()),
        estimate,
        whole.sums[:, -1] / whole.counts,
        bounds,
        reference,
        recursion=None if recursed is None else _record(recursed, estimate),
    )
    progress("comparison")
    held_out = dict(zip(rows, _nrmse(whole, cross_validated(blocks, estimate, prior=used)), strict=True))
    comparison = compare(model, valid) if valid else None
    if choice is not None and choice.sentence:
        (notes if used is None else warnings).append(choice.sentence)
    warnings = list(dict.fromkeys([*_hopeless(held_out), *warnings]))
    notes = list(dict.fromkeys(notes))
    event = _event(effects, logs, seen.samples, valid, held_out, comparison) | {"notes": notes, "warnings": warnings}
    if used is not None and choice is not None:
        event["prior"] = {"kind": "urdf", "strength": choice.strength}
    model = replace(model, history=(event,))
    return Identification(
        model,
        reduction,
        triangle,
        recursed,
        selection,
        held_out,
        comparison,
        int(whole.counts.max()),
        tuple(notes),
        tuple(warnings),
        choice,
    )


def _check_options(estimator: str, recursion: str, prior: str) -> None:
    for kind, name, known in (
        ("estimator", estimator, ESTIMATORS),
        ("recursion", recursion, RECURSIONS),
        ("prior", prior, PRIORS),
    ):
        if name not in known:
            raise UnknownNameError(kind, name, known)
    if prior == "urdf" and estimator != "wls":
        raise InputError(f"a prior needs the estimator wls, not {estimator}; leave one of the two out")


def _prepared(
    robot: Robot,
    logs: Sequence[Data],
    valid: Sequence[Data],
    rows: Sequence[str],
    cutoff: float | Literal["auto"] | None,
    velocity: str,
    force: bool,
) -> tuple[LogSummary, Motions, Iterable[Motion]]:
    """What the logs hold, and their motions: read again each time they are gone through, or all in memory."""
    try:
        _check_cutoff(cutoff, [*logs, *valid])
        seen = summarise(robot, logs, rows, cutoff)
        pieces = Motions(logs, robot.joints, seen.lowpass, velocity)
        # What is in memory anyway is prepared once; a recording is read again each time it is gone through.
        return seen, pieces, pieces if any(isinstance(log, Recording) for log in logs) else list(pieces)
    except InputError:
        if not force:  # a wrong unit is a better reason than what follows from it
            _refuse_worthless(_reports(robot, logs))
        raise


def _default_effects(
    robot: Robot, motions: Iterable[Motion], lowpass: LowPass, rows: Sequence[str], notes: list[str]
) -> Sequence[Effect]:
    """The baseline, its dry friction as sharp as the data say."""
    # Of a recording, the beginning must do: reading all of it takes long.
    some = motions if isinstance(motions, list) else list(islice(motions, FIRST_PIECES))
    dry = dry_friction(robot, some, lowpass, rows, structure(Regressor(robot, BASELINE), rows))
    if dry is None:
        return BASELINE
    ahead = f", {1e3 * dry.lead:g} ms ahead of the motion" if dry.lead else ""
    notes.append(
        f"dry friction changes its direction over ±{dry.width:g} rad/s (m/s){ahead}, chosen by cross-validation"
    )
    return baseline(dry)


def _independent_rows(seen: LogSummary, lowpass: LowPass) -> float:
    """Samples that are not copies of their neighbours: two a second and hertz of bandwidth."""
    rate = sum(seen.samples) / max(seen.seconds, 1e-9)
    return 2.0 * min(lowpass.cutoff or np.inf, 0.5 * rate) * seen.seconds


def _hopeless(held_out: Mapping[str, float]) -> list[str]:
    """Warn of joints whose torque the model does not explain even on what it was fitted to."""
    names = [n for n, x in held_out.items() if x > HOPELESS]
    if not names:
        return []
    return [
        f"the torque of {', '.join(names)} is hardly predicted at all (cross-validated NRMSE above {HOPELESS}): are "
        "columns swapped, a sign flipped, an angle in degrees, or a channel dead?"
    ]


def _event(
    effects: Sequence[Effect],
    logs: Sequence[Data],
    samples: Sequence[int],
    valid: Sequence[Data],
    held_out: Mapping[str, float],
    comparison: Comparison | None,
) -> dict[str, Any]:
    """Entry of the model's history."""
    return {
        "action": "identify",
        "effects": [str(e) for e in effects],
        "logs": [
            {"source": log.source, "sha256": log.identity, "samples": count}
            for log, count in zip(logs, samples, strict=True)
        ],
        "cross_validated_nrmse": float(np.mean(list(held_out.values()))),
        "held_out_nrmse": None if comparison is None else comparison.nrmse,
        "held_out_logs": [{"source": log.source, "sha256": log.identity} for log in valid],
    }


def examine(robot: Robot, logs: Sequence[Log]) -> list[LogReport]:
    """Check that logs can be used with a robot, and say what is suspicious in them.

    Raises
    ------
    InputError
        A log cannot be used at all.
    """
    robot, locked = held_by(robot, logs)
    for log in logs:
        chosen = log.select(robot.joints)
        rows = [n for n in robot.joints if chosen.select([n]).has("tau")[0]] or list(robot.joints)
        check_usable(robot, log, rows, strict=False)
    reports = []
    for log, report in zip(logs, _reports(robot, logs), strict=True):
        prepared: tuple[str, ...] = ()
        if not report.blocked:
            with suppress(InputError):  # a log too short for the filters is for `identify` to refuse
                lowpass = choose_lowpass([log], robot.joints)
                prepared = prepare(log.select(robot.joints), lowpass, velocity="derived").notes
        facts = {**report.facts, "joints": list(robot.joints), "notes": [*locked, *log.notes, *prepared]}
        reports.append(replace(report, facts=facts))
    return reports


def _reports(
    robot: Robot, logs: Sequence[Data], prepared: tuple[LowPass, Sequence[Motion]] | None = None
) -> list[LogReport]:
    """Data check of every log, in short where they are `prepared`; of a recording its first piece."""

    @cache
    def reduction() -> Reduction:
        return structure(Regressor(robot, BASELINE), robot.joints)

    reports = []
    for log in (next(chunks_of(log)) for log in logs):
        own = prepared and (prepared[0], [m for m in prepared[1] if m.source == log.source])
        reports.append(inspect(robot, log.select(robot.joints), reduction, alone=len(logs) == 1, prepared=own))
    return reports


def _refuse_worthless(reports: Sequence[LogReport]) -> None:
    """Stop at what is certain and leaves nothing to identify."""
    for report in reports:
        for issue in report.issues:
            if issue.blocks and issue.sure == "certain":
                raise InputError(f"{report.source}: {issue}. To go on all the same: --force (force=True)")


def _check_cutoff(cutoff: float | str | None, logs: Sequence[Data]) -> None:
    if not isinstance(cutoff, int | float):
        return
    for log in map(preview_of, logs):
        if cutoff >= log.rate / 2 * (1 - 1e-6):
            raise InputError(
                f"{log.source}: a cut-off of {cutoff:g} Hz is not below half its rate of {log.rate:.4g} Hz; take "
                "at most "
                f"{0.2 * log.rate:.3g} Hz, or --cutoff none (None) to filter nothing"
            )


def _filtering(lowpass: LowPass) -> str:
    if lowpass.cutoff is None:
        return f"nothing is low-passed ({lowpass.reason})"
    return f"torque and every regressor column low-passed at {lowpass.cutoff:g} Hz ({lowpass.reason})"


def _recursion(
    regressor: Regressor,
    motions: Iterable[Motion],
    lowpass: LowPass,
    rows: Sequence[str],
    reduction: Reduction,
    estimate: Estimate,
    variant: str,
    window: int | None,
    warnings: list[str],
) -> Recursion | None:
    """BBRF over the filtered rows, each joint's in units of its own residual."""
    if variant == "none":
        return None
    index = [regressor.robot.joints.index(n) for n in rows]
    blocks: list[Block] = []
    count = 0
    for block in (b for motion in motions for b in regressor.blocks(motion, lowpass)):
        if count + block.used[:, index].sum() > MOST_ROWS:
            warnings.append(f"BBRF looked at the first {count} rows only: every further one costs a matrix inverse")
            break
        blocks.append(block)
        count += int(block.used[:, index].sum())
    Y, tau, which = stack(blocks, regressor.robot, rows)
    weight = np.sqrt(estimate.weights)[which]
    p = len(reduction.base)
    E = np.column_stack([Y[:, list(reduction.base)], tau]) * weight[:, None]
    if window is None:
        window = min(max(1000, 20 * p), len(E) // 2)
        if window < p + 2:
            warnings.append(f"BBRF left out: {len(E)} rows are too few for two windows of more than {p + 2} rows")
            return None
    try:
        signs = [c.sign for c in estimate.columns]
        names = [c.name for c in estimate.columns]
        return bbrf(E, names, window=window, signs=signs, variant=cast(Variant, variant))
    except IdentifiabilityError as error:
        warnings.append(f"BBRF left out: {error}")
        return None


def _record(recursed: Recursion, estimate: Estimate) -> dict[str, Any]:
    """How the bounds closed in, few enough steps to be kept with the model: the first ones, then ever fewer."""
    count = len(recursed.steps)
    rows = np.unique(np.round(np.geomspace(1, max(count, 1), RECORDED)).astype(int) - 1)[: max(count, 0)]
    emptied = recursed.emptied
    return {
        "names": list(recursed.names),
        "units": [c.unit for c in estimate.columns],
        "variant": recursed.variant,
        "windows": recursed.windows,
        "emptied": None if emptied is None else {"parameter": emptied.parameter, "window": emptied.window},
        "steps": recursed.steps[rows].tolist(),
        "lower": [_digits(recursed.lower[i]) for i in rows],
        "upper": [_digits(recursed.upper[i]) for i in rows],
    }


def _digits(values: Array) -> list[float | None]:
    return [float(f"{x:.6g}") if np.isfinite(x) else None for x in values]


def _by_sensors(
    estimator: str,
    regressor: Regressor,
    motions: Iterable[Motion],
    lowpass: LowPass,
    rows: Sequence[str],
    reduction: Reduction,
    start: Estimate,
) -> tuple[Estimate, Box | None]:
    """Estimators that know which sensor the noise comes from."""
    if estimator == "iv":
        return iv(regressor, motions, lowpass, reduction.base, start), None
    if estimator == "eiv":
        return eiv(samples(regressor, motions, lowpass, rows, reduction.base), start.columns, rows), None
    names = [c.name for c in start.columns]
    data = sensor_moments(regressor, motions, lowpass, rows, reduction.base, names=names, weights=start.weights)
    found = sensorwise(data, limits=noise_limits(motions, regressor.robot, lowpass))
    notes = (*start.notes, *found.notes)
    return replace(start, theta=found.theta, covariance=found.covariance, estimator=estimator, notes=notes), found.box


def _doubts(triangle: Simplex, recursed: Recursion | None) -> list[str]:
    """What the theory assumes and this data do not give."""
    doubts = []
    if not triangle.same_orthant:
        names = triangle.disagreeing
        doubts.append(
            f"the classical Frisch box need not hold the truth: its Theorem 1 asks for {len(triangle.names) + 1} "
            f"least-squares solutions of equal signs, and {len(names)} parameters change theirs "
            f"({', '.join(names[:6])}{' ...' * (len(names) > 6)})"
        )
    if recursed is not None and recursed.emptied is not None:
        doubts.append(str(EmptyBoxError(*recursed.emptied)))
    return doubts


def _nrmse(whole: Gram, variance: Array) -> list[float]:
    spread = whole.torque_ss() / whole.counts
    return [float(np.sqrt(v / s)) for v, s in zip(variance, spread, strict=True)]


def box_of(identification: Identification) -> Box:
    """Return the narrowest box there is: BBRF's, or the one-shot Frisch box."""
    bounds = identification.model.bounds
    return bounds.get("bbrf", bounds["frisch"])
