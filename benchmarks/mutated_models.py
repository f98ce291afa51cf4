"""Edit a model file at random; every edit must be noticed, and none may end in another error than frischid's.

A model file is read in two states. As frischid wrote it, the file holds the hash of its content, and every edit must
be refused. Without the hash, as an editor's file may be, an edit may be used; a warning must then say that the file has
no hash, and the model must work or be refused in a sentence.

Half of the edits meet a model of torque logs: a prior, bounds of both kinds, an effect that was added, physical links.
The others meet one of commanded positions: a controller whose gain and delay were found, with their doubts, a limit, a
dead band, and a held-out log. Each kind of field (``parameters.#.value``) is edited equally often.

    python benchmarks/mutated_models.py                 1,000 edits in each state
    python benchmarks/mutated_models.py --edits 50000   the long run
"""

from __future__ import annotations

import copy
import json
import math
import random
import signal
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from common import parser, publish

import frischid as fr

LONGEST = 10  # s that an edited model may take
STATES = ("with its hash", "without a hash")


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--edits", type=int, default=1000)
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    with TemporaryDirectory() as folder:
        rows, notes = measure(given.edits, given.seed, Path(folder))
    publish(f"{given.edits} random edits of a model file, in each of two states", rows, given.json, notes)
    if any(row["unnoticed"] or row["other errors"] for row in rows):
        raise SystemExit("an edit passed unnoticed, or ended in another error than frischid's")


def measure(edits: int, seed: int, folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Outcomes by state, and every bad one in words."""
    subjects = [of_torques(folder), of_commands(folder)]
    kinds_of_fields = [by_kind(original) for original, _ in subjects]
    rows, notes = [], []
    for state in STATES:
        rng, outcomes = random.Random(seed), Counter[str]()
        for number in range(edits):
            (original, log), fields = subjects[number % 2], kinds_of_fields[number % 2]
            data = copy.deepcopy(original)
            if state == STATES[1]:
                del data["sha256"]
            edit = changed(data, fields, rng)
            outcome = tried(data, log, folder / "edited.json")
            if outcome == "used" or (outcome == "warned of" and state == STATES[0]):
                outcome = "unnoticed"
            outcomes[outcome.partition(":")[0]] += 1
            if outcome.startswith(("unnoticed", "other")):
                notes.append(f"{state}: {edit}: {outcome}")
        columns = ("refused", "warned of", "unnoticed", "other errors")
        many = len(set().union(*kinds_of_fields))
        rows.append({"state": state, "fields": many, "edits": edits} | {name: outcomes[name] for name in columns})
    return rows, notes or [
        "refused: an error of frischid names the field; warned of: used, after a warning that the file has no hash"
    ]


def of_torques(folder: Path) -> tuple[dict[str, Any], fr.Log]:
    """The file of a model of torques that has something of everything, and a log."""
    log = recorded(1)
    model = fr.add(fr.identify(ROBOT, [log]).model, SPRING, [log]).model
    fr.make_consistent(model).model.save(folder / "model.json")
    return json.loads((folder / "model.json").read_text(encoding="utf-8")), log


def of_commands(folder: Path) -> tuple[dict[str, Any], fr.Log]:
    """The file of a model of commanded positions, whose drives are partly unknown, and a log."""
    fitted, held_out = (as_commands(recorded(seed)) for seed in (1, 2))
    controller = fr.PDController(
        kp={"joint1": GAIN}, kd=DAMPING, limit={"joint1": 500.0}, dead_band={"joint1": 1e-5}, delay=None
    )
    model = fr.identify(ROBOT, [fitted], controller=controller).model
    fr.add(model, SPRING, [fitted], valid=[held_out]).model.save(folder / "model.json")
    return json.loads((folder / "model.json").read_text(encoding="utf-8")), held_out


ROBOT, SPRING = fr.Robot.load("planar2"), fr.parse_effects("joint_spring@joint2")
GAIN, DAMPING = 200.0, 1.0  # N·m/rad and N·m·s/rad


def recorded(seed: int) -> fr.Log:
    """A log of the arm with a spring."""
    return fr.simulate(
        ROBOT, fr.random_fourier(ROBOT, 8.0, seed=seed), rate=50, effects=(*fr.BASELINE, *SPRING), seed=seed,
        parameters={"ks2": 1.5}, noise=fr.Noise(q=1e-5, tau=0.01),
    )  # fmt: skip


def as_commands(log: fr.Log) -> fr.Log:
    """The log with commanded positions in the place of the torque, by a controller without delay."""
    assert log.tau is not None
    assert log.v is not None
    return replace(log, tau=None, v=None, qcmd=log.q + (log.tau + DAMPING * log.v) / GAIN)


Place = tuple[str | int, ...]


def by_kind(data: dict[str, Any]) -> dict[str, list[Place]]:
    """Paths of all values by kind of field: any member of a list, in any step of the model; the hash is left out."""
    found: dict[str, list[Place]] = {}
    for path in places(data):
        if path[0] != "sha256":
            kind = ".".join("#" if isinstance(x, int) else x for x in path)
            found.setdefault(kind.replace("previous.", ""), []).append(path)
    return found


def places(value: Any, path: Place = ()) -> Iterator[Place]:
    """Paths of all values inside a value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*path, key)
        yield from places(inner, (*path, key))


EDITS: dict[str, Callable[[Any, random.Random], Any]] = {
    "other number": lambda x, rng: x * rng.choice([1.01, -1, 1e6, 1e-6, 1e300]) if x else rng.choice([1, -1, 1e9]),
    "no number": lambda _, rng: rng.choice([math.nan, math.inf, -math.inf]),
    "other type": lambda _, rng: rng.choice([None, True, "text", [], {}, 0, -1, 1.5, [[]], {"a": 1}, 10**400]),
    "other text": lambda x, rng: rng.choice([x + "x", x[:-1], "", "joint1", "\x00", x.upper(), "../../etc/passwd"]),
    "order": lambda x, _: x[::-1],
    "once more": lambda x, rng: [*x, x[rng.randrange(len(x))]],
    "one less": lambda x, _: x[:-1],
    "nested deep": lambda _, __: json.loads("[" * 500 + "]" * 500),
}


def kinds(value: Any) -> list[str]:
    """Names of the edits that fit a value."""
    if isinstance(value, bool) or value is None:
        return ["other type"]
    if isinstance(value, int | float):
        return ["other number", "other number", "no number", "other type"]
    if isinstance(value, str):
        return ["other text", "other type"]
    if isinstance(value, list) and value:
        return ["order", "once more", "one less", "other type", "nested deep"]
    return ["other type", "nested deep"]


def changed(data: dict[str, Any], fields: dict[str, list[Place]], rng: random.Random) -> str:
    """Edit a model file's content at one of its places, and say how; the file says something else afterwards."""
    while True:
        *way, key = rng.choice(fields[rng.choice(list(fields))])
        place: Any = data
        for step in way:
            place = place[step]
        old = place[key]
        name = rng.choice([*kinds(old), "gone"]) if isinstance(place, dict) else rng.choice(kinds(old))
        if name == "gone":
            del place[key]
        else:
            new = EDITS[name](old, rng)
            if json.dumps(new) == json.dumps(old) or new == old:  # for the second: True is 1
                continue
            place[key] = new
        return f"{name} at {'.'.join(map(str, (*way, key)))}"


def tried(data: dict[str, Any], log: fr.Log, path: Path) -> str:
    """Outcome of a model file: it is loaded, held against a log, and exported."""
    path.write_text(json.dumps(data), encoding="utf-8")
    try:
        with limited(LONGEST), warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            model = fr.Model.load(path)
            warned = any("no hash" in str(warning.message) for warning in said)
            fr.compare(model, [log])
            fr.export(model, path.with_suffix(".c"), force=True)
            fr.export(model, path.with_name("drives.json"))
            model.save(path)
    except fr.FrischidError:
        return "refused"
    except TooLongError as error:
        return f"other errors: {error}"
    except Exception as error:  # whatever is not frischid's own error is what this script looks for
        return f"other errors: {type(error).__name__}: {str(error)[:150]}"
    return "warned of" if warned else "used"


class TooLongError(BaseException):
    """The time is over; no `except` of the tried code, which may wait for a `TimeoutError`, catches this."""


@contextmanager
def limited(seconds: int) -> Iterator[None]:
    """Interrupt what takes longer."""

    def late(*_: Any) -> None:
        raise TooLongError(f"longer than {seconds} s")

    signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)


if __name__ == "__main__":
    main()
