"""The layout of a log among several: the mapping whose columns the file has.

A mapping of several layouts (sections ``[layout.<name>]``, or several files) does not say which log has which. The log
itself does: a layout fits if the file has every column that the layout names. If several fit, the one that names the
most columns is taken. ``logs = ["cell3_*.csv"]`` under ``[file]`` restricts a layout to files of such names.
"""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path

from frischid.errors import InputError
from frischid.logs.bags import is_bag
from frischid.logs.log import CHANNELS
from frischid.logs.mapping import LogMap
from frischid.logs.tables import column_names


def layout_of(path: Path, form: LogMap) -> LogMap:
    """The mapping of one log: the given one, or the layout of it that fits the file.

    Raises
    ------
    InputError
        No layout fits the file, or two fit equally well.
    """
    if not form.layouts:
        return form
    tried = {layout.source: _columns_named(path, layout) for layout in form.layouts}
    found = [layout for layout in form.layouts if isinstance(tried[layout.source], int)]
    if not found:
        why = "; ".join(f"{source}: {reason}" for source, reason in tried.items())
        raise InputError(f"{path}: no layout of the mapping fits this log ({why}); add one (frischid map)")
    most = max(int(tried[layout.source]) for layout in found)
    best = [layout for layout in found if tried[layout.source] == most]
    if any(replace(layout, source="", file=None) != replace(best[0], source="", file=None) for layout in best):
        raise InputError(
            f"{path}: {' and '.join(layout.source for layout in best)} fit this log equally well; restrict one with "
            'logs = ["name*"] under its [file]'
        )
    return best[0]


def _columns_named(path: Path, layout: LogMap) -> int | str:
    """Number of the file's columns that a layout names, or why the layout does not fit."""
    if layout.logs and not any(path.name == pattern or fnmatch(path.name, pattern) for pattern in layout.logs):
        return "is for other names of files"
    if is_bag(path):
        return 0
    try:
        names = column_names(path, layout)
    except InputError as error:
        return str(error)
    named = [getattr(entry, c) for entry in layout.joint.values() for c in CHANNELS]
    wanted = [x for x in (layout.time if layout.rate is None else None, *named) if x is not None]
    missing = [str(x) for x in wanted if not (x in names if isinstance(x, str) else x < len(names))]
    if missing:
        return f"the log has no column {', '.join(missing[:3])}"
    head, tail = layout.default["q"].split("{joint}")
    templates = sum(n.startswith(head) and n.endswith(tail) for n in names)
    return len(wanted) + templates if templates or named else "names no position column of the log"
