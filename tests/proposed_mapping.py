"""Reading a file as `frischid map` proposes."""

from frischid.logs.mapping import LogMap
from frischid.logs.mapping_guess import propose
from frischid.logs.readers import read_log


def mapped(path, robot):
    """The proposal for a file, and the log that the proposed mapping reads."""
    found = propose(path, robot)
    form = path.with_suffix(".toml")
    form.write_text(found.toml(path.name), encoding="utf-8")
    return found, read_log(path, robot.joints, LogMap.load(form))
