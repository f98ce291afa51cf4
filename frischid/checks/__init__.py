"""Checks that find faults in a log; each file is one family of checks and states its principle.

`inspect` runs them all and returns a `LogReport` of figures and `LogIssue` objects; `defects` looks through a file that
cannot be read. Nothing is repaired; `corrected_urdf` writes a robot whose kinematics a check found wrong.

Start with `report`, which calls the checks in this order:

1. The log alone: `channels`, `clock`, `unsigned`, `standing` (an arm that rests), `velocity`.
2. The torques against the URDF, on a `sketch` (with `sketch_motion`): some filtered samples, on which hypotheses are
   cheap. `physics` asks `explanation`, which compares faults of torques (`torque_faults`), of positions
   (`position_faults`, `degrees`) and of the robot (`robot_faults`, `payload`, `carried_load`). They share `row_fits`
   and the types of `faults` and `hypothesis`. `other_links` and `kinematic_evidence` are rivals: links of other weight.
3. `lag` (of the torque) and `excitation`.

`log_issue` has the results. `long_log` makes one report from those on the pieces of a long log. `defects` and
`robot_fix` stand apart. Every number that decides is a field of `check_criteria.CheckCriteria`.
"""

from frischid.checks.defects import defects
from frischid.checks.log_issue import LogIssue, LogReport
from frischid.checks.report import inspect
from frischid.checks.robot_fix import corrected_urdf

__all__ = ["LogIssue", "LogReport", "corrected_urdf", "defects", "inspect"]
