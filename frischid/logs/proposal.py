"""A proposed mapping: what it says, why, and what in it is only guessed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from frischid.core.text import one_line, quoted


@dataclass
class Proposal:
    """A proposed mapping, and the reasons for it."""

    file: dict[str, object] = field(default_factory=dict)
    """Keys of the table ``[file]``."""
    joints: dict[str, dict[str, str]] = field(default_factory=dict)
    """URDF joint -> channel -> column."""
    reasons: list[str] = field(default_factory=list)
    """The reason for each entry, and the decisions that the reader must make."""
    guesses: list[str] = field(default_factory=list)
    """What neither names nor motion decide."""
    missing: tuple[str, ...] = ()
    """Joints of the URDF without a position column."""
    gains: dict[str, float] = field(default_factory=dict)
    """URDF joint -> joint-side torque per ampere, where the log itself gives it."""
    set_points: list[str] = field(default_factory=list)
    """Columns that the gains come from."""
    units: dict[str, dict[str, float | str]] = field(default_factory=dict)
    """URDF joint -> key of the mapping file -> factor of its torque or current, or unit of its position."""
    full_turns: frozenset[str] = frozenset()
    """Columns that jump by 360: angles in degrees that wrap."""

    def tables(self) -> dict[str, dict[str, Any]]:
        """The mapping as `LogMap.from_dict` takes it."""
        joints = {joint: {**columns, **self.units.get(joint, {})} for joint, columns in self.joints.items()}
        tables: dict[str, dict[str, Any]] = {"file": self.file, "joint": joints, "current_gain": self.gains}
        return {name: table for name, table in tables.items() if table}

    def toml(self, source: str) -> str:
        """Text of the mapping file."""
        lines = [f"# Proposed by `frischid map` for {one_line(source)}. Read it before you use it."]
        lines += [f"# guessed: {one_line(guess)}" for guess in self.guesses]
        lines += [f"# {one_line(reason)}" for reason in self.reasons]
        if self.file:
            lines += [
                "",
                "[file]",
                *(f"{key} = {quoted(value)}" for key, value in self.file.items()),
            ]
        for joint, columns in self.joints.items():
            lines += ["", f"[joint.{quoted(joint)}]"]
            lines += [f"{channel} = {quoted(name)}" for channel, name in columns.items()]
            lines += [f"{key} = {_text(value)}" for key, value in self.units.get(joint, {}).items()]
        if self.gains:
            lines += ["", "[current_gain]  # joint-side torque per ampere: tau = gain * current"]
            lines += [f"{quoted(joint)} = {gain}" for joint, gain in self.gains.items()]
        elif any("current" in c and "tau" not in c for c in self.joints.values()):
            lines += ["", "# Without gains every command works in amperes. If you know the gains, write them here:"]
            lines += ["# [current_gain]  # joint-side torque per ampere, N·m/A (N/A): tau = gain * current"]
            lines += [f"# {quoted(joint)} = GAIN" for joint, c in self.joints.items() if "current" in c]
        return "\n".join(lines) + "\n"


def _text(value: float | str) -> str:
    return quoted(value) if isinstance(value, str) else f"{value:g}"
