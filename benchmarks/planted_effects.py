"""Effects planted in measured logs of real robots, for the diagnosis to name beside the robots' own effects.

Needs FRISCHID_DATA. The torque of a hidden effect (`hidden_shapes`, `hidden_unknown`: the same makers as in the
simulated benchmark, along the measured motion) is added to the measured torque, in two ways:

- *always*: to all logs. The model is identified from all logs but the last, and diagnosed on all of them.
- *changed*: to the last log only. The model is identified from the other logs, and diagnosed on the last, as `frischid
  diagnose` does: the model's own logs are files, and are found again. Other friction and another torque offset are
  planted here alone, because a model of all logs has them.

`planted_answers` says which answers are right. Gears are left out, because they need a motion of their own. In the
situation *always*, a payload, a tilt, a gain and a delay are left out too, because the model absorbs them.

`--rows FILE` writes each case as soon as it is done, with the evidence of its hypotheses, and reads the cases that are
done already. `--minutes` ends the run when the time is over: the cases are in a random order, so a run cut short is a
fair sample of them.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from calibration import reliability
from common import data_folder, parser, publish
from hidden_cases import EFFECTS
from hidden_parts import CHANNELS, GEARS, LEAST_VISIBLE, TRIES, Baseline, acting
from hidden_physics import STEP, Array, Drive, World, direction, rms, rnea
from hidden_physics import Path as Motion
from hidden_shapes import SHAPES, SMALL, Hidden
from hidden_unknown import UNKNOWN
from planted_answers import by_chance, case_of, counted, in_words, judged, judged_alone, said
from real_robots import CASES, Case
from scipy.signal import butter, sosfiltfilt

import frischid as fr
from frischid.diagnosis.roles import diagnose_in_roles
from frischid.logs.readers import write_log

SMOOTH = 8.0
"""Hz. Of a measured motion, only lower frequencies count as motion."""
STRANGE = [name for name in UNKNOWN if name != "random_walk"]
KINDS = (
    "none",
    *(name for name in EFFECTS if name not in GEARS),
    "contact",
    *STRANGE,
)


def friction_change(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """More viscous and dry friction than before."""
    dry, scale = rng.uniform(0.2, 1.0), rms(fit.path.v)[j]
    return Hidden(
        lambda w: w.on(j, dry * w.sign[:, j] + (1 - dry) * w.path.v[:, j] / scale), (j,), f"{dry:.0%} of it dry"
    )


def offset_change(rng: np.random.Generator, fit: World, j: int) -> Hidden:
    """Another torque offset than before."""
    way = rng.choice([-1.0, 1.0])
    return Hidden(lambda w: w.on(j, np.full(len(w.path.t), way)), (j,), f"{way:+.0f}")


PARAMETERS = {"friction_change": friction_change, "offset_change": offset_change}
"""Changes of parameters that a model has."""
SITUATIONS = {"always": [k for k in KINDS if k not in EFFECTS or k in SMALL], "changed": [*KINDS, *PARAMETERS]}
DELAY = 0.1
"""s of delay per unit of size."""


@dataclass(frozen=True)
class Job:
    """The effect to plant and its place; `size` is a share of the joint's torque."""

    robot: int
    kind: str
    situation: str
    size: float
    seed: int


def world(log: fr.Log, robot: fr.Robot, number: int, drive: Drive | None) -> World:
    """The measured motion, smoothed, with the torque of the URDF's links."""
    t = np.arange(log.t[0], log.t[-1], STEP)
    low = butter(4, SMOOTH, fs=1 / STEP, output="sos")
    q = np.stack([sosfiltfilt(low, np.interp(t, log.t, x)) for x in log.q.T], axis=1)
    v = np.gradient(q, STEP, axis=0)
    path = Motion(t - t[0], q, v, np.gradient(v, STEP, axis=0))
    load = rnea(robot.model, robot, path)
    drive = drive or Drive.plausible(np.random.default_rng(0), path, load)
    sign = direction(v)
    return World(robot.model, robot, path, drive, load, load + drive.torque(path, sign), sign, number)


def planted(
    kind: str, size: float, logs: Sequence[fr.Log], robot: fr.Robot, fitted: Sequence[int], rng: np.random.Generator
) -> tuple[list[fr.Log], str]:
    """Logs with a planted effect, and a description of the effect."""
    if kind == "none":
        return list(logs), "–"
    scale = np.full(len(robot.joints), np.inf)
    scale[fitted] = np.concatenate([log.tau for log in logs])[:, fitted].std(axis=0)
    if kind in CHANNELS:
        j = int(rng.choice(fitted))
        added = []
        for log in logs:
            x = np.array(log.tau)
            if kind == "drive_gain":
                x[:, j] *= 1 + size * scale[j] / float(np.sqrt((x[:, j] ** 2).mean()))
            else:
                x[:, fitted] = np.stack([np.interp(log.t - DELAY * size, log.t, x[:, k]) for k in fitted], axis=1)
            added.append(x - log.tau)
        detail = robot.joints[j] if kind == "drive_gain" else f"{1e3 * DELAY * size:.0f} ms"
    else:
        worlds = [world(logs[0], robot, 0, None)]
        worlds += [world(log, robot, 0, worlds[0].drive) for log in logs[1:]]
        hidden, torque = drawn(kind, size, worlds, scale, fitted, rng)
        added = [
            np.stack([np.interp(log.t - log.t[0], w.path.t, y) for y in x.T], axis=1)
            for log, w, x in zip(logs, worlds, torque, strict=True)
        ]
        detail = f"{', '.join(robot.joints[j] for j in hidden.joints) or 'the robot'}: {hidden.detail}"
    return [altered(log, x) for log, x in zip(logs, added, strict=True)], detail


def drawn(
    kind: str, size: float, worlds: Sequence[World], scale: Array, fitted: Sequence[int], rng: np.random.Generator
) -> tuple[Hidden, list[Array]]:
    """An effect of the job's size on a joint with measured torque, drawn until the model does not absorb too much."""
    baseline, best = Baseline(worlds[:1], scale), (-1.0, None, list[Array]())
    for _ in range(TRIES):
        found = (SHAPES | UNKNOWN | PARAMETERS)[kind](rng, worlds[0], int(rng.choice(fitted)))
        counted = [(found.size or found.torque)(w) for w in worlds]
        factor = size / float((acting(counted) / scale).max())
        torque = [factor * found.torque(w) for w in worlds]
        seen = float(baseline.left(torque[0]).max())
        if seen > best[0]:
            best = seen, found, torque
        if seen > LEAST_VISIBLE * size:
            break
    assert best[1] is not None
    return best[1], best[2]


def altered(log: fr.Log, added: Array) -> fr.Log:
    """The log with some torque added to the measured one."""
    return replace(log, tau=log.tau + added, source=f"{log.source}, altered", sha256=None)


def run(job: Job) -> dict[str, Any]:
    """Plant, diagnose, and keep the findings."""
    folder = data_folder()
    assert folder is not None
    case = CASES[job.robot]
    whole = fr.Robot.load(folder / case.urdf)
    fit, valid = (read(case, folder, whole, paths) for paths in (case.fit, case.valid))
    model = fr.identify(whole, fit, torque_joints=case.torque_joints, recursion="none").model
    robot, fitted = model.robot, list(model.torque_index)
    rng = np.random.default_rng(
        [job.seed, job.robot, SITUATIONS["changed"].index(job.kind), list(SITUATIONS).index(job.situation)]
    )
    logs = [log.select(robot.joints) for log in [*fit, *valid]]
    if job.situation == "always":
        logs, detail = planted(job.kind, job.size, logs, robot, fitted, rng)
        fit, valid = logs[: len(fit)], logs[len(fit) :]
        model = fr.identify(whole, fit, torque_joints=case.torque_joints, recursion="none").model
        found = fr.diagnose(model, logs)
    else:
        with TemporaryDirectory() as folder_of_logs:
            fit = written(logs[: len(fit)], Path(folder_of_logs))
            model = fr.identify(whole, fit, torque_joints=case.torque_joints, recursion="none").model
            logs, detail = planted(job.kind, job.size, logs[len(fit) :], robot, fitted, rng)
            found = diagnose_in_roles(model, logs)
    said = [(f.effect, *f.confused_with) for f in found.findings if f.significant or not f.members]
    return {
        "job": asdict(job),
        "robot": case.name,
        "situation": job.situation,
        "kind": job.kind,
        "truth": "unknown" if job.kind in UNKNOWN else job.kind,
        "planted": detail,
        "verdict": found.verdict,
        "assumed": found.situation,
        "said": said,
        "joints": [list(f.joints) for f in found.findings if f.significant or not f.members],
        "answer": (best := max(found.probabilities, key=found.probabilities.__getitem__)),
        "probability": found.probabilities[best],
        "error": found.error,
        "evidence": found.evidence.to_dict(),
        "contacts": [vars(c) for c in found.contacts],
    }


def written(logs: Sequence[fr.Log], folder: Path) -> list[fr.Log]:
    """The same logs, read from files."""
    paths = [folder / f"{number}.parquet" for number in range(len(logs))]
    for log, path in zip(logs, paths, strict=True):
        write_log(log, path)
    return [fr.read_log(path, log.joints) for log, path in zip(logs, paths, strict=True)]


def read(case: Case, folder: Path, robot: fr.Robot, paths: Sequence[str]) -> list[fr.Log]:
    return [fr.read_log(folder / path, robot.joints, case.mapping) for path in paths]


def collected(jobs: Sequence[Job], path: Path | None, workers: int, minutes: float) -> list[dict[str, Any]]:
    """Rows of the jobs in their order, of a file and of new runs; jobs that start after `minutes` are left out."""
    end = time.monotonic() + 60 * minutes
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path is not None and path.exists() else []
    rows = [row for row in rows if Job(**row["job"]) in jobs]
    done = [Job(**row["job"]) for row in rows]
    missing = [job for job in jobs if job not in done]
    with ProcessPoolExecutor(workers) as pool:
        for start in range(0, len(missing), workers):
            if time.monotonic() > end:
                break
            new = list(pool.map(run, missing[start : start + workers]))
            rows += new
            if path is not None:
                with path.open("a") as file:
                    file.writelines(json.dumps(row, ensure_ascii=False) + "\n" for row in new)
    return rows


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--size", type=float, default=0.12, help="share of the joint's torque")
    options.add_argument("--seed", type=int, nargs="+", default=[0])
    options.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options.add_argument("--rows", type=Path, metavar="FILE", help="cases that are done, one a line")
    options.add_argument("--minutes", type=float, default=float("inf"), help="start no case after this time")
    options.add_argument("--robots", nargs="+", choices=[case.name for case in CASES], help="only these robots")
    chosen = options.parse_args()
    if data_folder() is None:
        sys.exit("set FRISCHID_DATA to the folder of the measured logs")
    jobs = [
        Job(robot, kind, situation, chosen.size, seed)
        for seed in chosen.seed
        for robot, case in enumerate(CASES)
        if case.name in (chosen.robots or [case.name])
        for situation, kinds in SITUATIONS.items()
        for kind in kinds
    ]
    order = np.random.default_rng(chosen.seed[0]).permutation(len(jobs))
    jobs = sorted((jobs[int(k)] for k in order), key=lambda job: job.kind != "none")  # the robots' own findings first
    rows = collected(jobs, chosen.rows, chosen.workers, chosen.minutes)
    groups = {(case.name, situation): [] for case in CASES for situation in SITUATIONS}
    for row in rows:
        groups[case_of(row)].append(row)
    groups = {of: here for of, here in groups.items() if here}
    total = [said(row) for here in groups.values() for row in here]
    answers, alone, reliable = judged(rows), judged_alone(rows), list[dict[str, Any]]()
    notes = [
        f"seeds {', '.join(map(str, chosen.seed))}; {len(answers)} planted effects, terms and contacts",
        in_words(answers),
        by_chance(answers),
        "With the rivals of the robot's own first finding as right answers too: " + in_words(judged(rows, rivals=True)),
        f"Without the {len(answers) - len(alone)} answers that stand there without a planted effect too: "
        + in_words(alone),
        by_chance(alone),
    ]
    table = [counted(here) for here in groups.values()]
    publish(f"effects of {chosen.size:.0%} planted in measured logs", table, chosen.json, notes)
    for name in [*dict.fromkeys(robot for robot, *_ in answers), "all"]:
        reliable += reliability(name, [x for x in answers if name in (x[0], "all")])
    publish("probability said, and share that was right", reliable, None)
    publish("findings, planted effect by planted effect", total, None)


if __name__ == "__main__":
    main()
