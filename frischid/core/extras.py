"""The optional parts of an installation, and the command that adds one.

An extra is a name for packages that only some commands need. The command to install names these packages, as the
installed metadata do, so it is right for a checkout, a wheel and a registry alike.
"""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from importlib import metadata
from pathlib import Path

PURPOSE = {
    "fetch": "public logs of real robots",
    "ros": "ROS bags and MCAP files",
    "studio": "the page to work in",
    "cluster": "Dask and remote files",
}
"""The optional parts, and what each is for."""

_EXTRA = re.compile(r"extra\s*==\s*['\"](\w+)['\"]")


def packages(extra: str | None = None) -> tuple[str, ...]:
    """Requirements of an optional part, each with its version; None: those that are always needed.

    Examples
    --------
    >>> from frischid.core.extras import packages
    >>> [text.split(">")[0] for text in packages("ros")]
    ['mcap', 'rosbags']
    """
    found = []
    for text in metadata.requires("frischid") or ():
        requirement, _, marker = text.partition(";")
        match = _EXTRA.search(marker)
        if (None if match is None else match[1]) == extra:
            found.append(requirement.strip())
    return tuple(dict.fromkeys(found))


def name_of(requirement: str) -> str:
    """The package that a requirement names.

    >>> name_of("mcap>=1.2")
    'mcap'
    """
    return re.split(r"[^\w.-]", requirement, maxsplit=1)[0]


def installed(requirement: str) -> str | None:
    """Version of the package that a requirement names; None where it is not installed."""
    try:
        return metadata.version(name_of(requirement))
    except metadata.PackageNotFoundError:
        return None


def install_command(extra: str) -> str:
    """The command that installs an optional part.

    >>> from frischid.core.extras import install_command
    >>> 'pip install "pooch' in install_command("fetch")
    True
    """
    beside = shutil.which("pip")
    here = beside is not None and Path(beside).parent == Path(sys.executable).parent
    pip = "pip" if here else f"{shlex.quote(sys.executable)} -m pip"  # another pip would install elsewhere
    return " ".join([pip, "install", *(f'"{text}"' for text in packages(extra))])
