"""Checks that find faults in a log; each file is one family of checks and states its principle.

`inspect` runs them all and returns a `LogReport` of figures and `LogIssue` objects; `defects` looks through a file that
cannot be read. Nothing is repaired.
"""

from frischid.checks.defects import defects
from frischid.checks.log_issue import LogIssue, LogReport
from frischid.checks.report import inspect

__all__ = ["LogIssue", "LogReport", "defects", "inspect"]
