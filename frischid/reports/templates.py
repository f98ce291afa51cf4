"""HTML from templates: Jinja2 with autoescape on, so that no text from a file becomes markup.

Templates are in `templates/`, one per chapter; `macros.html` holds the parts that chapters share: tables, figures,
commands. A name that a template does not know raises an error instead of leaving a gap. Only plotly.js and the figures'
JSON are inserted unescaped, both as `Markup` made here or in `page`.
"""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from frischid.figures import Drawing
from frischid.figures.style import typeset

TAG = re.compile(r"<(?!br>|extra></extra>)")
"""A tag that is none of the two of figures; plotly would show a name such as ``<b>x</b>`` without its letters."""


@cache
def environment() -> Environment:
    """The one environment of all templates."""
    found = Environment(
        loader=PackageLoader("frischid.reports", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.filters |= {"typeset": typeset, "spec": spec}
    return found


def render(template: str, values: Mapping[str, Any]) -> Markup:
    """A template filled in, as HTML that other templates insert as it is."""
    return Markup(environment().get_template(template).render(values))


@cache
def packed_plotly() -> dict[str, Any]:
    """plotly.js as a page holds it: packed by zlib, in base64, beside the comment that names its licence.

    ``unpack.js`` in the page puts it back, in any browser: a page has 2.9 MB less.
    """
    source = get_plotlyjs()
    packing = zlib.compressobj(9, wbits=-zlib.MAX_WBITS)
    packed = base64.b64encode(packing.compress(source.encode()) + packing.flush()).decode()
    licence = Markup(source[source.index("/**") : source.index("*/") + 2])
    return {"packed": Markup(packed), "size": len(source.encode()), "licence": licence}


def spec(drawing: Drawing) -> Markup:
    """A figure as JSON for a script element; "<" is escaped, because it could end the element early.

    Values that the page's script can put back are left out: of a trace with the x of an earlier one, the number of that
    trace stands for its x; the residual of another model is the measured torque less that model's.
    """
    figure = json.loads(str(drawing.figure.to_json()))
    first: dict[str, int] = {}
    for k, trace in enumerate(figure["data"]):
        if isinstance(trace.get("x"), dict):
            earlier = first.setdefault(trace["x"]["bdata"], k)
            trace["x"] = trace["x"] if earlier == k else earlier
        if trace.get("meta", {}).get("residual"):
            del trace["y"]
    text = TAG.sub("&lt;", json.dumps(figure, separators=(",", ":"), ensure_ascii=False))
    return Markup(text.replace("<", "\\u003c"))
