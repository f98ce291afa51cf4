"""The package of examples/my_effect, really installed: its effect is known to every command, and to nobody before."""

import json
import os
import re
import shlex
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import SimpleNamespace

import pytest

import frischid

ROOT = Path(frischid.__file__).parents[1]
PACKAGE = ROOT / "examples" / "my_effect"

HIDE = """
import frischid as fr
from frischid.logs.readers import write_log

robot = fr.Robot.load("planar2")
hidden = fr.parse_effects("magnetic_detent(position=0.6, width=0.3)@joint2")
values = {"md2": 3.0, "fv1": 2.0, "fv2": 1.0, "fc1": 1.0, "fc2": 0.5}
for seed in (1, 2):
    motion, noise = fr.random_fourier(robot, 20, seed=seed), fr.Noise(q=1e-5, tau=0.01)
    effects = (*fr.BASELINE, *hidden)
    log = fr.simulate(
        robot, motion, rate=100.0, effects=effects, parameters=values, noise=noise, channels=(), seed=seed
    )
    write_log(log, f"log{seed}.parquet")
log = fr.read_log("log1.parquet", robot.joints)
fr.identify(robot, [log], effects=(*fr.BASELINE, *hidden), recursion="none").model.save("knows.json")
fr.identify(robot, [log], recursion="none").model.save("lacks.json")
"""

STUDIO = """
from pathlib import Path
from unittest.mock import MagicMock

import frischid as fr
from frischid.studio.bench import Bench
from frischid.studio.findings import Findings

model = fr.Model.load("lacks.json")
bench = Bench(model, [fr.read_log(f"log{k}.parquet", model.robot.joints) for k in (1, 2)], Path("studio.json"))
bench.diagnose()
finding, gui = bench.state.diagnosis.findings[0], MagicMock()
Findings(gui, MagicMock(), bench, MagicMock(), MagicMock(), MagicMock()).show(bench.state)
print(gui.add_button.call_args_list[0].args[0])
print(gui.add_markdown.call_args_list[1].args[0])
bench.add(finding.members, 0, finding)
print(fr.Model.load(bench.save()).effects[-1])
"""


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """A virtual environment with frischid and what frischid needs; no package of effects."""
    path = tmp_path_factory.mktemp("clean")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", path / "venv"], check=True)
    python = path / "venv" / "bin" / "python"
    site = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        capture_output=True, text=True, check=True,
    ).stdout.strip()  # fmt: skip
    others = [f"import site; site.addsitedir({sysconfig.get_path(k)!r})" for k in ("purelib", "platlib")]
    Path(site, "others.pth").write_text("\n".join([str(ROOT), *dict.fromkeys(others)]) + "\n", encoding="utf-8")
    surroundings = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}

    def run(*arguments, fails=False, folder=path):
        done = subprocess.run(
            [python, *map(str, arguments)], cwd=folder, capture_output=True, text=True, env=surroundings
        )
        assert (done.returncode != 0) == fails, done.stdout + done.stderr
        return done.stderr if fails else done.stdout

    return SimpleNamespace(path=path, python=python, run=run, cli=lambda *a, **k: run("-m", "frischid", *a, **k))


@pytest.fixture(scope="module")
def installed(clean):
    """The same with the example package, two logs that hide its effect, and a model with and without the effect."""
    assert "magnetic_detent" not in clean.cli("effects")
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", clean.python, "install", "--quiet", "--no-deps", "--no-index",
         "--no-build-isolation", "--disable-pip-version-check", PACKAGE],
        check=True,
    )  # fmt: skip
    clean.run("-c", HIDE)
    return clean


def test_the_module_is_short():
    assert len((PACKAGE / "my_effect.py").read_text(encoding="utf-8").splitlines()) < 40


def test_the_catalogue_lists_it_and_its_package(installed):
    listed = {e["effect"]: e["package"] for e in json.loads(installed.cli("effects", "--json"))}
    assert listed.pop("magnetic_detent") == {"name": "my-effect", "version": "0.1.0"}
    assert set(listed.values()) == {None}
    assert "package my-effect 0.1.0" in installed.cli("effects", "magnetic_detent")


def test_a_saved_model_opens_on_the_command_line(installed):
    saved = json.loads((installed.path / "knows.json").read_text(encoding="utf-8"))
    assert saved["effects"][-1]["package"] == {"name": "my-effect", "version": "0.1.0"}
    knows, lacks = (
        json.loads(installed.cli("compare", f"{m}.json", "log2.parquet", "--json")) for m in ("knows", "lacks")
    )
    assert knows["headline"]["nrmse"] < 0.2 * lacks["headline"]["nrmse"]


def test_diagnose_names_it_first(installed):
    found = json.loads(installed.cli("diagnose", "lacks.json", "log1.parquet", "--valid", "log2.parquet", "--json"))
    assert found["verdict"] == "effect"
    assert (found["findings"][0]["effect"], found["findings"][0]["joints"]) == ("magnetic_detent", ["joint2"])
    assert found["findings"][0]["parameters"]["position"] == pytest.approx(0.6, abs=0.02)
    assert found["findings"][0]["parameters"]["width"] == pytest.approx(0.3, abs=0.02)


def test_the_commands_of_its_readme(installed):
    """In the README's order, from a folder without files; the report and the studio have tests below."""
    steps = re.findall(r"`frischid ([^`]+)`", (PACKAGE / "README.md").read_text(encoding="utf-8"))
    commands = [shlex.split(c) for c in dict.fromkeys(steps) if not c.startswith(("report", "studio"))]
    assert [c[0] for c in commands] == ["effects", "simulate", "identify", "diagnose", "add", "compare"]
    folder = installed.path / "readme"
    folder.mkdir()
    said = {c[0]: " ".join(installed.cli(*c, folder=folder).split()) for c in commands}
    assert "joint2 is pulled towards one position, but only near that position: a magnetic detent" in said["diagnose"]
    assert "position = 0.6 rad, width = 0.3 rad" in said["diagnose"]
    assert "magnetic_detent(position=0.6, width=0.3)@joint2 added" in said["add"], "the shape that diagnose finds"


def test_the_report_shows_it(installed):
    installed.cli("report", "lacks.json", "log1.parquet", "log2.parquet", "-o", "page.html")
    page = (installed.path / "page.html").read_text(encoding="utf-8")
    assert "pulled towards one position, but only near that position: a magnetic detent" in page
    assert "magnetic_detent: Magnetic detent: two magnets pull the joint to one position" in page


def test_the_studio_offers_and_adds_it(installed):
    pytest.importorskip("viser", reason="the extra frischid[studio] is not installed")
    label, text, added = installed.run("-c", STUDIO).strip().splitlines()
    assert label.startswith("Add magnetic_detent")
    assert "a magnetic detent" in text
    assert added.startswith("magnetic_detent(position=0.")


def test_without_the_package_the_model_says_what_to_install(installed):
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", installed.python, "uninstall", "--quiet", "-y", "my-effect"],
        check=True,
    )
    said = " ".join(installed.cli("compare", "knows.json", "log2.parquet", fails=True).split())
    assert "effect 'magnetic_detent' comes from the package my-effect 0.1.0, which is not installed" in said
    assert "pip install my-effect" in said
