"""Export models whose robot, joints and links have hostile names, and read, compile and run what was written.

Each model is exported as C, Python, MJCF and URDF. A file passes if

1. it differs from the file of the same model with plain names only where names stand (`tests/hostile_names.py`);
2. its own program reads it: Python imports it, MuJoCo and frischid load it, and gcc compiles the C with `-Wall -Wextra
   -Wconversion -Werror` and with its sanitizers of addresses and undefined behaviour;
3. Python and C compute the torque of the model, and C ends without a word of the sanitizers.

    python benchmarks/exported_names.py                 10,000 names
    python benchmarks/exported_names.py --names 500
"""

from __future__ import annotations

import importlib.util
import random
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
from common import parser, publish

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from hostile_names import c_skeleton, names, python_skeleton, renamed, xml_skeleton

import frischid as fr
from frischid.export.names import identifier

TOGETHER = 25  # models in one C program
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")
SANE = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
FORMATS = {".c": "C", ".py": "Python", ".xml": "MJCF", ".urdf": "URDF"}
CLOSE = 1e-9  # of the largest torque
STATES = np.random.default_rng(0).normal(size=(3, 4, 2))


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--names", type=int, default=10_000)
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    with TemporaryDirectory() as folder:
        rows, notes = measure(given.names, given.seed, Path(folder))
    publish(f"{given.names} hostile names", rows, given.json, notes)
    if any(row["other code"] for row in rows):
        sys.exit("a name became code, or a file is not read by its program")


def measure(count: int, seed: int, folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """Files by format, and every bad one in words."""
    plain, rng = subject(), random.Random(seed)
    called = [*plain.robot.joints, *(link.get("name") for link in ET.fromstring(plain.robot.urdf).findall("link"))]
    skeletons = {suffix: skeleton(written(plain, folder, suffix), plain.robot.name) for suffix in FORMATS}
    every = names(rng, count)
    faults: dict[str, list[str]] = {suffix: [] for suffix in FORMATS}
    models: list[fr.Model] = []
    while every:
        others, every = every[: len(called)], every[len(called) :]
        title = f"{every.pop() if every else ''}r{len(models)}"  # no two prefixes in a C program are the same
        models.append(renamed(plain, title, dict(zip(called, others, strict=False))))
    for start in range(0, len(models), TOGETHER):
        some = models[start : start + TOGETHER]
        for model in some:
            for suffix in (".py", ".xml", ".urdf"):
                fault = tried(model, folder, suffix, skeletons[suffix])
                faults[suffix] += [fault] if fault else []
        faults[".c"] += compiled(some, folder, skeletons[".c"])
    rows = [
        {"format": FORMATS[suffix], "names": count, "files": len(models), "other code": len(found)}
        for suffix, found in faults.items()
    ]
    notes = [f"{FORMATS[suffix]}: {fault}" for suffix, found in faults.items() for fault in found]
    return rows, notes or ["every file differs from that of plain names only where names stand, is read and computes"]


def subject() -> fr.Model:
    """An arm with friction, as physical links."""
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 8.0, seed=1), rate=50.0, noise=fr.Noise(tau=0.01))
    return fr.make_consistent(fr.identify(robot, [log], recursion="none").model).model


def written(model: fr.Model, folder: Path, suffix: str) -> str:
    """Text of an exported model."""
    path = folder / f"robot{suffix}"
    fr.export(model, path, force=True)
    return path.read_text(encoding="utf-8")


def skeleton(text: str, title: str) -> Any:
    """An exported file's text without names."""
    if text.startswith("/*"):
        return c_skeleton(text, title)
    return xml_skeleton(text) if text.lstrip().startswith("<") else python_skeleton(text)


def tried(model: fr.Model, folder: Path, suffix: str, expected: Any) -> str:
    """What is wrong with an exported file, in words; empty for a good one."""
    joints = list(model.robot.joints)
    try:
        text = written(model, folder, suffix)
        if skeleton(text, model.robot.name) != expected:
            return f"{joints!r}: a name changed the file beyond names"
        path = folder / f"robot{suffix}"
        if suffix == ".py":
            found = list(imported(path).JOINTS)
            torque = imported(path).inverse_dynamics(*STATES)
            if far(torque, model):
                return f"{joints!r}: another torque"
        elif suffix == ".xml":
            loaded = mujoco.MjModel.from_xml_path(str(path))
            found = [loaded.joint(i).name for i in range(loaded.njnt)]
        else:
            found = list(fr.Robot.load(path).joints)
    except Exception as error:  # whatever happens is what this script looks for
        return f"{joints!r}: {type(error).__name__}: {str(error)[:200]}"
    return "" if found == joints else f"{joints!r}: read as {found!r}"


def imported(path: Path) -> ModuleType:
    """The exported Python."""
    spec = importlib.util.spec_from_file_location("control", path)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def far(torque: Any, model: fr.Model) -> bool:
    """Whether a torque differs from the model's."""
    expected = model.inverse_dynamics(*STATES)
    return bool(np.abs(np.asarray(torque) - expected).max() > CLOSE * np.abs(expected).max())


def compiled(models: Sequence[fr.Model], folder: Path, expected: str) -> list[str]:
    """What is wrong with the C of some models, which become one program that prints their torques."""
    faults, calls, includes = [], [], []
    states = ",\n".join(f"    {{{', '.join(map(repr, row))}}}" for row in np.concatenate([*STATES], axis=1).tolist())
    for k, model in enumerate(models):
        text, prefix = written(model, folder, ".c"), identifier(model.robot.name).lower()
        if c_skeleton(text, model.robot.name) != expected:
            faults.append(f"{list(model.robot.joints)!r}: a name changed the file beyond names")
        (folder / f"robot{k}.c").write_text(text, encoding="utf-8")
        includes.append(f'#include "robot{k}.c"')
        calls.append(
            f"    for (i = 0; i < 4; i++) {prefix}_inverse_dynamics(x[i], x[i] + 2, x[i] + 4, tau), show(tau);"
        )
        calls.append(f"    {prefix}_friction(x[0], x[0] + 2, tau);")
    program = "\n".join((
        "#include <stdio.h>", *includes, "static const double x[4][6] = {", states, "};",
        'static void show(const double *tau) { printf("%.17g %.17g\\n", tau[0], tau[1]); }',
        "int main(void) {", "    double tau[2];", "    int i;", *calls, "    return 0;", "}", "",
    ))  # fmt: skip
    (folder / "main.c").write_text(program, encoding="utf-8")
    command = ["gcc", *STRICT, *SANE, str(folder / "main.c"), "-o", str(folder / "main"), "-lm"]
    for step in (command, [str(folder / "main")]):
        done = subprocess.run(step, capture_output=True, text=True, check=False)
        if done.returncode or done.stderr:
            return [*faults, f"{Path(step[0]).name} of models {models[0].robot.name!r} ...: {done.stderr[:500]}"]
    torques = np.array([line.split() for line in done.stdout.splitlines()], dtype=float).reshape(len(models), 4, 2)
    wrong = (model for model, found in zip(models, torques, strict=True) if far(found, model))
    return [*faults, *(f"{list(model.robot.joints)!r}: another torque" for model in wrong)]


if __name__ == "__main__":
    main()
