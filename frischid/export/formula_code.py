"""A formula's checked tree as an expression for generated code.

Every operation stands in parentheses, and every name becomes the entry of an array: ``v * q2`` of the first joint is
``(v[0] * q[1])``.
"""

from __future__ import annotations

import ast
import math

from frischid.effects.expression import VARIABLE_NAME
from frischid.export.names import number
from frischid.robot.robot import Robot


def written(node: ast.expr, robot: Robot, own: int) -> str:
    """A formula's checked tree as an expression for generated code; names are joints of `robot`, `own` without number.

    Every operation stands in parentheses, so the precedence of a language has no influence.
    """
    match node:
        case ast.Constant(value=int() | float() as value):
            return number(float(value))
        case ast.Name(id="pi"):
            return number(math.pi)
        case ast.Name(id="t"):
            return "t"
        case ast.Name(id=name):
            found = VARIABLE_NAME.fullmatch(name)
            assert found is not None
            quantity = {"tau_model": "torque"}.get(found.group(1), found.group(1))
            numbers = {str(robot.numbers[n]): i for i, n in enumerate(robot.joints)}
            return f"{quantity}[{numbers[found.group(2)] if found.group(2) else own}]"
        case ast.UnaryOp(op=op, operand=operand):
            inner = written(operand, robot, own)
            return f"(-{inner})" if isinstance(op, ast.USub) else inner
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            return f"pow({written(left, robot, own)}, {written(right, robot, own)})"
        case ast.BinOp(left=left, op=op, right=right):
            sign = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}[type(op)]
            return f"({written(left, robot, own)} {sign} {written(right, robot, own)})"
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            return f"{name}({written(argument, robot, own)})"
    raise AssertionError(f"unchecked node {node}")
