"""Blocks that no shell runs hold too: the JSON keys, the C loop, and what is printed about a measured UR10e."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.logs.mapping_rules import DEFAULT_RULES, FILE_RULES, JOINT_RULES
from frischid.logs.readers import write_log

DOCS = Path(__file__).parents[2] / "docs"


def block(page, kind):
    return re.search(rf"```{kind}\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), flags=re.DOTALL)[1]


def small_model(effects="viscous, coulomb"):
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=100.0, noise=fr.Noise(tau=0.01))
    return fr.identify(robot, [log], effects=fr.parse_effects(effects), recursion="none").model, log


def test_the_page_on_json_shows_the_keys_of_a_headline():
    shown = json.loads(block("reference/json.md", "json"))
    model, log = small_model()
    assert set(shown) == set(fr.headline(model, [log]).to_dict())
    assert set(shown["alarms"][0]) == {"id", "severity", "sentence", "remedy", "joints", "value", "limit"}


@pytest.mark.skipif(not shutil.which("cc"), reason="no C compiler")
def test_the_loop_of_the_page_on_export_compiles(tmp_path):
    model, _ = small_model("viscous, hysteresis")
    fr.export(model, tmp_path / "control.c")
    loop = block("guides/export.md", "text").replace("robot_", "planar2_")
    caller = f"void loop(const double *q, const double *v, const double *a, double dt, double *tau) {{\n{loop}}}\n"
    (tmp_path / "loop.c").write_text(f'#include "control.c"\n{caller}', encoding="utf-8")
    subprocess.run(["cc", "-std=c99", "-Wall", "-Werror", "-c", "loop.c"], cwd=tmp_path, check=True)


@pytest.mark.skipif(not os.environ.get("FRISCHID_DATA"), reason="no measured logs")
def test_the_urdf_of_the_page_on_emps_gives_the_figures_of_the_page(tmp_path):
    (tmp_path / "emps.urdf").write_text(block("robots/emps.md", "xml"), encoding="utf-8")
    robot = fr.Robot.load(tmp_path / "emps.urdf")
    folder = Path(os.environ["FRISCHID_DATA"]) / "emps" / "logs"
    log, test = (fr.read_log(folder / f"{name}.parquet", robot.joints) for name in ("train", "test_pulses"))
    found = fr.identify(robot, [log], valid=[test], recursion="none").headline
    page = (DOCS / "robots" / "emps.md").read_text(encoding="utf-8")
    assert f"| identified | {found.nrmse:.4f} |" in page
    assert f"| URDF's links with fitted friction | {found.urdf_nrmse:.4f} |" in page


@pytest.mark.skipif(not os.environ.get("FRISCHID_DATA"), reason="no measured logs")
def test_what_the_guides_print_about_a_ur10e(tmp_path, monkeypatch):
    folder = Path(os.environ["FRISCHID_DATA"]) / "ur10e"
    monkeypatch.chdir(tmp_path)
    Path("ur10e.toml").write_text(block("robots/ur10e.md", "toml"), encoding="utf-8")
    logs = sorted(map(str, (folder / "logs").glob("ident_*.parquet")))  # in the order of the page's ident_*.parquet
    tests = {name: str(folder / "logs" / f"{name}_50s_14harm.parquet") for name in ("unloaded", "loaded_2805g")}

    def run(*words):
        result = CliRunner().invoke(main, [*words, "--map", "ur10e.toml", "--width", "400"])
        assert result.exit_code in (0, 1), result.output
        return " ".join(result.output.split())

    run("identify", str(folder / "ur10e.urdf"), *logs, "-o", "model.json")
    printed = {
        "guides/payload.md": run("payload", "model.json", tests["loaded_2805g"]),
        "understand/probability.md": run("diagnose", "model.json", *logs, "--valid", tests["unloaded"]),
    }
    for page, output in printed.items():
        for part in re.split(r"\.\.\.|\[\.\.\.\]|\n(?=\S+ +\S+ +\S+ )", block(page, "text")):
            words = " ".join(part.strip(" []),\n").split())
            pattern = re.sub(r"\d(?=\\ %)", r"\\d", re.escape(words))  # a last digit depends on the machine
            assert re.search(pattern, output), f"{page}: {words}"


@pytest.mark.skipif(not os.environ.get("FRISCHID_DATA"), reason="the authors' points: no measured logs")
def test_the_commands_of_the_page_on_the_paper(tmp_path, monkeypatch):
    """Word for word, with four runs each; the table of the points stands for the authors' file of them."""
    monkeypatch.chdir(tmp_path)
    points = Path(os.environ["FRISCHID_DATA"]) / "frisch_planar" / "exciting_points.csv"
    for line in block("understand/paper.md", "sh").splitlines():
        words = shlex.split(line.replace("final.mat", str(points)), comments=True)
        result = CliRunner().invoke(main, [*words[1:], "--runs", "4"])
        assert result.exit_code == 0, result.output
    assert {path.name for path in Path("paper").iterdir()} == {"paper.html", "paper.json"}


def test_the_studio_of_the_guide_opens(tmp_path):
    """The line of guides/see.md prints the address."""
    pytest.importorskip("viser", reason="the extra frischid[studio] is not installed")
    model, log = small_model()
    model.save(tmp_path / "model.json")
    write_log(log, tmp_path / "log.csv")
    words = shlex.split(block("guides/see.md", "sh"))
    with subprocess.Popen(
        [sys.executable, "-m", *words], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as running:
        first = running.stdout.readline()
        running.terminate()
    assert first.startswith("studio: http://localhost:")


def test_the_page_on_the_mapping_file_lists_every_key():
    sections = re.split(r"^## `\[", (DOCS / "reference" / "mapping.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    words = {section.partition("]")[0].lower(): set(re.findall(r"`\"?(\w+)\"?`", section)) for section in sections[1:]}
    assert set(words) == {"file", "default", "joint.name", "current_gain", "layout.name"}
    assert not set(FILE_RULES) - words["file"]
    assert not set(DEFAULT_RULES) - words["default"]
    assert not set(JOINT_RULES) - words["joint.name"]
