"""Random inputs for every surface that reads what others wrote; `tests/test_fuzz.py` and `benchmarks/fuzz.py` try them.

A *surface* turns an input into a result or an error of frischid's own. Whatever else comes out is a fault of frischid.
An input is either a good one with some edits (most bytes stay right, so the fault lies deep), or made up.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import numpy as np
from click.testing import CliRunner
from hypothesis import strategies as st

import frischid as fr
from frischid.cli import main
from frischid.effects import Formula, State
from frischid.logs.controller import PDController
from frischid.logs.driven import driven
from frischid.logs.mapping import LogMap
from frischid.logs.mapping_rules import DEFAULT_RULES, FILE_RULES, JOINT_RULES
from frischid.logs.readers import read_chunks, read_log, write_log
from frischid.logs.recording import Recording
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure

WORDS = ["nan", "inf", "-inf", "1e300", "-1e300", "1e-320", "0", "-1", "1e999", "", " ", "text", "0x10", "1,5",
         "9" * 40, "\x00", "é", "\u202e", "'", '"', "<", "&amp;", "&#10;", "]]>", "\n", "\r\n", ",", ";", "\t",
         "[", "]", "{", "}", "=", "true", "null", "joint1", "joint2", "q_joint1", "../..", "%s", "{joint}",
         "1979-05-27"]  # fmt: skip
"""Pieces of text that break parsers."""


@dataclass(frozen=True)
class Surface:
    """One door of frischid.

    Attributes
    ----------
    inputs : strategy
        Random inputs; each is a tuple of a file's name and its bytes, or any other value.
    attempt : callable
        Takes a folder and an input. Raises a `FrischidError` for an input that is refused.
    """

    inputs: st.SearchStrategy[Any]
    attempt: Callable[[Path, Any], None]


@cache
def robot() -> fr.Robot:
    return fr.Robot.load("planar2")


@cache
def log() -> fr.Log:
    return fr.simulate(robot(), fr.random_fourier(robot(), 4.0, seed=1), rate=50.0, noise=fr.Noise(q=1e-5, tau=0.01))


@cache
def model_json() -> str:
    """A model file with an effect that was added."""
    model = fr.identify(robot(), [log()], recursion="none").model
    return json.dumps(fr.add(model, fr.parse_effects("joint_spring@joint2"), [log()]).model.to_dict())


# ---- edits of texts and bytes


@st.composite
def edited(draw: Any, good: bytes) -> bytes:
    """Some bytes of a good file cut, doubled, moved, flipped, or replaced by words."""
    found = bytearray(good)
    for _ in range(draw(st.integers(1, 4))):
        size = len(found)
        place = draw(st.integers(0, size))
        length = draw(st.sampled_from([1, 2, 8, 64, size // 2]))
        match draw(st.sampled_from(["cut", "double", "flip", "word", "number", "end", "swap"])):
            case "cut":
                del found[place : place + length]
            case "double":
                found[place:place] = found[place : place + length]
            case "flip" if place < size:
                found[place] ^= draw(st.integers(1, 255))
            case "word":
                found[place:place] = draw(st.sampled_from(WORDS)).encode()
            case "number":  # another number in the place of one
                numbers = list(re.finditer(rb"-?\d+\.?\d*(e-?\d+)?", bytes(found[place : place + 300])))
                if numbers:
                    start, stop = numbers[0].span()
                    found[place + start : place + stop] = draw(st.sampled_from(WORDS)).encode()
            case "end":
                del found[place:]
            case "swap":
                other = draw(st.integers(0, size))
                found[place : place + length], found[other : other + length] = (
                    found[other : other + length], found[place : place + length],
                )  # fmt: skip
    return bytes(found)


@cache
def seeds() -> dict[str, bytes]:
    """Good logs in every format that can be written."""
    found = {}
    with TemporaryDirectory() as folder:
        for suffix in ("csv", "parquet", "npz"):
            path = Path(folder) / f"seed.{suffix}"
            write_log(log().slice(0, 40), path)
            found[suffix] = path.read_bytes()
    return found


@st.composite
def files(draw: Any) -> tuple[str, bytes]:
    """The suffix and the content of a log."""
    suffix = draw(st.sampled_from(["csv", "csv", "parquet", "npz", "mcap", "bag", "db3", "tsv"]))
    if suffix not in seeds() and draw(st.booleans()):
        return suffix, draw(st.binary(max_size=400))
    return suffix, draw(edited(seeds().get(suffix, seeds()["csv"])))


def try_log(folder: Path, given: tuple[str, bytes]) -> None:
    path = folder / f"log.{given[0]}"
    path.write_bytes(given[1])
    found = read_log(path, robot().joints)
    assert sum(map(len, read_chunks(path, robot().joints, samples=20))) == len(found)


# ---- robots


def urdf_text() -> bytes:
    return robot().urdf.encode()


@st.composite
def urdfs(draw: Any) -> bytes:
    """Edits of bytes, or of whole tags and attributes."""
    text = urdf_text().decode()
    if draw(st.booleans()):
        return draw(edited(text.encode()))
    for _ in range(draw(st.integers(1, 3))):
        found = list(re.finditer(r'"[^"]*"|<[^>]+>', text)) or list(re.finditer("", text))
        here = found[draw(st.integers(0, len(found) - 1))]
        word = draw(st.sampled_from([*WORDS, "1 2 3", "base", "link1", "revolute", "floating", "continuous", "mimic"]))
        other = draw(st.sampled_from(found))[0] if draw(st.booleans()) else word
        new = f'"{other.strip(chr(34))}"' if here[0].startswith('"') else other
        text = text[: here.start()] + new + text[here.end() :]
    return text.encode("utf-8", errors="surrogateescape")


def try_urdf(folder: Path, given: bytes) -> None:
    path = folder / "robot.urdf"
    path.write_bytes(given)
    found = fr.Robot.load(path)
    q = np.full((3, len(found.joints)), 0.3)
    assert np.isfinite(found.inverse_dynamics(q, q, q)).all()
    structure(Regressor(found, fr.BASELINE), found.joints)


# ---- mappings, models, formulas

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(WORDS) | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["a", "q", "joint1"]), inner, max_size=2)
    ),
    max_leaves=5,
)
KEYS = sorted({*FILE_RULES, *DEFAULT_RULES, *JOINT_RULES, "nothing"})
TABLE = st.dictionaries(
    st.sampled_from(KEYS), VALUES | st.sampled_from(["t", "deg", "ms", -1, 1, 0, "q_joint2"]), max_size=3
)
MAPPINGS = st.fixed_dictionaries(
    {},
    optional={
        "file": TABLE | VALUES, "default": TABLE, "current_gain": st.dictionaries(st.just("joint2"), VALUES),
        "joint": st.dictionaries(st.sampled_from(["joint1", "joint2", "elbow"]), TABLE | VALUES, max_size=2) | VALUES,
    },
)  # fmt: skip


def try_mapping(folder: Path, given: Any) -> None:
    path = folder / "map-log.csv"
    if not path.exists():
        write_log(log(), path)
    if isinstance(given, bytes):  # the text of a file
        (folder / "map.toml").write_bytes(given)
        given = folder / "map.toml"
    read_log(path, robot().joints, LogMap.of(given))


CONTROLLERS = st.dictionaries(
    st.sampled_from(["kp", "kd", "limit", "dead_band", "delay", "kp_doubt", "delay_doubt", "held", "nothing"]),
    st.floats(0.0, 1e3)
    | VALUES
    | st.dictionaries(st.sampled_from(["joint1", "joint2", "elbow"]), st.floats() | st.floats(0.0, 10.0) | VALUES),
    max_size=5,
)


def try_controller(folder: Path, given: Any) -> None:
    """A controller of a file or of Python drives a log, alone and by chunks, and describes itself."""
    if isinstance(given, bytes):  # the text of a file
        (folder / "gains.toml").write_bytes(given)
        controller = PDController.load(folder / "gains.toml")
    else:
        controller = PDController.from_dict(given)
    controller.check_joints(robot().joints)
    stored = controller.to_dict()
    assert PDController.from_dict(json.loads(json.dumps(stored))).to_dict() == stored, str(controller)
    commanded = replace(log(), tau=None, qcmd=log().q + 0.01)
    whole = controller.drive(commanded)
    assert np.isfinite(whole.tau).all()
    parts = Recording("log", lambda n: (commanded.slice(a, b) for a, b in ((0, n), (n, None))), lambda: "", None)
    driven_parts = driven([parts], controller)[0]
    assert isinstance(driven_parts, Recording)
    assert np.allclose(np.concatenate([part.tau for part in driven_parts.read(100)]), whole.tau)


@st.composite
def models(draw: Any) -> str:
    """A model with values replaced, removed or doubled; without the hash, so that the edit itself is met."""
    data = json.loads(model_json())
    data.pop("sha256", None)
    for _ in range(draw(st.integers(1, 2))):
        place, path = data, []
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = draw(st.sampled_from(keys))
            path.append(key)
            if isinstance(place[key], dict | list) and place[key] and draw(st.integers(0, 3)):
                place = place[key]
                continue
            match draw(st.sampled_from(["value", "value", "scale", "gone", "double"])):
                case "value":
                    place[key] = draw(VALUES)
                case "scale" if isinstance(place[key], float):
                    place[key] *= draw(st.sampled_from([-1.0, 1.01, 1e6, 1e-6, 1e90, 1e300]))
                case "gone":
                    del place[key]
                case "double" if isinstance(place, list):
                    place.append(place[key])
            break
    return json.dumps(data)


def try_model(folder: Path, given: str | bytes) -> None:
    path = folder / "model.json"
    path.write_bytes(given if isinstance(given, bytes) else given.encode("utf-8", errors="surrogatepass"))
    model = fr.Model.load(path)
    fr.compare(model, [log()])
    fr.export(model, folder / "out.c", force=True)
    model.save(path)


TOKENS = ["q", "v", "a", "q2", "v1", "load", "tau_model", "t", "pi", "temperature", "sin(", "exp(", "log(", "sqrt(",
          "abs(", "sign(", "tanh(", "(", ")", "+", "-", "*", "/", "**", "1", "2.5", "1e99", "1e-300", "0", ".", ",",
          "x", " ", "j", "'", "[", "]", "lambda", ":", "if", "__class__", "é", "\x00", "\n"]  # fmt: skip
FORMULAS = st.lists(st.sampled_from(TOKENS), max_size=14).map("".join) | st.text(max_size=30)


def try_formula(folder: Path, given: str) -> None:
    q, v, a, load, torque = np.random.default_rng(0).normal(size=(5, 6, 2))
    state = State(robot(), np.arange(6.0), q, v, a, load, torque, 0.0, {"temperature_joint1": np.arange(6.0)})
    for term in Formula(("joint1",), expression=given).terms(state):
        assert all(np.isfinite(x).all() for x in term.rows.values())


# ---- the command line

NOT_TRIED = {"studio", "demo", "doctor", "fetch", "paper"}  # one never ends, three are slow, one needs a network
SLOW = {"workers": "1", "starts": "1", "budget": "20", "max_steps": "1", "scheduler": "none", "diagnosed": "0"}
GOOD = {"model": "model.json", "robot": "robot.urdf", "logs": "log.csv", "log": "log.csv", "unloaded": "log.csv",
        "loaded": "log.csv", "payload": "1", "effect": "viscous", "output": "out.json", "name": "viscous"}  # fmt: skip
ARGUMENTS = [*WORDS, "none", "auto", "1", "5", "a=b", "joint*", "*", "joint2=0.3", "m1=1", "out.c", "out.csv",
             "log.csv", "model.json", "robot.urdf", "missing.csv", ".", "/dev/null", "coulomb", "stribeck@joint2", "@",
             "1e-9", "99999999999999999999", "-h", "--json"]  # fmt: skip


@st.composite
def lines(draw: Any) -> list[str]:
    """A command with its required arguments, and some others with any text."""
    name = draw(st.sampled_from(sorted(set(main.commands) - NOT_TRIED)))
    found = [name]
    for option in main.commands[name].params:
        chosen = draw(st.integers(0, 9)) < 2
        if not (option.required or chosen or option.name in SLOW):
            continue
        count = 1 if option.nargs < 0 else option.nargs
        good = SLOW.get(str(option.name), GOOD.get(str(option.name), draw(st.sampled_from(ARGUMENTS))))
        values = [
            draw(st.sampled_from(ARGUMENTS)) if chosen and option.name not in SLOW else good for _ in range(count)
        ]
        if isinstance(option, click.Option):
            found.append(option.opts[-1])
            values = [] if option.is_flag else values
        found += values
    return found


def try_line(folder: Path, given: list[str]) -> None:
    for path, write in {
        "log.csv": lambda p: write_log(log(), p), "robot.urdf": lambda p: p.write_bytes(urdf_text()),
        "model.json": lambda p: p.write_text(model_json(), encoding="utf-8"),
    }.items():  # fmt: skip
        if not (folder / path).is_file():
            write(folder / path)
    done = CliRunner().invoke(main, given)
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code in (0, 1, 2), done.exit_code
    assert done.exit_code != 2 or done.stderr, "an error without a sentence"


SURFACES = {
    "log": Surface(files(), try_log),
    "urdf": Surface(urdfs(), try_urdf),
    "mapping": Surface(MAPPINGS, try_mapping),
    "model": Surface(models(), try_model),
    "controller": Surface(CONTROLLERS, try_controller),
    "formula": Surface(FORMULAS, try_formula),
    "line": Surface(lines(), try_line),
}
