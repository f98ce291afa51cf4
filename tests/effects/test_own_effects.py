"""An effect of one's own: `id` and `terms` suffice for every command, and a class that breaks a rule is refused."""

import json
import warnings
from dataclasses import dataclass, replace
from importlib import metadata
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from cases import robot
from click.testing import CliRunner

from frischid.cli import main
from frischid.core.types import Column
from frischid.diagnosis.addition import add
from frischid.diagnosis.diagnosis import diagnose
from frischid.diagnosis.improvement import improve
from frischid.diagnosis.scored_candidate import as_a_change
from frischid.effects import BASELINE, EFFECTS, Effect, columns_of, effect_from_dict, parse_effects
from frischid.effects.catalogue import GROUP, Catalogue
from frischid.effects.state import Term
from frischid.errors import InputError, UnknownNameError
from frischid.export.consistency import make_consistent
from frischid.export.export import export
from frischid.logs.readers import write_log
from frischid.model.comparison import compare
from frischid.model.identification import identify
from frischid.model.model import Model
from frischid.motions.simulation import Noise, simulate
from frischid.motions.trajectory import random_fourier
from frischid.reports.page import report


@pytest.fixture
def catalogue():
    """The catalogue, as it was when the test is over."""
    before = set(EFFECTS)
    yield EFFECTS
    for name in set(EFFECTS) - before:
        EFFECTS.remove(name)


def defined(name="Detent", **body):
    """Make an effect class that has what a class needs, changed by `body`; None takes an entry out."""
    annotations = body.pop("annotations", {})
    whole = {
        "id": "detent",
        "terms": lambda self, state: [],
        "__annotations__": annotations,
        "__module__": __name__,
    } | body
    return type(Effect)(name, (Effect,), {k: v for k, v in whole.items() if v is not None})


# ---- rules of a class


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ({"id": None}, 'no id of its own; write a line such as id = "magnetic_detent"'),
        ({"id": "magnetic detent"}, "got 'magnetic detent'"),
        ({"id": "2nd"}, "letters, digits and underscores"),
        ({"id": 3}, "got 3"),
        ({"id": "rigid"}, "none of rigid, contact"),
        ({"terms": None}, "has the id 'detent' but no method terms"),
        ({"id": "viscous"}, "'viscous' is taken by frischid.effects.friction.Viscous"),
        ({"annotations": {"speed": "float"}}, "the field speed needs a default: a number"),
        ({"annotations": {"speed": "float"}, "speed": [1.0]}, "the field speed needs a default"),
        ({"annotations": {"speed": "float"}, "speed": float("nan")}, "the field speed needs a default"),
        ({"annotations": {"package": "str"}, "package": "x"}, "'package' cannot be a field"),
        ({"annotations": {"id": "str"}}, "'id' cannot be a field"),
        ({"annotations": {"dry": "float"}, "dry": 1.0}, "'dry' cannot be a field"),
        ({"shapes": {"speed": (1.0, 2.0)}}, "shapes names speed, which is not a field; the fields are: none"),
        ({"units": {"speed": ("m/s", "m/s")}}, "units names speed, which is not a field"),
        ({"annotations": {"speed": "float"}, "speed": 1.0, "shapes": {"speed": (2.0, 1.0)}}, "ascending numbers"),
        ({"annotations": {"speed": "float"}, "speed": 1.0, "shapes": {"speed": ()}}, "ascending numbers"),
        ({"annotations": {"speed": "float"}, "speed": 1.0, "shapes": {"speed": 1.0}}, "ascending numbers"),
        ({"annotations": {"speed": "float"}, "speed": 1.0, "units": {"speed": "m/s"}}, "a turning and on a sliding"),
        ({"shapes": ("speed",)}, "shapes must be a dictionary"),
        ({"candidate": "link"}, "candidate must be 'joint', 'robot' or 'never', got 'link'"),
        ({"confused_with": "viscous"}, 'confused_with must be a tuple of effect ids, such as ("viscous",)'),
        ({"title": 3}, "title must be a text, got 3"),
        ({"sentence": "{link} is odd"}, "sentence cannot be filled in (KeyError 'link'); it may use {joint}, {joints}"),
        ({"code": {"c": "{v} * {speed}"}}, "code['c'] cannot be filled in"),
        ({"smooths_sign": True}, "smooths_sign needs a field of the width"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_class_is_said_when_it_is_made(catalogue, body, says):
    known = dict(catalogue)
    with pytest.raises(InputError) as refused:
        defined(**body)
    assert says in str(refused.value)
    assert "Detent" in str(refused.value)
    assert dict(catalogue) == known


def test_fields_without_the_decorator_are_noticed_at_first_use(catalogue):
    kind = defined(annotations={"speed": "float"}, speed=1.0)
    with pytest.raises(InputError, match=r"has fields \(speed\) but is not a dataclass; put @dataclass\(frozen=True\)"):
        columns_of(robot("planar2"), [kind()])
    with pytest.raises(InputError, match="is not a dataclass"):
        catalogue["detent"]
    assert "detent" not in catalogue, "the catalogue works without it"
    with pytest.raises(TypeError, match="non-frozen"):
        dataclass(defined(annotations={"speed": "float"}, speed=1.0))
    catalogue.remove("detent")


def test_a_class_may_be_defined_again(catalogue):
    first, second = defined(), defined()
    assert catalogue["detent"] is second is not first


def test_a_base_class_of_several_effects_is_no_effect(catalogue):
    known = set(catalogue)
    defined(name="Family", id=None, terms=None)
    defined(name="_Helper", id=None)
    assert set(catalogue) == known
    with pytest.raises(TypeError, match="abstract"):
        defined(name="Family", id=None, terms=None)()


def test_a_coefficient_of_two_effects_names_both(catalogue):
    kind = defined(terms=lambda self, state: self.per_joint(state, "fv", "velocity", lambda i: state.v[:, i]))
    with pytest.raises(InputError, match="parameter fv2 comes twice, from viscous and from detent@joint2"):
        columns_of(robot("planar2"), [*parse_effects("viscous"), kind(("joint2",))])
    kind = defined(terms=lambda self, state: self.per_joint(state, "m", "", lambda i: state.v[:, i]))
    with pytest.raises(InputError, match="parameter m1 comes twice, from the rigid body and from detent"):
        columns_of(robot("planar2"), [kind()])


def test_units_of_one_s_own(catalogue):
    kind = defined(terms=lambda self, state: self.per_joint(state, "k", ("N·m/A", "N/A"), lambda i: state.v[:, i]))
    assert [c.unit for c in kind().columns(robot("mixed mimic"))] == ["N·m/A", "N/A", "N·m/A"]
    kind = defined(terms=lambda self, state: self.per_joint(state, "k", "jerk", lambda i: state.v[:, i]))
    with pytest.raises(UnknownNameError, match="unknown quantity 'jerk'"):
        kind().columns(robot("planar2"))


# ---- an effect of id and terms alone, in every place that shows effects


def detent():
    """Make an effect that states no more than it must."""

    @dataclass(frozen=True)
    class Detent(Effect):
        id = "detent"

        def terms(self, state):
            return self.per_joint(state, "cd", "", lambda i: np.exp(-((state.q[:, i] / 0.3 - 2.0) ** 2)))

    return Detent


@pytest.fixture
def hidden(catalogue, tmp_path):
    """A model of an arm with a detent it does not know, its logs, and their files."""
    machine, kind = robot("planar2"), detent()
    logs = [
        simulate(
            machine, random_fourier(machine, 20.0, seed=seed), rate=100.0, effects=(*BASELINE, kind(("joint2",))),
            parameters={"cd2": 3.0, "fv1": 2.0, "fv2": 1.0}, noise=Noise(q=1e-5, tau=0.01), channels=(), seed=seed,
            name=f"log {seed}",
        )
        for seed in (1, 2)
    ]  # fmt: skip
    model = identify(machine, logs[:1], recursion="none").model
    files = [tmp_path / f"log{k}.parquet" for k in (1, 2)]
    for log, path in zip(logs, files, strict=True):
        write_log(log, path)
    model.save(tmp_path / "model.json")
    return SimpleNamespace(kind=kind, model=model, logs=logs, files=files, path=tmp_path / "model.json")


def test_a_class_that_names_its_columns_itself_is_no_change_of_itself(catalogue):
    """Its change would have the same names for ever."""
    machine, name = robot("planar2"), "cd2"

    @dataclass(frozen=True)
    class Latch(Effect):
        id = "latch"

        def terms(self, state):
            return [Term(Column(name, "N·m", "joint2", self.id), {1: np.exp(-((state.q[:, 1] - 0.6) ** 2))})]

    effect = Latch(("joint2",))
    assert as_a_change(effect, {name}, machine) == effect
    assert as_a_change(detent()(("joint2",)), {name}, machine).changed == 1


def test_defaults_say_something_everywhere(catalogue):
    kind = detent()
    assert kind.title == "detent"
    assert defined(id="clunk", __doc__="Clunk of a ``{gear}``.\n\nMore.").title == "Clunk of a {gear}"
    assert EFFECTS["clunk"].sentence.format(joint="elbow", joints="elbow").endswith(": Clunk of a {gear}")
    assert (
        kind.sentence.format(joint="elbow", joints="elbow")
        == "elbow needs torque that the effect detent describes: detent"
    )
    assert kind.confused_with == ()
    assert __name__ in kind.reference
    assert kind().parameters == {}


def test_diagnose_and_improve(hidden):
    found = diagnose(hidden.model, hidden.logs)
    best = found.findings[0]
    assert (found.verdict, best.effect, best.joints) == ("effect", "detent", ("joint2",))
    assert best.sentence == "joint2 needs torque that the effect detent describes: detent"
    steps, _ = improve(hidden.model, hidden.logs)
    assert [str(step.effect) for step in steps][:1] == ["detent@joint2"]
    step = add(hidden.model, parse_effects("detent@joint2"), hidden.logs[:1], valid=hidden.logs[1:])
    assert step.error_after < 0.2 * step.error_before


def test_every_page_shows_it(hidden, tmp_path):
    def run(*arguments):
        done = CliRunner().invoke(main, [str(a) for a in arguments], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return done.stdout

    assert f"module {__name__}" in run("effects", "detent")
    assert json.loads(run("effects", "detent", "--json"))["package"] == {"module": __name__}
    assert "detent" in run("effects")
    assert "detent describes" in run("diagnose", hidden.path, *hidden.files)
    run("report", hidden.path, *hidden.files, "-o", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "the effect detent describes" in page
    assert "--separate detent," not in page, "it names no effect that it is confused with"
    run("add", hidden.path, "detent@joint2", hidden.files[0], "-o", tmp_path / "better.json")
    better = Model.load(tmp_path / "better.json")
    assert str(better.effects[-1]) == "detent@joint2"
    report(better, hidden.logs, tmp_path / "after.html")


def test_the_studio_offers_it(hidden, tmp_path):
    pytest.importorskip("viser", reason="the extra frischid[studio] is not installed")
    from frischid.studio.bench import Bench
    from frischid.studio.findings import Findings

    bench = Bench(hidden.model, hidden.logs, tmp_path / "studio.json")
    bench.diagnose()
    finding = bench.state.diagnosis.findings[0]
    gui = MagicMock()
    Findings(gui, MagicMock(), bench, MagicMock(), MagicMock(), MagicMock()).show(bench.state)
    label, text = gui.add_button.call_args_list[0].args[0], gui.add_markdown.call_args_list[1].args[0]
    assert label.startswith("Add detent")
    assert "the effect detent describes" in text
    before = bench.state.headline.nrmse
    assert bench.add(finding.members, bench.state.revision, finding).headline.nrmse < 0.2 * before


def test_code_for_a_control_loop_says_what_is_missing(catalogue, tmp_path):
    machine, kind = robot("planar2"), detent()
    effects = (*BASELINE, kind(("joint2",)))
    log = simulate(machine, random_fourier(machine, 10.0, seed=1), rate=100.0, effects=effects)
    model = make_consistent(identify(machine, [log], effects=effects, recursion="none").model).model
    with pytest.raises(
        InputError, match=r"detent cannot be written as code, because its class does not state the column of cd"
    ):
        export(model, tmp_path / "control.c")


# ---- packages


class Entry(SimpleNamespace):
    """An entry point of an installed package, which loads what it is told."""

    def load(self):
        return self.loads()


def entry(loads, name="detent", module=__name__, package="my-effect"):
    return Entry(name=name, value=f"{module}:{name}", module=module, loads=loads,
                 dist=SimpleNamespace(name=package, version="1.2"))  # fmt: skip


@pytest.fixture
def packages(monkeypatch):
    """A catalogue of one class, and the entry points it finds."""
    found = []
    monkeypatch.setattr(metadata, "entry_points", lambda group: found if group == GROUP else [])
    fresh = Catalogue()
    fresh.register(EFFECTS["viscous"])
    monkeypatch.setattr("frischid.effects.base.EFFECTS", fresh)
    monkeypatch.setattr("frischid.effects.notation.EFFECTS", fresh)
    return SimpleNamespace(catalogue=fresh, found=found)


def test_packages_are_looked_for_late_and_once(packages):
    loaded = []
    packages.found.append(entry(lambda: loaded.append(1) or detent()))
    assert packages.catalogue["viscous"].id == "viscous"
    assert not loaded
    assert packages.catalogue["detent"].id == "detent"
    assert list(packages.catalogue) == ["viscous", "detent"]
    assert len(packages.catalogue) == 2
    assert loaded == [1]


@pytest.mark.parametrize(
    ("trouble", "says"),
    [
        (ImportError("no module named magnets"), "ImportError: no module named magnets"),
        (SyntaxError("invalid syntax"), "SyntaxError"),
        (RuntimeError("no licence"), "RuntimeError: no licence"),
    ],
)
def test_a_broken_package_is_left_out_with_one_warning(packages, trouble, says):
    def fail():
        raise trouble

    packages.found += [entry(fail), entry(fail, "clunk"), entry(detent, package="other")]
    with pytest.warns(UserWarning, match="package my-effect 1.2 are left out") as told:
        assert set(packages.catalogue) == {"viscous", "detent"}
    assert len(told) == 1
    assert says in str(told[0].message)
    with pytest.raises(InputError, match=r"my-effect 1.0, which is installed but cannot be used"):
        effect_from_dict({"effect": "clunk", "joints": None, "package": {"name": "my-effect", "version": "1.0"}})


def test_a_package_whose_effect_breaks_a_rule_is_left_out(packages):
    packages.found += [
        entry(lambda: defined(id="viscous")),
        entry(lambda: defined(name="Clunk", id="clunk", annotations={"speed": "float"}, speed=1.0), package="other"),
        entry(lambda: 3, package="third"),
    ]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert set(packages.catalogue) == {"viscous"}
    assert ["'viscous' is taken" in str(w.message) for w in told] == [True, False, False]
    assert "is not a dataclass" in str(told[1].message)
    assert "names no effect" in str(told[2].message)


def test_a_saved_effect_knows_its_package(packages):
    packages.found.append(entry(detent))
    (effect,) = parse_effects("detent@joint2")
    saved = json.loads(json.dumps(effect.to_dict()))
    assert saved == {"effect": "detent", "joints": ["joint2"], "package": {"name": "my-effect", "version": "1.2"}}
    assert effect_from_dict(saved) == effect
    assert "package" not in parse_effects("viscous")[0].to_dict()
    with pytest.raises(
        InputError, match=r"comes from the package other 1, but here .* comes from package my-effect 1.2"
    ):
        effect_from_dict(saved | {"package": {"name": "other", "version": "1"}})


def test_an_effect_that_is_not_there_says_what_to_install(packages):
    saved = {"effect": "detent", "joints": None, "package": {"name": "my-effect", "version": "1.2"}}
    with pytest.raises(InputError, match=r"'detent' comes from the package my-effect 1.2, .*pip install my-effect"):
        effect_from_dict(saved)
    with pytest.raises(InputError, match="comes from the module bench, which is not imported"):
        effect_from_dict(saved | {"package": {"module": "bench"}})
    with pytest.raises(UnknownNameError, match="unknown effect 'detent'"):
        effect_from_dict({"effect": "detent", "joints": None})


def test_a_class_that_is_defined_anew_has_columns_of_its_own(catalogue):
    """As in a notebook. Before, the columns of the first class were remembered: an error of 0.17 instead of 0.008."""

    def bent(power):
        if "detent" in EFFECTS:
            EFFECTS.remove("detent")

        def terms(self, state):
            return self.per_joint(state, "kb", "", lambda i: np.maximum(state.q[:, i] - 0.5, 0.0) ** power)

        return defined(terms=terms)(joints=("joint2",))

    arm, effect = robot("planar2"), bent(3)
    motion, noise = random_fourier(arm, 8.0, seed=1), Noise(q=1e-5, tau=0.02)
    log = simulate(arm, motion, rate=50.0, effects=(*BASELINE, effect), parameters={"kb2": 20.0}, noise=noise)
    models = [identify(arm, [log], effects=(*BASELINE, bent(n)), recursion="none", cutoff=5.0).model for n in (1, 3)]
    assert compare(models[1], [log]).nrmse == pytest.approx(compare(models[1], [replace(log)]).nrmse, rel=1e-9)
    found = diagnose(identify(arm, [log], recursion="none", cutoff=5.0).model, [log], effects=["detent"])
    (candidate,) = found.validator.candidates([bent(1)])
    assert candidate is not found.validator.candidates([bent(3)])[0]
