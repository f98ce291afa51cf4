"""The command line: every command for people and for machines, and every bad input a stranger may give it."""

import json
import os
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from output_schemas import printed_by

from frischid.cli import main
from frischid.cli.arguments import matching
from frischid.cli.pages import comparing
from frischid.effects import EFFECTS
from frischid.logs.log import Log
from frischid.logs.readers import read_log, write_log
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.model.model import Model
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot


def run(*args, code=0):
    """Run a command, check its exit code, and return what it printed and what it complained of."""
    result = CliRunner().invoke(main, [str(a) for a in args])
    assert result.exit_code == code, f"{result.output}\n{result.exception!r}"
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def data_of(*args, code=0):
    """What a command prints with --json; it has the form of the command's schema."""
    data = json.loads(run(*args, "--json", code=code).stdout)
    printed_by(args, data)
    return data


def refused(words, *args):
    """The command fails with exit code 2, prints nothing, and says these words on stderr."""
    result = run(*args, code=2)
    assert result.stdout == ""
    for word in words:
        assert word in result.stderr
    assert "Traceback" not in result.stderr
    return result


@pytest.fixture(scope="session")
def logs(tmp_path_factory):
    """Two motions of the planar arm, a validation and a broken folder."""
    folder = tmp_path_factory.mktemp("logs")
    robot = Robot.load("planar2")
    for seed, name in enumerate(("first.parquet", "second.csv", "valid.npz")):
        motion = random_fourier(robot, 20.0, seed=seed)
        log = simulate(robot, motion, rate=100.0, noise=Noise(tau=0.01), channels=(), seed=seed)
        write_log(log, folder / name)
    return folder


@pytest.fixture(scope="session")
def fitted(logs):
    """An identified model, and what was printed."""
    path = logs / "model.json"
    return path, data_of(
        *("identify", "planar2", logs / "first.parquet", logs / "second.csv", "--valid", logs / "valid.npz"),
        *("-o", path),
    )


def changed(logs, folder, name="log.csv", **columns):
    """Write the second log again with other columns; None leaves one out, a function changes one."""
    table = {k: x.copy() for k, x in read_log(logs / "second.csv").to_table().items()}
    for column, value in columns.items():
        if value is None:
            del table[column]
        else:
            table[column] = value(table[column])
    path = folder / name
    rows = np.column_stack(list(table.values()))
    path.write_text("\n".join([",".join(table), *(",".join(map(repr, r)) for r in rows.tolist())]) + "\n")
    return path


# ---- every command


def test_help_lists_every_command():
    text = run("--help").stdout
    for command in ("demo", "info", "check", "identify", "compare", "simulate", "effects"):
        assert f"  {command}" in text
        assert "--json" in run(command, "--help").stdout
    assert "version" in run("--version").stdout


@pytest.mark.parametrize("name", ["planar2", "panda", "kinova"])
def test_info(name):
    robot = Robot.load(name)
    data = data_of("info", name)
    assert [j["name"] for j in data["joints"]] == list(robot.joints)
    assert data["rank"] == len(data["base_parameters"])
    assert data["gap"] > 100
    groups = ("identifiable_alone", "identifiable_in_combination", "not_identifiable")
    assert sum(len(data[g]) for g in groups) == len(robot.all_names) + 4 * len(robot.joints)
    text = run("info", name).stdout
    assert f"{data['rank']} base parameters" in text
    assert "the next singular value is" in text
    for joint in robot.joints:
        assert joint in text


def test_info_takes_the_robots_options():
    data = data_of(
        *("info", "planar2", "--frames", "far_end", "--known", "my1=0", "--known", "my2=0"),
        *("--effects", "viscous,coulomb,rotor_inertia(coupled=true,ratio=0.1)"),
    )
    assert data["rank"] == 9
    assert len(data["identifiable_alone"]) == 5
    assert len(data["not_identifiable"]) == 14
    assert len(data["identifiable_in_combination"]) == 7
    assert "my1" in data["not_identifiable"]
    data = data_of("info", "ur10", "--lock", "wrist_*=0.5", "--gravity", 0, 0, -1.62)
    assert data["locked"] == {f"wrist_{i}_joint": 0.5 for i in (1, 2, 3)}
    assert data["gravity"] == [0.0, 0.0, -1.62]
    assert [j["name"] for j in data_of("info", "ur10", "--joints", "shoulder_*")["joints"]] == [
        "shoulder_pan_joint",
        "shoulder_lift_joint",
    ]
    tilted = data_of("info", "ur10", "--base-rpy", 3.14159265, 0, 0)
    assert tilted["gravity"][2] == pytest.approx(9.81)
    named = data_of("info", "ur10", "--frames", "wrist_3_joint=tool0")
    assert named["rank"] == data_of("info", "ur10")["rank"]


def test_check(logs):
    data = data_of("check", "planar2", logs / "first.parquet", logs / "second.csv")
    assert data["ok"] is True
    assert [x["samples"] for x in data["logs"]] == [2001, 2001]
    assert run("check", "planar2", logs / "first.parquet").stdout.startswith("Nothing suspicious in the log.")


def test_check_ends_with_one_when_something_is_suspicious(logs, tmp_path):
    degrees = changed(logs, tmp_path, q_joint1=np.rad2deg, q_joint2=np.rad2deg)
    data = data_of("check", "planar2", degrees, code=1)
    assert data["ok"] is False
    (warning, *_) = data["logs"][0]["warnings"]
    assert "joint1, joint2" in warning
    assert "degrees" in warning
    result = run("check", "planar2", logs / "first.parquet", degrees, code=1)
    assert result.stdout.startswith("1 of 2 logs needs attention: ")
    assert "degrees" in result.stdout


def test_identify(fitted, logs):
    path, data = fitted
    assert data["rank"] == len(data["parameters"]) == 13
    assert data["comparison"]["nrmse"] < 0.02
    assert data["comparison"]["constant_nrmse"] >= 1.0
    assert 0 < data["headline"]["nrmse"] < 0.02
    assert data["comparison"]["logs"] == [str(logs / "valid.npz")]
    assert json.loads(path.read_text())["parameters"] == data["parameters"]
    for parameter in data["parameters"]:
        assert parameter["stderr"] > 0
        assert set(parameter["bounds"]) >= {"frisch"}
    command = ("identify", "planar2", logs / "first.parquet", "--valid", logs / "valid.npz", "--bbrf", "none")
    brief = run(*command).stdout
    assert "mx1R" not in brief
    assert "  the logs determine all 13 parameters: --parameters lists them" in brief
    text = run(*command, "--parameters").stdout
    for words in (
        "13 base parameters",
        "mx1R",
        "frisch box",
        "measured against model",
        "joint by joint, cross-validated",
        "by least squares with the URDF as a prior; condition number",  # in words, not the estimator's name, map
    ):
        assert words in " ".join(text.split())


def test_identify_takes_its_options(logs):
    first = logs / "first.parquet"
    base = ("identify", "planar2", first, "--bbrf", "none")
    assert data_of(*base, "--cutoff", 3.5)["cutoff_hz"] == 3.5
    assert data_of(*base, "--cutoff", "none")["cutoff_hz"] is None
    assert data_of(*base, "--estimator", "ols")["estimator"] == "ols"
    assert list(data_of(*base, "--torque-joints", "joint2")["cross_validation"]) == ["joint2"]
    plain = data_of(*base, "--effects", "viscous@joint1,coulomb(width=0.05)")
    assert [p["name"] for p in plain["parameters"][-3:]] == ["fv1", "fc1", "fc2"]
    locked = data_of(*base, "--lock", "joint2=0.1", "--torque-joints", "joint1")
    assert "locked at 0.1 rad (m): joint2" in locked["notes"]
    # a joint locked without an angle is held where the log has it
    median = float(np.median(read_log(first).q[:, 1]))
    held = data_of(*base, "--lock", "joint2")
    assert f"locked at {median:.4g} rad (m): joint2" in held["notes"]
    windows = data_of("identify", "planar2", first, "--bbrf", "undo", "--window", 200)
    assert windows["bbrf"]["variant"] == "undo"


def test_compare(fitted, logs):
    path, data = fitted
    again = data_of("compare", path, logs / "valid.npz")
    assert again["comparison"] == data["comparison"]
    text = run("compare", path, logs / "valid.npz").stdout
    assert "NRMSE" in text
    assert "joint2" in text


def test_the_time_of_the_worst_error_names_its_log_where_there_are_several(fitted, logs):
    model, valid = Model.load(fitted[0]), read_log(logs / "valid.npz")
    middle = np.abs(np.arange(len(valid.t)) - len(valid.t) // 2) < 25
    bad = Log(valid.t, valid.joints, valid.q, tau=valid.tau + 3.0 * middle[:, None], source="folder/bad.npz")

    def times(*given):
        return list(comparing.error_tables(compare(model, given))[0].columns[-1].cells)

    assert all(cell.endswith(" of bad.npz") for cell in times(valid, bad))
    assert not any(" of " in cell for cell in times(bad))


def test_a_coloured_residual_at_the_noise_floor_is_no_reason_to_search():
    found = SimpleNamespace(depends_on={"q": 0.001}, white=True)
    errors = {
        name: SimpleNamespace(nrmse=nrmse, noise_floor=0.01) for name, nrmse in (("joint1", 0.011), ("joint2", 0.1))
    }
    result = SimpleNamespace(residuals=SimpleNamespace(structure=lambda: dict.fromkeys(errors, found)), joints=errors)
    first, second = comparing._residual_error(result)
    assert first == "joint1: the residual is not independent of q (the error is that of the sensors: little to gain)"
    assert second == "joint2: the residual is not independent of q"


@pytest.mark.parametrize("suffix", ["parquet", "csv", "npz"])
def test_simulate(tmp_path, suffix):
    path = tmp_path / f"log.{suffix}"
    data = data_of(
        *("simulate", "planar2", "-o", path, "--duration", 3, "--rate", 50, "--set", "off1=2.5", "--channels", "v"),
        *("--effects", "offset", "--noise-q", 1e-3, "--quantum", 1e-4),
    )
    assert data["samples"] == 151
    log = read_log(path)
    assert log.joints == ("joint1", "joint2")
    assert log.v is not None
    assert log.a is None
    np.testing.assert_allclose(log.q / 1e-4, np.round(log.q / 1e-4), atol=1e-6)
    bare = tmp_path / "bare.npz"
    run("simulate", "planar2", "-o", bare, "--duration", 3, "--rate", 50, "--effects", "offset", "--channels", "none")
    np.testing.assert_allclose(log.tau - read_log(bare).tau, np.tile([2.5, 0.0], (151, 1)), atol=1e-9)


def test_simulate_through_points(tmp_path):
    points, out = tmp_path / "points.csv", tmp_path / "log.npz"
    rng = np.random.default_rng(0)
    write_log(Log(np.arange(11.0), ("joint1", "joint2"), *rng.normal(size=(3, 11, 2))), points)
    run("simulate", "planar2", "-o", out, "--points", points, "--rate", 10)
    given, made = read_log(points), read_log(out)
    np.testing.assert_allclose(made.q[::10], given.q, atol=1e-9)
    np.testing.assert_allclose(made.a[::10], given.a, atol=1e-6)
    bare = tmp_path / "bare.csv"
    write_log(Log(given.t, given.joints, given.q), bare)
    refused(["--duration 5: the points of", "have their own times"],
            "simulate", "planar2", "-o", out, "--points", points, "--duration", 5)  # fmt: skip
    refused(["need v_<joint> and a_<joint>"], "simulate", "planar2", "-o", out, "--points", bare)


def test_the_version_is_the_packages():
    assert run("--version").stdout.strip().endswith(metadata.version("frischid"))


def test_effects():
    listed = data_of("effects")
    assert [e["effect"] for e in listed] == list(EFFECTS)
    text = run("effects").stdout
    for name in EFFECTS:
        assert name in text
        page = data_of("effects", name)
        assert page["effect"] == name
        assert page["reference"]
        words = " ".join(page["equation"].split())
        assert words in " ".join(run("effects", name).stdout.split())


def test_demo(tmp_path):
    path = tmp_path / "model.json"
    data = data_of("demo", "-o", path, "--report", tmp_path / "page.html")
    within = [abs(p["value"] - p["true"]) <= 3 * p["stderr"] for p in data["parameters"]]
    assert sum(within) >= len(within) - 1
    assert data["comparison"]["nrmse"] < 0.01
    assert path.exists()
    assert "<!doctype html>" in (tmp_path / "page.html").read_text(encoding="utf-8")[:20]
    text = run("demo", "--seed", 3, "--report", tmp_path / "again.html").stdout
    for words in ("true", "± s.e.", "on logs it was not fitted to", "again.html"):
        assert words in text


# ---- what is wrong is said, with what exists


def test_unknown_robot():
    refused(["unknown robot 'pand'", "panda"], "info", "pand")
    refused(["unknown robot 'planr2'", "planar2"], "simulate", "planr2", "-o", "x.csv")
    refused(["no such URDF file"], "info", "nowhere.urdf")


def test_unknown_names(logs):
    first = logs / "first.parquet"
    identify = ("identify", "planar2", first)
    refused(["joint 'joint3'", "joint1, joint2"], *identify, "--joints", "joint3")
    refused(["joint 'elbow'", "joint1, joint2"], *identify, "--lock", "elbow=0.3")
    refused(["joint 'k*'", "joint1, joint2"], *identify, "--torque-joints", "joint1,k*")
    refused(["effect 'viscus'", "viscous"], *identify, "--effects", "viscus")
    refused(["effect 'drag'", "viscous", "coulomb"], *identify, "--effects", "drag")
    refused(["parameter 'widht'", "width"], *identify, "--effects", "coulomb(widht=1)")
    refused(["joint 'joint9'", "joint1, joint2"], *identify, "--effects", "viscous@joint9")
    refused(["estimator 'lsq'", "wls"], *identify, "--estimator", "lsq")
    refused(["'strick'", "strict"], *identify, "--bbrf", "strick")
    refused(["velocity", "measured"], *identify, "--velocity", "guessed")
    refused(["frame choice 'dh'", "far_end"], *identify, "--frames", "dh")
    refused(["parameter 'm7'"], *identify, "--known", "m7=0")
    refused(["effect 'friction'"], "effects", "friction")
    refused(["parameter 'fv9'", "fv1"], "simulate", "planar2", "-o", logs / "x.csv", "--set", "fv9=1")
    refused(["channel 'tau'", "none"], "simulate", "planar2", "-o", logs / "x.csv", "--channels", "tau")
    assert not (logs / "x.csv").exists()


def test_a_joint_is_found_by_its_own_name_before_any_pattern():
    """Before: "unknown joint 'arm[2]'; did you mean: arm[2]"."""
    names = ["arm[1]", "arm[2]", "arm2", "w*"]
    assert matching("arm[2],w*", names) == ["arm[2]", "w*"]
    assert matching("arm*", names) == names[:3]
    assert matching("arm[0-9]", names) == ["arm2"]


def test_history_writes_a_model_or_says_why_not(fitted, tmp_path):
    out = tmp_path / "model.json"
    refused(["-o writes the model of --undo"], "history", fitted[0], "-o", out)
    refused(["--undo needs -o FILE"], "history", fitted[0], "--undo")
    assert not out.exists()


def test_values_that_are_none(logs):
    identify = ("identify", "planar2", logs / "first.parquet")
    refused(["--cutoff", "'fast' is not a number"], *identify, "--cutoff", "fast")
    refused(["positive frequency"], *identify, "--cutoff", "-2")
    refused(["joint2", "'x' is not a number"], *identify, "--lock", "joint2=x")
    refused(["'my1' must have the form NAME=VALUE"], *identify, "--known", "my1")
    refused(["my1", "'none' is not a number"], *identify, "--known", "my1=none")
    refused(["width", "positive"], *identify, "--effects", "coulomb(width=-1)")
    refused(["width = 'wide'", "0.005"], *identify, "--effects", "coulomb(width=wide)")
    refused(["coupled = 2.0", "False"], *identify, "--effects", "rotor_inertia(coupled=2)")
    refused(["write it as name"], *identify, "--effects", "coulomb(width=1")
    refused(["the same effect is named twice"], *identify, "--effects", "viscous,viscous")
    refused(["comes twice"], *identify, "--effects", "viscous,viscous@joint1")
    simulate = ("simulate", "planar2", "-o", logs / "x.csv")
    refused(["rate must be a positive number"], *simulate, "--rate", 0)
    refused(["duration must be 0.01 to 3600 s"], *simulate, "--duration", -1)
    refused(["noise q must be"], *simulate, "--noise-q", -1)
    refused(["off1", "'much' is not a number"], *simulate, "--set", "off1=much")
    refused(["parameter off1 must be a finite number, got nan"], *simulate, "--set", "off1=nan")
    refused(["off1 has two values, 1 and 2"], *simulate, "--set", "off1=1", "--set", "off1=2")
    refused(["my1 has two values"], *identify, "--known", "my1=0", "--known", "my1=0.5")
    refused(["--lock joint2=nan", "finite number of rad"], *identify, "--lock", "joint2=nan")
    refused(["three finite numbers"], "info", "planar2", "--gravity", "nan", 0, 0)


def test_missing_files(fitted, logs):
    refused(["there is no such file", "did you mean first.parquet"], "check", "planar2", logs / "frist.parquet")
    refused(["is a folder"], "check", "planar2", logs)
    refused(["model file cannot be read"], "compare", logs / "none.json", logs / "valid.npz")
    refused(["not a JSON model file"], "compare", logs / "second.csv", logs / "valid.npz")
    refused(["mapping file cannot be read"], "check", "planar2", logs / "first.parquet", "--map", logs / "no.toml")
    refused(["Missing argument"], "identify", "planar2")
    refused(["a model, not a log"], "check", "planar2", fitted[0])


def with_value(value, row=7):
    """Replace one value of a column."""
    return lambda x: np.where(np.arange(x.size) == row, value, x)


NO_Q = {"q_joint1": None, "q_joint2": None}
NO_TAU = {"tau_joint1": None, "tau_joint2": None}
BAD = {
    "no column of a joint": (NO_Q, ["no position column", "tau_joint1"]),
    "no time": ({"t": None}, ["no time column 't'", "q_joint1"]),
    "no torque": (NO_TAU, ["no torque column", "q_joint1, q_joint2"]),
    "nan": ({"q_joint2": with_value(np.nan)}, ["line 9", "'q_joint2'", "nan"]),
    "infinite": ({"tau_joint1": with_value(np.inf)}, ["line 9", "'tau_joint1'", "inf"]),
    "time repeats": ({"t": with_value(0.06)}, ["does not increase at line 9"]),
    "time falls": ({"t": lambda x: x[::-1]}, ["time does not increase", "steps backwards"]),
    "zero torque": (dict.fromkeys(NO_TAU, np.zeros_like), ["the torque is zero throughout"]),
}


@pytest.mark.parametrize("command", ["check", "identify"])
@pytest.mark.parametrize("what", BAD)
def test_bad_logs(logs, tmp_path, command, what):
    columns, words = BAD[what]
    path, model = changed(logs, tmp_path, **columns), tmp_path / "model.json"
    output = ("-o", model) if command == "identify" else ()
    refused([str(path), *words], command, "planar2", path, *output)
    assert not model.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.csv"]


def test_a_log_without_motion(logs, tmp_path):
    path = changed(logs, tmp_path, **dict.fromkeys(NO_Q, np.zeros_like))
    said = " ".join(run("check", "planar2", path, code=1).stdout.split())
    assert "standstill (certain) the arm stands still in the whole log, at 1 pose: too few to fit gravity" in said
    assert "if the arm did move, check the position columns and their unit" in said
    refused([str(path), "at 1 pose: gravity needs at least 5 different poses"], "identify", "planar2", path)


def test_one_dead_torque(logs, tmp_path):
    path = changed(logs, tmp_path, tau_joint2=np.zeros_like)
    refused(["torque of joint2 is zero throughout", "--torque-joints"], "identify", "planar2", path)
    run("check", "planar2", path, code=1)
    assert data_of("identify", "planar2", path, "--torque-joints", "joint1")["rank"] > 5


def test_degrees_stop_identify_unless_told_otherwise(logs, tmp_path):
    path = changed(logs, tmp_path, q_joint1=np.rad2deg, q_joint2=np.rad2deg)
    refused(["degrees", "--force"], "identify", "planar2", path, "--bbrf", "none")
    result = data_of("identify", "planar2", path, "--bbrf", "none", "--force", code=1)
    assert any("degrees" in w for w in result["warnings"])
    mapping = tmp_path / "map.toml"
    mapping.write_text('[file]\nangle_unit = "deg"\n')
    right = data_of("identify", "planar2", path, "--map", mapping, "--bbrf", "none")
    assert not any("degrees" in w for w in right["warnings"])
    assert right["headline"]["nrmse"] < 0.02


def test_too_few_samples(logs, tmp_path):
    path = tmp_path / "short.csv"
    write_log(read_log(logs / "second.csv").slice(500, 515), path)
    refused(["longer than the filters need", "record longer"], "identify", "planar2", path)
    run("simulate", "ur10", "-o", path, "--duration", 2, "--rate", 10)
    options = ("--cutoff", "none", "--torque-joints", "shoulder_pan_joint", "--prior", "none")
    refused(["torque rows cannot determine", "record longer"], "identify", "ur10", path, *options)
    text = (logs / "second.csv").read_text().splitlines()
    path.write_text("\n".join(text[:5]))
    refused(["4 samples"], "identify", "planar2", path)


def test_a_log_of_another_robot(logs):
    refused(
        ["none of the joints in this log", "joint1, joint2", "elbow_joint", "frischid map"],
        "check",
        "ur10",
        logs / "second.csv",
    )


def test_the_output_folder_must_exist(logs, tmp_path, monkeypatch):
    monkeypatch.setattr("frischid.model.identification.identify", lambda *_, **__: pytest.fail("worked for nothing"))
    wrong = tmp_path / "none" / "model.json"
    refused(["there is no folder"], "identify", "planar2", logs / "first.parquet", "-o", wrong)
    refused(["is a folder"], "identify", "planar2", logs / "first.parquet", "-o", tmp_path)
    refused(["there is no folder"], "simulate", "planar2", "-o", tmp_path / "none" / "log.csv")
    refused(["cannot write '.txt' files", ".parquet"], "simulate", "planar2", "-o", tmp_path / "log.txt")
    assert not list(tmp_path.iterdir())


def test_output_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr("frischid.cli.demo.run", lambda *_, **__: pytest.fail("worked for nothing"))
    refused(["there is no folder"], "demo", "-o", tmp_path / "none" / "model.json")
    refused(["there is no folder"], "demo", "--report", tmp_path / "none" / "page.html")
    monkeypatch.setattr("frischid.motions.simulation.simulate", lambda *_, **__: pytest.fail("worked for nothing"))
    refused(["there is no folder"], "simulate", "planar2", "-o", tmp_path / "none" / "log.csv")


def test_compare_with_a_log_that_lacks_a_torque(fitted, logs, tmp_path):
    path = changed(logs, tmp_path, tau_joint2=None)
    refused([str(path), "no torque (tau_<joint>) of joint2"], "compare", fitted[0], path)
    path = changed(logs, tmp_path, q_joint2=None, tau_joint2=None)
    refused([str(path), "joint2"], "compare", fitted[0], path)


def test_an_empty_box_is_said(logs, tmp_path):
    path = tmp_path / "noisy.csv"
    run(
        *("simulate", "planar2", "-o", path, "--duration", 20, "--noise-q", 5e-3, "--noise-v", 5e-2),
        *("--noise-a", 0.5, "--noise-tau", 0.2),
    )
    options = ("identify", "planar2", path, "--cutoff", "none", "--window", 40)
    assert data_of(*options)["bbrf"]["emptied"]["window"] >= 0
    model = tmp_path / "model.json"
    refused(["the box is empty at window", "parameter"], *options, "--estimator", "frisch", "-o", model)
    assert not model.exists()


# ---- measured logs


@pytest.fixture
def measured():
    if not (folder := os.environ.get("FRISCHID_DATA")):
        pytest.skip("FRISCHID_DATA is not set")
    return Path(folder)


def test_panda(measured, tmp_path):
    folder = measured / "panda"
    model = tmp_path / "panda.json"
    data = data_of(
        *("identify", folder / "panda.urdf", folder / "logs/ident_0_14s.parquet", "-o", model),
        *("--valid", folder / "logs/valid_14_21s.parquet", "--bbrf", "none"),
    )
    assert data["comparison"]["nrmse"] <= 0.055
    assert data_of("compare", model, folder / "logs/valid_14_21s.csv")["headline"]["nrmse"] == pytest.approx(
        data["comparison"]["nrmse"]
    )


def test_panda_with_a_hand_that_no_log_holds(measured):
    folder = measured / "panda"
    data = data_of(
        *("identify", folder / "panda_with_hand.urdf", folder / "logs/ident_0_14s.parquet", "--bbrf", "none"),
    )
    assert any("not every log has the position" in n and "finger" in n for n in data["notes"])


GAINS = {
    "shoulder_pan": 11.97,
    "shoulder_lift": 11.98,
    "elbow": 9.84,
    "wrist_1": 10.75,
    "wrist_2": 10.69,
    "wrist_3": 10.68,
}


def test_ur10e(measured, tmp_path):
    folder = measured / "ur10e"
    mapping = tmp_path / "map.toml"
    mapping.write_text("[current_gain]\n" + "".join(f"{j}_joint = {g}\n" for j, g in GAINS.items()))
    idents = sorted((folder / "logs").glob("ident_*.parquet"))
    assert len(idents) == 5
    data = data_of(
        *("identify", folder / "ur10e.urdf", *idents, "--map", mapping, "--bbrf", "none"),
        *("--valid", folder / "logs/unloaded_50s_14harm.parquet"),
    )
    assert data["comparison"]["nrmse"] <= 0.090
    assert data["rank"] >= 58
    assert data["gap"] > 100


def test_ur10e_in_amperes(measured):
    """Without gains, the error on another log is that of the weighed gains, and friction in A is the same."""
    folder = measured / "ur10e"
    fit = [folder / f"logs/{name}.parquet" for name in ("ident_20s_5harm", "ident_30s_12harm")]
    test = folder / "logs/unloaded_50s_14harm.parquet"
    data = data_of("identify", folder / "ur10e.urdf", *fit, "--valid", test, "--bbrf", "none")
    assert data["comparison"]["nrmse"] < 0.06
    assert [alarm["id"] for alarm in data["alarms"]] == ["gains-from-masses"]
    for (joint, weighed), drawn in zip(GAINS.items(), data["amperes"], strict=True):
        gain, doubt = (data["currents"][key][f"{joint}_joint"] for key in ("gain", "doubt"))
        assert abs(gain / weighed - 1) < 2 * doubt
        assert 0.1 < drawn["coulomb"][0] < 2.0


def test_tiago(measured):
    folder = measured / "tiago"
    rows = "arm_1_joint,arm_2_joint,arm_3_joint,arm_4_joint"
    data = data_of(
        *("identify", folder / "tiago_48_schunk.urdf", folder / "logs/ident_0_48s.parquet", "--bbrf", "none"),
        *("--valid", folder / "logs/valid_48_80s.parquet", "--torque-joints", rows),
    )
    assert data["comparison"]["nrmse"] <= 0.14
    assert list(data["comparison"]["joints"]) == rows.split(",")
    assert any("measured velocity of" in n and "arm_1_joint" in n for n in data["notes"])
    run("check", folder / "tiago_48_schunk.urdf", folder / "logs/ident_0_48s.parquet", code=1)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_a_script_of_the_shell(shell):
    script = run("completion", shell).stdout
    assert "_FRISCHID_COMPLETE" in script
    assert "frischid" in script


def test_help_says_the_defaults():
    assert "[default: auto]" in " ".join(run("identify", "--help").stdout.split())


@pytest.mark.parametrize("command", ["compare", "diagnose", "report"])
def test_a_model_is_judged_on_the_joints_named(command, tmp_path):
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 6.0, seed=1), rate=100.0)
    write_log(log, tmp_path / "log.parquet")
    identify(robot, [log], recursion="none").model.save(tmp_path / "model.json")
    given = [command, tmp_path / "model.json", tmp_path / "log.parquet", "--torque-joints", "*2"]
    given += ["-o", tmp_path / "report.html"] if command == "report" else []
    data = data_of(*given)
    assert list(data["headline"]["joints"]) == ["joint2"]


@pytest.mark.parametrize("command", ["add", "improve"])
def test_a_model_is_fitted_again_to_the_joints_named(command, tmp_path):
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 6.0, seed=1), rate=100.0, noise=Noise(tau=0.01), seed=2)
    write_log(log, tmp_path / "log.parquet")
    identify(robot, [log], effects=(), recursion="none").model.save(tmp_path / "model.json")
    effect = ["viscous"] if command == "add" else []
    given = [command, tmp_path / "model.json", *effect, tmp_path / "log.parquet", "--torque-joints", "joint2"]
    data_of(*given, "-o", tmp_path / "new.json")
    assert Model.load(tmp_path / "new.json").joints == ("joint2",)


def test_a_payload_is_sought_in_the_torque_of_the_joints_named(tmp_path):
    """Without the torque of joint 1 nothing shows the mass beyond joint 2: the first joint's torque tells it."""
    robot = Robot.load("planar2")
    log = simulate(robot, random_fourier(robot, 6.0, seed=1), rate=100.0, noise=Noise(tau=0.01), seed=2)
    write_log(log, tmp_path / "log.parquet")
    identify(robot, [log], recursion="none").model.save(tmp_path / "model.json")
    given = ("payload", tmp_path / "model.json", tmp_path / "log.parquet")
    for more, kilograms in (((), "0.01"), (("--torque-joints", "joint2"), "4")):
        said = run(*given, *more, "-o", tmp_path / "tool.json", code=1).stdout
        assert f"no body: less than {kilograms}" in said
        assert "kg (two standard errors) on the link of joint2" in " ".join(said.split())
        assert not (tmp_path / "tool.json").exists()
