"""The command `schema`: JSON Schemas of outputs and files."""

from __future__ import annotations

import json

import click

from frischid.cli.arguments import json_option
from frischid.cli.group import main
from frischid.cli.output import show_page
from frischid.errors import UnknownNameError


@main.command()
@click.argument("name", required=False)
@json_option
def schema(name: str | None, as_json: bool) -> None:
    """Print the JSON Schema of an output or a file. Without NAME, list the names."""
    from frischid.cli.outputs.schemas import TYPES, schema_of
    from frischid.cli.pages.page import Page

    if name is None:
        show_page(Page(list(TYPES), [", ".join(TYPES)]), as_json)
        return
    if name not in TYPES:
        raise UnknownNameError("schema", name, tuple(TYPES))
    click.echo(json.dumps(schema_of(name), indent=1))
