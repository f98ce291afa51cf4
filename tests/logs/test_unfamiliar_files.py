"""Files as people bring them: spreadsheets' CSV, other encodings, preambles, repeated headers, dates, other units."""

from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest
from click.testing import CliRunner
from proposed_mapping import mapped

from frischid.checks.defects import defects
from frischid.cli import main
from frischid.errors import InputError
from frischid.logs.column_names import split
from frischid.logs.column_words import unit_of
from frischid.logs.mapping import LogMap
from frischid.logs.mapping_guess import propose
from frischid.logs.readers import read_chunks, read_log, write_log
from frischid.model.log_examination import check
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.robot.robot import Robot


@pytest.fixture(scope="module")
def robot():
    return Robot.load("ur3")


@pytest.fixture(scope="module")
def log(robot):
    return simulate(robot, random_fourier(robot, 10, seed=1), rate=100, noise=Noise(q=1e-5, tau=0.02), channels=("v",))


def write(path, head, rows, separator=",", encoding="utf-8", decimal=".", before=""):
    cells = [[x if isinstance(x, str) else f"{x:.9g}".replace(".", decimal) for x in row] for row in rows]
    lines = [separator.join(head), *(separator.join(row) for row in cells)]
    path.write_bytes((before + "\r\n".join(lines) + "\r\n").encode(encoding))
    return path


def same(read, log, tolerance=1e-6):
    np.testing.assert_allclose(read.q, log.q[: len(read)], atol=tolerance)
    np.testing.assert_allclose(read.tau, log.tau[: len(read)], atol=1e-5)


def test_german_spreadsheet(tmp_path, robot, log):
    head = [
        "Zeit [s]",
        *(f"Achse {k} Winkel [°]" for k in range(1, 7)),
        *(f"Achse {k} Moment [Nm]" for k in range(1, 7)),
    ]
    rows = np.column_stack([log.t, np.rad2deg(log.q), log.tau])
    path = write(tmp_path / "a.csv", head, rows, ";", "cp1252", ",")
    found, read = mapped(path, robot)
    same(read, log)
    assert not found.guesses, "the torques confirm the order of the joints, in degrees too"
    assert "numbers have a decimal comma" in read.notes
    parts = list(read_chunks(path, robot.joints, path.with_suffix(".toml"), samples=300))
    np.testing.assert_allclose(np.concatenate([part.q for part in parts]), read.q)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_decimal_commas_that_begin_where_the_robot_does(tmp_path, encoding):
    """It rests for 80 whole milliseconds. The first lines had decided that the file has no decimal comma."""
    t = np.append(np.arange(80.0), 80 + np.arange(300) / 2)
    q = np.where(t < 80, 0.0, np.sin(t - 80))
    path = write(tmp_path / "a.csv", ["t", "q_elbow"], np.column_stack([t, q]), ";", encoding, ",")
    mapping = {"file": {"time_unit": "ms"}}
    read = read_log(path, mapping=mapping)
    np.testing.assert_allclose(read.t, t / 1e3)
    np.testing.assert_allclose(read.q[:, 0], q, atol=1e-8)
    parts = list(read_chunks(path, mapping=mapping, samples=100))
    np.testing.assert_allclose(np.concatenate([part.q for part in parts]), read.q)


def test_a_text_with_a_comma_is_no_decimal_comma(tmp_path):
    rows = [[f"{k / 100}", f"{np.sin(k / 100):.9g}", "3,4" if k > 100 else "5"] for k in range(200)]
    read = read_log(write(tmp_path / "a.csv", ["t", "q_elbow", "state"], rows, ";"))
    assert read.t[-1] == 1.99
    assert any(note.startswith("state left out, not numeric") for note in read.notes)


def test_a_text_with_a_comma_beside_whole_numbers_is_none(tmp_path):
    """Such a line alone had decided, and then the numbers with points were no numbers."""
    rows = [[f"{k / 100:g}", f"{k % 7 / 10 if k > 100 else 0:g}", "3,4" if k == 100 else "5"] for k in range(200)]
    assert read_log(write(tmp_path / "a.csv", ["t", "q_elbow", "state"], rows, ";")).t[-1] == 1.99


def test_utf_16_with_tabs(tmp_path, robot, log):
    head = ["Time", *(f"{n} angle" for n in robot.joints), *(f"{n} torque" for n in robot.joints)]
    path = write(tmp_path / "a.txt", head, np.column_stack([log.t, log.q, log.tau]), "\t", "utf-16")
    _, read = mapped(path, robot)
    same(read, log)


def test_preamble(tmp_path, robot, log):
    head = ["t", *(f"q_{n}" for n in robot.joints), *(f"tau_{n}" for n in robot.joints)]
    rows = np.column_stack([log.t, log.q, log.tau])
    for before in ("# Robot: UR3\n# Date: 2026-01-05\n# Operator: x\n", "Export of cell 4, line 2\n\nVersion;3\n"):
        read = read_log(write(tmp_path / "a.csv", head, rows, before=before), robot.joints)
        same(read, log)
        assert any("left out" in note and "before line" in note for note in read.notes)


def test_header_that_comes_again(tmp_path, robot, log):
    head = ["t", *(f"q_{n}" for n in robot.joints), *(f"tau_{n}" for n in robot.joints)]
    rows = [[*row] for row in np.column_stack([log.t, log.q, log.tau])]
    rows.insert(400, head)
    read = read_log(write(tmp_path / "a.csv", head, rows), robot.joints)
    same(read, log)
    assert "1 line like the header left out, the first at line 402" in read.notes
    rows[700][3] = "x"
    with pytest.raises(InputError, match="line 702 holds 'x'"):
        read_log(write(tmp_path / "a.csv", head, rows), robot.joints)


def test_dates_as_time(tmp_path, robot, log):
    start = datetime(2026, 3, 4, 10, 11, 12)
    stamps = [(start + timedelta(seconds=float(t))).isoformat(timespec="microseconds") + "Z" for t in log.t]
    head = ["DateTime", *(f"J{k} Pos" for k in range(1, 7)), *(f"J{k} Torque (Nm)" for k in range(1, 7))]
    rows = [[stamp, *q, *tau] for stamp, q, tau in zip(stamps, log.q, log.tau, strict=True)]
    _, read = mapped(write(tmp_path / "a.csv", head, rows), robot)
    same(read, log)
    np.testing.assert_allclose(read.t, log.t, atol=1e-6)


def test_rows_without_position_at_the_start(tmp_path, robot, log):
    head = ["t", *(f"q_{n}" for n in robot.joints), *(f"tau_{n}" for n in robot.joints)]
    rows = [[*row] for row in np.column_stack([log.t, log.q, log.tau])]
    for k in range(12):
        rows[k][1:] = ["NaN"] * 12
    read = read_log(write(tmp_path / "a.csv", head, rows), robot.joints)
    assert len(read) == len(log) - 12
    assert read.t[0] == pytest.approx(log.t[12])
    assert "12 rows without any position left out at the start and the end" in read.notes


def test_milliamperes_and_percent(tmp_path, robot, log):
    for unit, key in (("_mA", "current_factor = 0.001"), (" [mNm]", "torque_factor = 0.001"), (" [% of rated]", None)):
        word = "current" if unit == "_mA" else "torque"
        head = ["t", *(f"axis{k}_pos" for k in range(1, 7)), *(f"axis{k}_{word}{unit}" for k in range(1, 7))]
        path = write(tmp_path / "a.csv", head, np.column_stack([log.t, log.q, 1e3 * log.tau]))
        found, read = mapped(path, robot)
        if key is None:
            assert any("share of a rated value" in guess for guess in found.guesses)
            continue
        assert key in found.toml("a.csv")
        np.testing.assert_allclose(read.current if word == "current" else read.tau, log.tau, atol=1e-5)


def test_stamps_out_of_order_are_named(tmp_path, robot, log):
    rows = np.column_stack([log.t, log.q, log.v])
    rows[[300, 301]] = rows[[301, 300]]
    head = ["timestamp", *(f"actual_q_{k}" for k in range(6)), *(f"actual_qd_{k}" for k in range(6))]
    found = propose(write(tmp_path / "a.csv", head, rows), robot)
    assert any("timestamp goes backwards 1 times, first at line 303" in guess for guess in found.guesses)


def test_encoder_counts_are_not_called_degrees(tmp_path, robot, log):
    head = ["tick", *(f"enc{k}" for k in range(1, 7)), *(f"mot_trq{k}" for k in range(1, 7))]
    counts = np.round(log.q * 100 * 4096 / (2 * np.pi))
    path = write(tmp_path / "a.csv", head, np.column_stack([np.arange(len(log)), counts, log.tau]))
    found, read = mapped(path, robot)
    assert any("counts per radian" in guess for guess in found.guesses)
    (report,) = check(robot, [read])
    assert {"unit of positions"} == {issue.kind for issue in report.issues if issue.blocks}


def test_nothing_numeric_is_an_error_and_no_traceback(tmp_path, robot):
    path = tmp_path / "a.csv"
    path.write_text("a,b\n" + "x,y\n" * 300)
    shown = CliRunner().invoke(main, ["map", str(path), "ur3"])
    assert shown.exit_code == 2
    assert "2 are not numeric: in 'a' line 2 holds 'x'" in " ".join(shown.output.split())


@pytest.mark.parametrize("name", ["log.xlsx", "log.mat", "log.json"])
def test_other_formats_say_what_to_do(tmp_path, robot, name):
    (tmp_path / name).write_bytes(b"PK\x03\x04 something")
    with pytest.raises(InputError, match=r"csv|CSV"):
        read_log(tmp_path / name, robot.joints)


def test_a_joint_with_another_kind_of_name_keeps_its_column(tmp_path, log):
    arm = Robot.load("talos_left_arm")
    moved = simulate(arm, random_fourier(arm, 3, seed=1), rate=100, channels=())
    head = ["t", *(f"{n}.position" for n in arm.joints), *(f"{n}.effort" for n in arm.joints)]
    found, _ = mapped(write(tmp_path / "a.csv", head, np.column_stack([moved.t, moved.q, moved.tau])), arm)
    assert found.missing == ()
    assert all("tau" in columns for columns in found.joints.values())


def test_units_are_no_quantities():
    assert split("axis1_current_mA") == ("current", "axis_1")
    assert split("Achse 2 Drehzahl [1/min]")[0] == "v"
    assert unit_of("joint_pos[3]") == ("", "joint_pos[3]")


def test_what_is_written_is_read_back(tmp_path, robot, log):
    write_log(log, tmp_path / "a.csv")
    assert (read_log(tmp_path / "a.csv").q == log.q).all()


def test_more_forms_of_text(tmp_path, robot, log):
    head = ["t", *(f"q_{n}" for n in robot.joints), *(f"tau_{n}" for n in robot.joints)]
    rows = np.column_stack([log.t, log.q, log.tau])
    quoted = [['"' + f"{x:.8f}".replace(".", ",") + '"' for x in row] for row in rows]
    units = [["s"] + ["rad"] * 6 + ["Nm"] * 6, *([*row] for row in rows)]
    texts = [[f"{x:24.8f}" for x in row] for row in rows]
    named = [f"{name:>24}" for name in head]
    for separator, title, cells in ((",", head, quoted), (";", head, units), ("  ", named, texts)):
        path = write(tmp_path / "a.csv", title, cells, separator)
        same(read_log(path, robot.joints), log)
        same(next(read_chunks(path, robot.joints, samples=300)), log)


@pytest.mark.parametrize("form", ["%H:%M:%S.%f", "%d.%m.%Y %H:%M:%S,%f"])
def test_times_of_day(tmp_path, robot, log, form):
    stamps = [(datetime(2026, 3, 4, 10) + timedelta(seconds=float(t))).strftime(form) for t in log.t]
    head = ["Zeit", *(f"robot_state.q[{k}]" for k in range(6)), *(f"robot_state.tau_J[{k}]" for k in range(6))]
    rows = [[stamp, *q, *tau] for stamp, q, tau in zip(stamps, log.q, log.tau, strict=True)]
    found, read = mapped(write(tmp_path / "a.csv", head, rows, ";"), robot)
    same(read, log)
    np.testing.assert_allclose(read.t, log.t, atol=1e-6)
    assert not any("names say nothing" in guess for guess in found.guesses)


def test_stamps_in_two_columns_are_named(tmp_path, robot, log):
    head = ["sec", "nsec", *(f"actual_q_{k}" for k in range(6)), *(f"actual_qd_{k}" for k in range(6))]
    rows = np.column_stack([np.floor(log.t), np.round(log.t % 1 * 1e9), log.q, log.v])
    found = propose(write(tmp_path / "a.csv", head, rows), robot)
    assert any("the time is in two columns, sec and nsec" in guess for guess in found.guesses)


def test_two_stamps_that_nearly_coincide_are_no_jump_of_the_positions(robot, log):
    t = np.array(log.t)
    t[500] = t[501] - 1e-6
    (report,) = check(robot, [replace(log, t=t)])
    assert "position jumps" not in [issue.kind for issue in report.issues]


def test_a_value_for_a_lost_reading_is_named_and_nothing_else(tmp_path, robot, log):
    q = np.array(log.q)
    q[500:505, 2] = -9999.0
    (report,) = check(robot, [replace(log, q=q)])
    assert [(issue.kind, issue.where) for issue in report.issues] == [("position jumps", ("elbow_joint",))]
    assert report.blocked


def test_all_faults_of_a_file_in_another_encoding_are_listed(tmp_path, robot, log):
    head = ["t", "Prüfer", *(f"q_{n}" for n in robot.joints), *(f"tau_{n}" for n in robot.joints)]
    rows = [[float(t), "Jörg", *q, *tau] for t, q, tau in zip(log.t, log.q, log.tau, strict=True)]
    rows[300][4] = "NaN"
    rows[500][0] = rows[499][0]
    path = write(tmp_path / "a.csv", head, rows, ";", "utf-16", ",")
    report = defects(path, LogMap())
    assert {issue.kind for issue in report.issues} == {"garbage rows", "time"}
    assert "1 line " in report.issues[0].what
    assert "302" in report.issues[0].what + report.issues[1].what
