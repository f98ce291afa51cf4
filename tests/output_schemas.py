"""What a command prints with --json has the form of its schema."""

from collections.abc import Sequence
from typing import Any

from jsonschema import Draft202012Validator

from frischid.cli.outputs.schemas import TYPES, schema_of

OPTIONS = {
    ("identify", "output_error"): "identify_output_error",
    ("identify", "--scheduler"): "fleet",
    ("demo", "--practice"): "demo_practice",
}
"""Commands that print something else with one of their options."""


def fits(name: str, data: Any) -> None:
    """An unknown key, a missing key or a wrong type is an error."""
    Draft202012Validator(schema_of(name)).validate(data)


def printed_by(arguments: Sequence[object], data: Any) -> None:
    """Check the JSON that a command line printed; commands without a schema pass."""
    words = [str(word) for word in arguments]
    name = next(
        (other for (command, word), other in OPTIONS.items() if words[0] == command and word in words), words[0]
    )
    if name in TYPES:
        fits(name, data)
