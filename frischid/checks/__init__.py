"""Checks that find faults in a log; each file is one family of checks and states its principle.

`inspect` runs them all and returns a `LogReport` of figures and `LogIssue` objects; `defects` looks through a file that
cannot be read. Nothing is repaired; `corrected_urdf` writes a robot whose kinematics a check found wrong.
"""

from frischid.checks.defects import defects
from frischid.checks.log_issue import LogIssue, LogReport
from frischid.checks.report import inspect
from frischid.checks.robot_fix import corrected_urdf

__all__ = ["LogIssue", "LogReport", "corrected_urdf", "defects", "inspect"]
