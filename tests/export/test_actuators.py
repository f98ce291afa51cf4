"""The table of drives, and the actuators of an MJCF file, say what the model knows."""

import csv
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest
from cases import robot as mixed
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.cli.pages import joint_drives
from frischid.export.actuators import actuator_rows
from frischid.export.mjcf_edit import _positions
from frischid.model.amperes import JointCurrents
from frischid.robot.xml_places import elements

TRUTH = {"fv1": 0.8, "fc1": 0.6, "Ia1": 0.3, "fv2": 0.5, "fc2": 0.4, "Ia2": 0.2}


@pytest.fixture(scope="module")
def robot():
    return fr.Robot.load("planar2")


@pytest.fixture(scope="module")
def model(robot):
    motion = fr.random_fourier(robot, 20.0, seed=2)
    log = fr.simulate(
        robot, motion, rate=200.0, parameters=TRUTH, noise=fr.Noise(tau=0.01, q=1e-5), seed=1, channels=("v",)
    )
    servo = replace(log, tau=None, v=None, qcmd=log.q + (log.tau + 3.0 * log.v) / 300.0)
    controller = fr.PDController(kp=300.0, kd=3.0, limit={"joint1": 5000.0}, delay={"joint2": 0.0})
    return fr.identify(robot, [servo], controller=controller, recursion="none").model


def test_ranges_hold_the_truth_and_given_values_are_given(model):
    found = {(x.joint, x.quantity): x for x in fr.drive_parameters(model)}
    for quantity, symbol in (("viscous", "fv"), ("coulomb", "fc"), ("armature", "Ia")):
        for j in (1, 2):
            x = found[f"joint{j}", quantity]
            assert x.lower <= TRUTH[f"{symbol}{j}"] <= x.upper
    for x in found.values():
        near = max(x.upper - x.value, x.value - x.lower) <= 0.05 * x.value
        assert x.known in ("given", "assumed") or (x.known == "identified") == (near and x.known != "in a sum")
    assert found["joint1", "viscous"].known in ("identified", "roughly")
    assert found["joint2", "armature"].known in ("identified", "roughly")
    assert (found["joint1", "armature"].known, found["joint1", "armature"].of) == ("in a sum", "Izz1 + Ia1 + 0.25 m2")
    assert found["joint1", "stiffness"].value == 300.0
    assert found["joint1", "stiffness"].known == "given"
    assert found["joint1", "effort_limit"].value == 5000.0


def test_a_value_that_the_motion_does_not_show_is_open(robot):
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=3, scale=0.9), rate=100.0, parameters={"fv1": 0.5})
    found = {(x.joint, x.quantity): x for x in fr.drive_parameters(fr.identify(robot, [log], recursion="none").model)}
    assert found["joint1", "viscous"].known == "identified"
    assert found["joint2", "armature"].known == "open"  # there is none: the range reaches zero


def test_columns_have_the_units_of_joints_that_turn_and_of_joints_that_slide():
    """A robot whose last joint slides had had N·s/m for all of its joints."""
    machine = mixed("mixed mimic")
    log = fr.simulate(machine, fr.random_fourier(machine, 8.0, seed=3), rate=50.0, noise=fr.Noise(tau=1e-3))
    found = fr.identify(machine, [log], recursion="none").model
    said = [str(column.header) for column in joint_drives.drives(found).columns]
    assert any({"armature", "kg·m²", "or", "kg"} == set(x.split()) for x in said)
    assert any({"viscous", "N·m·s/rad", "or", "N·s/m"} == set(x.split()) for x in said)
    draws = [JointCurrents(name, (1.0, 0.1), None, (1.0, 0.1), (0.0, 1.0)) for name in machine.joints]
    said = [str(column.header) for column in joint_drives.amperes(draws, machine).columns]
    assert any({"viscous", "A·s/rad", "or", "A·s/m"} == set(x.split()) for x in said)
    assert any({"rotor", "A·s²/rad", "or", "A·s²/m"} == set(x.split()) for x in said)


def test_an_option_that_a_table_of_drives_has_no_use_for_is_refused(model, tmp_path):
    for given, words in (({"into": "arm.xml"}, "--into"), ({"boxes": {"joint1": ((0, 0, 0), (1, 1, 1))}}, "--box")):
        with pytest.raises(fr.InputError, match=f"{words} .* a table of drives has none"):
            fr.export(model, tmp_path / "drives.csv", **given)
    with pytest.raises(fr.InputError, match="positive time in s, got inf"):
        fr.export(model, tmp_path / "drives.csv", step=float("inf"))
    assert not list(tmp_path.iterdir())


def test_csv_and_json_hold_the_same_rows(model, tmp_path):
    done = fr.export(model, tmp_path / "drives.csv")
    assert done.format == "actuators"
    fr.export(model, tmp_path / "drives.json")
    rows = json.loads((tmp_path / "drives.json").read_text(encoding="utf-8"))["joints"]
    with (tmp_path / "drives.csv").open(encoding="utf-8", newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["joint"] for row in rows] == [row["joint"] for row in table] == ["joint1", "joint2"]
    assert float(table[0]["armature_high"]) == rows[0]["armature_high"] >= rows[0]["armature"]
    late = replace(model, controller=replace(model.controller, delay=0.015))
    assert actuator_rows(late, step=0.005)[0]["delay_steps"] == pytest.approx(3.0)
    with pytest.raises(fr.InputError, match="step must be a positive time"):
        actuator_rows(model, step=0.0)


def test_the_step_of_the_simulator_is_the_users(model, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    replace(model, controller=replace(model.controller, delay=0.015)).save("late.json")

    def run(*words):
        return CliRunner().invoke(main, ["export", "late.json", *words])

    assert run("-o", "drives.json", "--step", "0.002").exit_code == 0
    table = json.loads((tmp_path / "drives.json").read_text(encoding="utf-8"))
    assert table["step"] == 0.002
    assert [row["delay_steps"] for row in table["joints"]] == pytest.approx([7.5, 7.5])
    for words, message in [
        (["-o", "robot.xml", "--step", "0.002"], "counts delays in a table of drives"),
        (["-o", "new.csv", "--step", "-1"], "step must be a positive time"),
    ]:
        done = run(*words)
        assert done.exit_code != 0
        assert message in done.output
        assert not (tmp_path / words[1]).exists()


def test_an_export_says_that_its_drives_go_with_physical_links(model, tmp_path):
    """The prior pulls physical values by less than their range, and the table keeps the values as identified."""
    said = [
        note
        for note in fr.export(model, tmp_path / "robot.xml").notes
        if "drive values that fit its physical links" in note
    ]
    assert len(said) == 1
    joint, table, here = re.search(r"of (joint\d), (\S+) in the table and (\S+) ", said[0]).groups()
    found = {(x.joint, f"{x.value:.3g}") for x in fr.drive_parameters(model)}
    assert (joint, table) in found
    assert here in {f"{float(x):.3g}" for x in re.findall(r'"([-.0-9e]+)"', (tmp_path / "robot.xml").read_text())}


def test_mjcf_gets_position_actuators(model, tmp_path):
    fr.export(model, tmp_path / "robot.xml")
    servos = {x.get("joint"): x for x in ET.parse(tmp_path / "robot.xml").iter("position")}
    assert set(servos) == {"joint1", "joint2"}
    assert float(servos["joint1"].get("kp")) == 300.0
    assert float(servos["joint1"].get("kv")) == 3.0
    assert servos["joint1"].get("forcerange") == "-5000.0 5000.0"


def test_position_actuators_of_the_users_own_file(model):
    data = b'<mujoco>\n  <actuator>\n    <position name="a" joint="joint1" kp="7"/>\n  </actuator>\n</mujoco>\n'
    for start, end, text in sorted(_positions(model, data, elements(data, "robot.xml")), reverse=True):
        data = data[:start] + text.encode() + data[end:]
    servos = {x.get("joint"): x for x in ET.fromstring(data).iter("position")}
    assert {joint: float(x.get("kp")) for joint, x in servos.items()} == {"joint1": 300.0, "joint2": 300.0}
    assert servos["joint1"].get("name") == "a"


def test_identify_prints_the_drives(robot, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = fr.simulate(robot, fr.random_fourier(robot, 10.0, seed=1), rate=100.0, channels=("v",))
    fr.write_log(replace(log, tau=None, v=None, qcmd=log.q + log.tau / 300.0), "servo.csv")
    words = ["identify", "planar2", "servo.csv", "--controller", "pd", "--kp", "300", "--bbrf", "none"]
    done = CliRunner().invoke(main, words)
    assert "drive of" in done.output
    assert "All values grow in proportion to kp" in " ".join(done.output.split())
    assert '"drives"' in CliRunner().invoke(main, [*words, "--json"]).output


def test_friction_that_depends_on_the_position_is_written_in_the_middle_of_the_range(tmp_path):
    """A knee never reaches the angle 0, where the friction that is extrapolated has no meaning and may be negative."""
    text = re.sub(
        r'(<joint name="joint2".*?<limit )lower="[^"]*" upper="[^"]*"',
        r'\1lower="-2.6" upper="-0.6"',
        fr.Robot.load("planar2").urdf,
        flags=re.DOTALL,
    )
    (tmp_path / "knee.urdf").write_text(text, encoding="utf-8")
    knee = fr.Robot.load(tmp_path / "knee.urdf")
    effects = fr.parse_effects("viscous, coulomb, rotor_inertia, position_friction@joint2")
    truth = {"fc1": 2.0, "fc2": 1.9, "fp2": -1.5}  # between 0.4 and 3.4 N·m along the range, and -0.5 N·m at 0
    log = fr.simulate(
        knee, fr.random_fourier(knee, 20.0, seed=2), rate=200.0, effects=effects, parameters=truth,
        noise=fr.Noise(tau=0.01, q=1e-5), seed=1, channels=("v",),
    )  # fmt: skip
    model = fr.identify(knee, [log], effects=effects, recursion="none").model
    found = {x.joint: x for x in fr.drive_parameters(model) if x.quantity == "coulomb"}
    assert found["joint2"].lower <= 1.9 <= found["joint2"].upper
    assert found["joint2"].known in ("identified", "roughly")
    assert model.parameters["fp2"].value == pytest.approx(-1.5, rel=0.02)
    fr.export(model, tmp_path / "drives.csv")
    with (tmp_path / "drives.csv").open(encoding="utf-8", newline="") as file:
        assert float(list(csv.DictReader(file))[1]["friction"]) == pytest.approx(1.9, rel=0.02)
    fr.export(fr.make_consistent(model).model, tmp_path / "out.urdf")
    written = re.findall(r'friction="([^"]*)"', (tmp_path / "out.urdf").read_text(encoding="utf-8"))
    assert float(written[1]) == pytest.approx(1.9, rel=0.02)
