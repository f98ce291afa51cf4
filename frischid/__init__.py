"""frischid: which dynamic parameters of a robot can be identified, their values, and how far to trust them.

    >>> import frischid as fr
    >>> robot = fr.Robot.load("arm.urdf")
    >>> found = fr.identify(robot, [fr.read_log("motion.parquet", robot.joints)])
    >>> found.model.save("model.json")

Names are imported when first used, so that ``import frischid`` and ``frischid --help`` cost nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from frischid.diagnosis.diagnosis import Diagnosis as Diagnosis
    from frischid.diagnosis.diagnosis import diagnose as diagnose
    from frischid.diagnosis.improvement import add as add
    from frischid.diagnosis.improvement import improve as improve
    from frischid.effects import BASELINE as BASELINE
    from frischid.effects import EFFECTS as EFFECTS
    from frischid.effects import Effect as Effect
    from frischid.effects import parse_effects as parse_effects
    from frischid.errors import FrischidError as FrischidError
    from frischid.errors import InputError as InputError
    from frischid.export.consistency import Consistency as Consistency
    from frischid.export.consistency import make_consistent as make_consistent
    from frischid.export.drive_gains import Gains as Gains
    from frischid.export.drive_gains import find_gains as find_gains
    from frischid.export.urdf import Export as Export
    from frischid.export.urdf import export as export
    from frischid.logs.log import Log as Log
    from frischid.logs.mapping import LogMap as LogMap
    from frischid.logs.readers import read_chunks as read_chunks
    from frischid.logs.readers import read_log as read_log
    from frischid.logs.readers import write_log as write_log
    from frischid.logs.recording import Recording as Recording
    from frischid.model.comparison import Comparison as Comparison
    from frischid.model.comparison import compare as compare
    from frischid.model.identification import Identification as Identification
    from frischid.model.identification import identify as identify
    from frischid.model.model import Model as Model
    from frischid.motions.simulation import Noise as Noise
    from frischid.motions.simulation import simulate as simulate
    from frischid.motions.trajectory import Quintic as Quintic
    from frischid.motions.trajectory import random_fourier as random_fourier
    from frischid.robot.robot import Robot as Robot

_HOME = {
    "Comparison": "model.comparison",
    "compare": "model.comparison",
    "Consistency": "export.consistency",
    "make_consistent": "export.consistency",
    "BASELINE": "effects",
    "EFFECTS": "effects",
    "Effect": "effects",
    "parse_effects": "effects",
    "Diagnosis": "diagnosis.diagnosis",
    "diagnose": "diagnosis.diagnosis",
    "FrischidError": "errors",
    "InputError": "errors",
    "Export": "export.urdf",
    "export": "export.urdf",
    "Gains": "export.drive_gains",
    "find_gains": "export.drive_gains",
    "Identification": "model.identification",
    "identify": "model.identification",
    "add": "diagnosis.improvement",
    "improve": "diagnosis.improvement",
    "Log": "logs.log",
    "LogMap": "logs.mapping",
    "Model": "model.model",
    "read_chunks": "logs.readers",
    "Recording": "logs.recording",
    "read_log": "logs.readers",
    "write_log": "logs.readers",
    "Robot": "robot.robot",
    "Noise": "motions.simulation",
    "simulate": "motions.simulation",
    "Quintic": "motions.trajectory",
    "random_fourier": "motions.trajectory",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'frischid' has no attribute '{name}'")
    return getattr(import_module(f"frischid.{_HOME[name]}"), name)
