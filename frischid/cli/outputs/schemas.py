"""JSON Schemas (draft 2020-12) of the outputs and of the files of JSON, from their types."""

from __future__ import annotations

from typing import Any

import msgspec

from frischid.cli.outputs import fleets, masses_and_exports, models, robots_and_logs
from frischid.cli.outputs.diagnoses import DiagnosisOutput
from frischid.model.model_records import ModelRecord

DIALECT = "https://json-schema.org/draft/2020-12/schema"
OUTPUTS: dict[str, Any] = {
    "info": list[str] | robots_and_logs.RobotOutput,
    "fetch": list[robots_and_logs.DatasetOutput] | robots_and_logs.FetchedOutput,
    "map": robots_and_logs.MapOutput,
    "check": robots_and_logs.CheckOutput,
    "cut": robots_and_logs.CutOutput,
    "excite": robots_and_logs.PlanOutput,
    "simulate": robots_and_logs.SimulateOutput,
    "effects": list[robots_and_logs.EffectOutput] | robots_and_logs.EffectOutput,
    "doctor": robots_and_logs.DoctorOutput,
    "paper": robots_and_logs.PaperOutput,
    "studio": robots_and_logs.StudioOutput,
    "identify": models.IdentifyOutput,
    "compare": models.CompareOutput,
    "diagnose": DiagnosisOutput,
    "add": models.AddOutput,
    "improve": models.ImproveOutput,
    "history": models.HistoryOutput,
    "report": models.ReportOutput,
    "payload": masses_and_exports.PayloadOutput,
    "gains": masses_and_exports.GainsOutput,
    "consistent": masses_and_exports.ConsistentOutput,
    "export": masses_and_exports.ExportOutput,
    "fleet": fleets.FleetOutput,
    "demo": models.DemoOutput,
}
"""Command -> type of what it prints."""
FURTHER: dict[str, Any] = {
    "identify_output_error": models.MovedOutput,
    "demo_practice": robots_and_logs.PracticeOutput,
    "model_file": ModelRecord,
    "mapping_file": robots_and_logs.MappingFile,
    "actuator_file": masses_and_exports.ActuatorFile,
}
"""Outputs of some options, and files that no command prints."""
TYPES = OUTPUTS | FURTHER


def schema_of(name: str) -> dict[str, Any]:
    """The JSON Schema of an output or a file.

    Parameters
    ----------
    name : str
        One of `TYPES`.

    Examples
    --------
    >>> from frischid.cli.outputs.schemas import schema_of
    >>> schema_of("cut")["$defs"]["CutOutput"]["required"]
    ['output', 'samples', 'seconds']
    """
    schema = msgspec.json.schema(TYPES[name])
    for part in schema.get("$defs", {}).values():
        if "properties" in part:  # a dataclass says nothing of further keys
            part.setdefault("additionalProperties", False)
    return {"$schema": DIALECT, "title": f"frischid {name}", **schema}
