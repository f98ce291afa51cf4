"""The user's own formulas: the right numbers, helpful refusals, and nothing of Python but arithmetic."""

import contextlib
import math

import numpy as np
import pytest
from cases import robot
from hypothesis import given
from hypothesis import strategies as st

from frischid.effects import Formula, State
from frischid.effects.expression import ALLOWED_FUNCTIONS, Expression
from frischid.errors import InputError, UnknownNameError


def state(name="planar2", count=5, **channels):
    """Random channels of a robot."""
    machine = robot(name)
    q, v, a, load, torque = np.random.default_rng(0).normal(size=(5, count, len(machine.joints)))
    return State(machine, 10.0 + np.arange(count), q, v, a, load, torque, 9.0, channels)


def value(expression, on, joint="joint1"):
    (term,) = Formula((joint,), expression=expression).terms(on)
    ((_, values),) = term.rows.items()
    return values


def test_a_formula_is_what_it_says():
    s = state(temperature_joint2=np.linspace(20.0, 30.0, 5))
    q, v, a = s.q.T, s.v.T, s.a.T
    for text, expected in {
        "sin(3*q2)*v1": np.sin(3 * q[1]) * v[0],
        "-v**2 + +a2/4 - 1e-3": -(v[0] ** 2) + a[1] / 4 - 1e-3,
        "tau_model2 * load": s.torque[:, 1] * s.load[:, 0],
        "exp(-abs(v2)/0.1)*sign(v2)": np.exp(-np.abs(v[1]) / 0.1) * np.sign(v[1]),
        "temperature2 - 25": np.linspace(-5.0, 5.0, 5),
        "t": s.t - 9.0,
        "2*pi": np.full(5, 2 * np.pi),
        "tanh(q)*cos(q)/tan(q2) + sqrt(abs(q)) + log(q**2)": np.tanh(q[0]) * np.cos(q[0]) / np.tan(q[1])
        + np.sqrt(np.abs(q[0])) + np.log(q[0] ** 2),
        "2**-0.5*(q1 - (q2))": (q[0] - q[1]) / math.sqrt(2),
    }.items():  # fmt: skip
        np.testing.assert_allclose(value(text, s), expected, rtol=1e-12, err_msg=text)
    np.testing.assert_array_equal(value("v", s, "joint2"), s.v[:, 1])


def test_numbers_are_those_of_parameter_names():
    s = state("mixed mimic")
    np.testing.assert_array_equal(value("q3", s, "turn"), s.q[:, 2])
    with pytest.raises(UnknownNameError, match=r"q5.*3 elbow"):  # a mimic joint has no motion of its own
        value("q5", s, "turn")


def test_columns_and_channels():
    machine = robot("planar2")
    effect = Formula(("joint2",), expression="temperature * v1 + temperature1")
    (column,) = effect.columns(machine)
    assert column.name == "c[temperature*v1+temperature1]2"
    assert column.unit == "N·m/[temperature*v1+temperature1]"
    assert set(effect.channels(machine)) == {"temperature_joint1", "temperature_joint2"}
    with pytest.raises(UnknownNameError, match="temperature_joint"):
        effect.terms(state())
    assert len(Formula().columns(machine)) == 2
    assert Formula.candidates(machine) == []


@pytest.mark.parametrize(("text", "where"), [("q q", "character 3"), ("q +", "its end")])
def test_where_a_formula_is_none_is_said_and_nothing_of_pythons(text, where):
    with pytest.raises(InputError, match=rf"not an expression \(invalid syntax at {where}\)"):
        value(text, state())


@pytest.mark.parametrize(
    ("text", "says"), [("1/0", "no finite"), ("log(-1)", "no finite"), ("exp(exp(exp(9)))", "guard")]
)
def test_what_has_no_value_is_refused(text, says):
    with pytest.raises(InputError, match=says):
        value(text, state())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("q9", "known variables|did you mean"),
        ("speed", "tau_model"),
        ("sine(q)", "sin"),
        ("qq1", r"of the joint itself or with a joint.s number \(v2\)\).*all: a, load, pi, q, t"),
    ],
)
def test_wrong_names_say_what_exists(text, says):
    with pytest.raises(UnknownNameError, match=says):
        value(text, state())


ATTACKS = [
    "", "   ", "q.real", "().__class__", "q.__class__.__bases__[0]", "__import__('os')", "open('x')", "eval('1')",
    "lambda: 1", "(lambda x: x)(q)", "[q for q in v]", "{q}", "{1: 2}", "[q]", "(q, v)", "q[0]", "q if v else a",
    "q and v", "not q", "q < v", "q == v", "q := 1", "f'{q}'", "'text'", "b'x'", "True", "None", "...", "1j",
    "q @ v", "q // v", "q % v", "q << 2", "~q", "sin", "sin()", "sin(q, v)", "sin(x=q)", "sin(*q)", "q; v", "q\nv",
    "import os", "del q", "9**9**9", "9**9", "q**v", "2**(1+1)", "q**1e9", "q**-9", "q**True", "1e400", "9" * 200,
    "await q", "yield q", "print(q)", "getattr(q, 'x')", "sin.__call__(q)", "(sin)(cos)", "\x00", "q\x00", "0x1for x",
    "(" * 250 + "q" + ")" * 250, "-" * 400 + "q", "(" * 100, "q" * 301, "@q", "$", "é", "q²", "#", "q = 1", "١",
]  # fmt: skip


@pytest.mark.parametrize("text", ATTACKS)
def test_nothing_but_arithmetic(text):
    with pytest.raises(InputError):
        Formula(expression=text)


@pytest.mark.parametrize("wrong", [3.0, None, ["q"], b"q"])
def test_an_expression_is_a_text(wrong):
    with pytest.raises(InputError, match="must be a text"):
        Formula(expression=wrong)


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text):
    with contextlib.suppress(InputError):
        Expression.parse(text)


@given(st.text(alphabet="qva12t+-*/(). sincoexpablg", max_size=40))
def test_what_is_read_evaluates_to_numbers(text):
    try:
        found = Expression.parse(text)
    except InputError:
        return
    values = dict.fromkeys(found.variables, np.array([0.5, -2.0]))
    assert found(values).dtype == float


def test_every_function_is_usable():
    for name in ALLOWED_FUNCTIONS:
        assert np.isfinite(value(f"{name}(1.5)", state())).all()


def test_the_longest_chain_that_fits():
    text = "+".join(["v1"] * 100)
    np.testing.assert_allclose(value(text, state()), 100 * state().v[:, 0])
