"""A model finds the logs it was fitted to by path and hash, and a hostile path in a model file does no harm."""

import json
import os
import shutil
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

import frischid as fr
from frischid.cli import main
from frischid.diagnosis.roles import roles
from frischid.logs.log_file import StoredFile, difference
from frischid.logs.recording import Recording
from frischid.logs.tables import LOG_SUFFIXES
from frischid.model.model_digest import digest

PLANAR2 = fr.Robot.load("planar2")
MAPPING = '[default]\ntau = "torque_{joint}"\n'


def log_of(seed):
    return fr.simulate(
        PLANAR2, fr.random_fourier(PLANAR2, 10.0, seed=seed), rate=50.0, noise=fr.Noise(q=1e-5, tau=0.02), channels=(),
        seed=seed,
    )  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with two own logs below ``data``, one of them behind a mapping, and the model beside it."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "data").mkdir()
    (folder / "models").mkdir()
    for seed, name in enumerate(("first.csv", "second.csv", "other.csv")):
        fr.write_log(log_of(seed), folder / "data" / name)
        if name != "other.csv":
            text = (folder / "data" / name).read_text().replace("tau_", "torque_")
            (folder / "data" / name).write_text(text)
    (folder / "data" / "map.toml").write_text(MAPPING)
    own = [
        fr.read_log(folder / "data" / n, PLANAR2.joints, folder / "data" / "map.toml")
        for n in ("first.csv", "second.csv")
    ]
    fr.identify(PLANAR2, own, recursion="none").model.save(folder / "models" / "model.json")
    return folder


@pytest.fixture
def case(made, tmp_path):
    """A copy of it, moved elsewhere."""
    shutil.copytree(made, tmp_path / "moved")
    folder = tmp_path / "moved"
    return SimpleNamespace(folder=folder, path=folder / "models" / "model.json", other=folder / "data" / "other.csv")


def content(path):
    return json.loads(path.read_text(encoding="utf-8"))


def entries(data):
    return data["history"][0]["logs"]


def rewritten(path, change):
    data = content(path)
    for entry in entries(data):
        change(entry)
    data["sha256"] = digest(data)  # that the file was changed is not the question here
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def test_a_moved_folder_is_found_and_the_file_names_no_folder_of_the_machine(case, made):
    found = fr.own_logs(fr.Model.load(case.path))
    assert not found.missing
    assert [log.joints for log in found.logs] == [PLANAR2.joints] * 2
    assert all(str(case.folder) in log.source for log in found.logs)
    text = case.path.read_text(encoding="utf-8")
    assert str(made) not in text
    assert entries(json.loads(text))[0]["file"]["path"] == "../data/first.csv"
    assert entries(json.loads(text))[0]["file"]["mapping"]["path"] == "../data/map.toml"


def test_saving_again_elsewhere_keeps_the_way_to_the_logs(case, tmp_path):
    fr.Model.load(case.path).save(tmp_path / "again.json")
    assert entries(content(tmp_path / "again.json"))[0]["file"]["path"] == "moved/data/first.csv"
    again = fr.Model.load(tmp_path / "again.json")
    assert len(fr.own_logs(again).logs) == 2
    again.save(tmp_path / "twice.json")
    assert content(tmp_path / "twice.json") == content(tmp_path / "again.json")


def test_a_large_own_log_is_read_in_pieces(case, monkeypatch):
    whole = fr.own_logs(fr.Model.load(case.path)).logs
    monkeypatch.setattr("frischid.logs.content_size.IN_MEMORY", 0)
    pieces = fr.own_logs(fr.Model.load(case.path)).logs
    assert all(isinstance(log, Recording) for log in pieces)
    assert [log.identity for log in pieces] == [log.identity for log in whole]


def test_logs_that_are_given_are_not_looked_for(case):
    model = fr.Model.load(case.path)
    given = fr.own_logs(model).logs[:1]
    assert [log.identity for log in fr.own_logs(model, given).logs] == [entries(content(case.path))[1]["sha256"]]


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda f: (f / "data" / "first.csv").unlink(), "first.csv: there is no such file"),
        (lambda f: (f / "data" / "first.csv").write_text("1\n"), "first.csv: its size is another one now"),
        (lambda f: (f / "data" / "map.toml").write_text(MAPPING.replace("_{", "x{")), "the hash differs"),
        (lambda f: (f / "data" / "map.toml").unlink(), "mapping file map.toml: there is no such file"),
    ],
    ids=["gone", "shorter", "another mapping", "no mapping"],
)
def test_a_file_that_differs_is_not_read(case, spoil, reason):
    spoil(case.folder)
    found = fr.own_logs(fr.Model.load(case.path))
    assert any(reason in text for text in found.missing)
    assert len(found.logs) < 2


def test_a_content_of_the_same_size_is_not_trusted(case):
    log = case.folder / "data" / "first.csv"
    text = log.read_text()
    log.write_text(text[:-2] + ("1" if text[-2] != "1" else "2") + text[-1])
    assert any("the hash differs" in x for x in fr.own_logs(fr.Model.load(case.path)).missing)


@pytest.mark.parametrize(
    "path", ["/etc/passwd", "C:\\log.csv", "\\\\host\\share\\log.csv", "log\n.csv", "a\x1b[2J.csv"]
)
def test_a_path_that_frischid_never_writes_damages_the_file(case, path):
    rewritten(case.path, lambda entry: entry["file"].update(path=path))
    with pytest.raises(fr.InputError, match="the model file is damaged: expected a path relative to the file"):
        fr.Model.load(case.path)


def test_no_device_pipe_or_foreign_file_is_opened(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    (tmp_path / "secret.key").write_text("secret")
    (tmp_path / "sized.csv").write_text("1234")

    def opened(*_args, **_kwargs):
        raise AssertionError("a file was opened")

    monkeypatch.setattr(os, "open", opened)
    for name, size in (("pipe.csv", 0), ("zero.csv", 0), ("secret.key", 6), ("sized.csv", 3), ("none.csv", 1)):
        assert difference(StoredFile(str(tmp_path / name), "0" * 64, size), LOG_SUFFIXES), name
    assert difference(StoredFile("a\0b.csv", "0" * 64, 1), LOG_SUFFIXES)


@pytest.mark.parametrize("file", [3, {}, {"path": 1}, {"path": "x.csv"}, {"path": "x.csv", "bytes": "1"}])
def test_an_entry_that_is_none_leads_nowhere(case, file):
    rewritten(case.path, lambda entry: entry.update(file=file))
    assert all("its file is not known" in x for x in fr.own_logs(fr.Model.load(case.path)).missing)


def test_logs_of_python_are_not_found_again():
    model = fr.identify(PLANAR2, [log_of(0)], recursion="none").model
    found = fr.own_logs(model)
    assert not found.logs
    assert "its file is not known" in found.missing[0]
    plain = fr.LogMap.from_dict({"default": {"tau": "torque_{joint}"}})
    assert plain.file is None


# ---- the verdict


def test_own_logs_select_whatever_is_given(case):
    model = fr.Model.load(case.path)
    own = fr.own_logs(model).logs
    other = fr.read_log(case.other, PLANAR2.joints)
    names = {log.identity for log in own}
    for logs in ([other], own[:1], own, [*own, other]):
        found = roles(model, logs, situation="always")
        assert {log.identity for log in found.select} == names
        assert [log.identity for log in found.test] == [other.identity] * (other in list(logs))
    assert "2 found by path and hash" in roles(model, [other], situation="always").note
    assert not roles(model, own).note
    changed = roles(model, [other], situation="changed")
    assert (changed.select, changed.test, changed.note) == ((other,), (), "")


def test_without_its_own_logs_a_diagnosis_says_what_it_cannot_show(case):
    model = fr.Model.load(case.path)
    shutil.rmtree(case.folder / "data")
    other = log_of(5)
    found = roles(model, [other], situation="always")
    assert found.select == (other,)
    assert "these logs alone select" in found.note
    assert "first.csv: there is no such file" in found.note


def test_commands_on_a_test_log_alone_use_the_own_logs(case):
    words = ["diagnose", case.path, case.other, "--situation", "always", "--try", "joint_spring"]
    result = CliRunner().invoke(main, [str(w) for w in words])
    assert result.exit_code in (0, 1), result.output
    assert "model's own logs (2 found by path and hash); all other logs test" in " ".join(result.output.split())
    alone = fr.diagnose(fr.Model.load(case.path), fr.own_logs(fr.Model.load(case.path)).logs, effects=["joint_spring"])
    said = json.loads(CliRunner().invoke(main, [*map(str, words), "--json"]).stdout)
    assert said["verdict"] == alone.verdict
    assert said["search"]["error"] == alone.error
    assert said["headline"]["measured"] == "test"


def test_no_command_writes_over_an_own_log(case):
    log = case.folder / "data" / "first.csv"
    before = log.read_bytes()
    result = CliRunner().invoke(main, ["report", str(case.path), str(case.other), "-o", str(log)])
    assert result.exit_code == 2
    assert "first.csv" in result.output
    assert log.read_bytes() == before
