"""A small language for the user's own columns: arithmetic over a joint's motion, and nothing else.

    expression = number | pi | variable | function(expression) | -expression
               | expression (+ - * /) expression | expression ** number

Python's grammar reads the text (``ast.parse``). A whitelist of node types checks the tree. Then numpy evaluates the
tree. No Python is ever executed: attributes and indices are refused, only the functions named here can be called, and
powers and lengths are bounded.

Source of the method: the ``ast`` module's documentation, https://docs.python.org/3/library/ast.html.
"""

from __future__ import annotations

import ast
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError, UnknownNameError

ALLOWED_FUNCTIONS: dict[str, Callable[[Array], Array]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
    "tanh": np.tanh,
}
ALLOWED_OPERATORS: dict[type[ast.operator], Callable[[Array, Array], Array]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
QUANTITIES = ("q", "v", "a", "load", "tau_model", "temperature")
"""Quantities of a joint: of the joint itself (``v``), or of the joint with a number (``v2``)."""
VARIABLE_NAME = re.compile(rf"({'|'.join(QUANTITIES)})([0-9]*)|t")
LONGEST_EXPRESSION = 300  # characters
LARGEST_POWER = 8.0
LARGEST_NUMBER = 1e100
OF_JOINT = "of the joint itself or with a joint's number (v2)"
ALLOWED_NAMES = f"{', '.join(QUANTITIES)} {OF_JOINT}, t, pi"


@dataclass(frozen=True)
class Expression:
    """A checked expression.

    Attributes
    ----------
    text : str
        As the user wrote it.
    tree : ast.expr
        Its syntax tree, of whitelisted nodes only.
    variables : tuple of str
        Names in the expression, in order of appearance.
    """

    text: str
    tree: ast.expr
    variables: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Expression:
        """Read and check an expression.

        Raises
        ------
        InputError
            The text is not arithmetic, or is too long; UnknownNameError when a name or function does not exist.
        """
        if not isinstance(text, str) or not text.strip():
            raise InputError(f"formula: the expression must be a text such as sin(3*q2)*v1, got {text!r}")
        if len(text) > LONGEST_EXPRESSION:
            raise InputError(
                f"formula: the expression has {len(text)} characters; at most {LONGEST_EXPRESSION} are allowed"
            )
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError, Warning) as error:
            raise InputError(f"formula '{text}': not an expression ({_reason(error)})") from None
        names: dict[str, None] = {}
        _check(tree, text, names)
        return cls(text, tree, tuple(names))

    def __call__(self, values: Mapping[str, Array]) -> Array:
        """Value for given values of `variables`; not finite where the expression is not defined."""
        with np.errstate(all="ignore"):
            return np.asarray(_value(self.tree, values), dtype=float)


def _reason(error: Exception) -> str:
    """Message of Python's parser, without the file name and line number that mean nothing for a formula."""
    if not isinstance(error, SyntaxError):
        return str(error)
    return f"{error.msg} at character {error.offset}" if error.offset else f"{error.msg} at its end"


def _check(node: ast.expr, text: str, names: dict[str, None]) -> None:
    """Refuse every node that is not in the language; collect the variables."""
    match node:
        case ast.Constant() if (number := _number(node)) is not None:
            if not abs(number) <= LARGEST_NUMBER:
                raise InputError(f"formula '{text}': numbers are at most {LARGEST_NUMBER:g}")
        case ast.Name(id="pi"):
            pass
        case ast.Name(id=name):
            if not VARIABLE_NAME.fullmatch(name):
                raise UnknownNameError("variable", name, [*QUANTITIES, "t", "pi"], f"formula '{text}' ({OF_JOINT})")
            names[name] = None
        case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
            _check(operand, text, names)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            _check(left, text, names)
            _check_power(right, text)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in ALLOWED_OPERATORS:
            _check(left, text, names)
            _check(right, text, names)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
            if name not in ALLOWED_FUNCTIONS:
                raise UnknownNameError("function", name, ALLOWED_FUNCTIONS, f"formula '{text}'")
            _check(argument, text, names)
        case _:
            found = ast.get_source_segment(text.strip(), node) or type(node).__name__
            raise InputError(
                f"formula '{text}': '{found}' is not arithmetic; a formula has numbers, + - * / **, parentheses, "
                f"functions of one value ({', '.join(ALLOWED_FUNCTIONS)}) and {ALLOWED_NAMES}"
            )


def _check_power(node: ast.expr, text: str) -> None:
    """Refuse an exponent that is not a plain number of moderate size."""
    signed = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub)
    number = _number(node.operand if isinstance(node, ast.UnaryOp) and signed else node)
    if number is None or not abs(number) <= LARGEST_POWER:
        raise InputError(f"formula '{text}': the exponent after ** must be a number up to {LARGEST_POWER:g}")


def _number(node: ast.expr) -> float | None:
    """The number that a node stands for; None when the node is anything else (a text, True, 2j)."""
    value = node.value if isinstance(node, ast.Constant) else None
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _value(node: ast.expr, values: Mapping[str, Array]) -> Array:
    """Evaluate a checked tree."""
    match node:
        case ast.Constant(value=value):
            return np.asarray(value, dtype=float)
        case ast.Name(id=name):
            return np.asarray(np.pi) if name == "pi" else values[name]
        case ast.UnaryOp(op=op, operand=operand):
            inner = _value(operand, values)
            return -inner if isinstance(op, ast.USub) else inner
        case ast.BinOp(left=left, op=op, right=right):
            return ALLOWED_OPERATORS[type(op)](_value(left, values), _value(right, values))
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            return ALLOWED_FUNCTIONS[name](_value(argument, values))
    raise AssertionError(f"unchecked node {node}")  # `_check` lets nothing else through
