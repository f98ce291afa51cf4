"""Words and units in the names of columns: which quantity, which clock, which set point a name says.

The lists are English, German, French, Spanish and Italian. A unit names a quantity too: a column in N is a force.
"""

from __future__ import annotations

import re

CHANNEL_WORDS = {
    "q": {
        *("q", "pos", "position", "positions", "angle", "angles", "theta", "qpos", "enc", "encoder"),
        *("winkel", "stellung", "lage", "posicion", "angulo", "posizione"),
        *("pulse", "pulses", "counts", "increments"),
    },
    "v": {
        *("v", "qd", "dq", "qdot", "vel", "velo", "velocity", "velocities", "speed", "qvel", "omega"),
        *("geschwindigkeit", "geschw", "drehzahl", "vitesse", "velocidad", "velocita"),
    },
    "a": {"a", "qdd", "ddq", "qddot", "acc", "acceleration", "qacc", "beschleunigung"},
    "tau": {
        *("tau", "torque", "torques", "effort", "eff", "moment", "force", "load", "trq"),
        *("drehmoment", "kraft", "couple", "par", "coppia"),
    },
    "current": {"i", "current", "currents", "cur", "amp", "amps", "iq", "strom", "courant", "corriente", "corrente"},
    "qcmd": {"qcmd"},
    "vcmd": {"vcmd"},
    "tauff": {"tauff"},
}
DERIVATIVES = {1: "qdot", 2: "qddot"}
"""Word of a derivative of a position, by its order."""
ALL_CHANNEL_WORDS = frozenset().union(*CHANNEL_WORDS.values())
COMMANDS = {"q": "qcmd", "v": "vcmd"}
"""Channel of a set point, by the channel of the quantity that is set. A desired torque or current has none: whether
it is a feed-forward, or the sum of all that the controller asks for, no name tells."""
SETPOINT_WORDS = {
    "des",
    "desired",
    "ref",
    "reference",
    "cmd",
    "command",
    "commanded",
    "target",
    "setpoint",
    "goal",
    "soll",
    "planned",
}
OTHER_WORDS = {
    *("temperature", "temp", "voltage", "status", "mode", "index", "count", "error", "seq", "seqno", "sequence"),
    *("tcp", "cartesian", "wrench", "pose"),
    *("dist", "disturbance"),
}
"""Words of columns that are no channel of a joint: states, counters, the tool's pose and force, and the part of the
torque that a controller's own model does not explain."""
TIME_WORDS = {
    *("t", "time", "stamp", "timestamp", "sec", "secs", "seconds", "nsec", "nanosec", "clock", "datetime", "date"),
    *("zeit", "tm", "ipoc", "ts"),
}
CLOCK_UNITS = {"ms", "us", "µs", "ns", "s"}
MEASURED_WORDS = {"actual", "act", "measured", "meas", "present", "ist", "feedback", "fbk"}
FILLER_WORDS = MEASURED_WORDS | {
    "joint",
    "joints",
    "link",
    "axis",
    "achse",
    "achs",
    "gelenk",
    "state",
    "states",
    "robot",
    "arm",
    "actuator",
    "actuators",
    "j",
    "",
}
COMPOUND = "achs|gelenk|motor|ist|soll"
"""First parts of German compounds that end in a quantity."""
LEAST_OF_COMPOUND = 4
"""Letters. Shorter quantities also end other words."""
CHANNEL_OF_UNIT = {
    **dict.fromkeys(("rad", "deg", "°", "mm", "m"), "q"),
    **dict.fromkeys(("rad/s", "deg/s", "°/s", "mm/s", "m/s", "rpm"), "v"),
    **dict.fromkeys(("rad/s^2", "rad/s²", "deg/s^2", "deg/s²", "m/s^2", "m/s²"), "a"),
    **dict.fromkeys(("nm", "n·m", "n*m", "n m", "mnm", "nmm", "ncm", "n·cm", "n·mm", "knm", "n", "kn"), "tau"),
    **dict.fromkeys(("a", "ma"), "current"),
}
"""Channel of a quantity by its unit, in small letters."""
LETTER_OF_UNIT = {"q": "m", "tau": "N", "current": "A"}
"""Unit of one letter, by the channel. At the end of a name the letter may also tell two joints apart."""


def unit_of(name: str) -> tuple[str, str]:
    """Unit that a column's name ends with or has in brackets (empty: none), and the name without the unit.

    >>> unit_of("Achse 1 Moment [Nm]"), unit_of("axis1_current_mA"), unit_of("q[3]")
    (('nm', 'Achse 1 Moment'), ('ma', 'axis1_current'), ('', 'q[3]'))
    >>> unit_of("X_vel_m_s"), unit_of("boom_torque_kNm")
    (('m/s', 'X_vel'), ('knm', 'boom_torque'))
    """
    if bracket := re.search(r"[\[(<]([^\])>]*[^\])>\d\s][^\])>]*)[\])>]", name):
        return bracket[1].strip().lower(), (name[: bracket.start()] + name[bracket.end() :]).strip(" _")
    end = re.fullmatch(
        r"(.+?)[_ ](mA|kNm|kN|mNm|Nmm|Ncm|Nm|(?:mm|m|deg|rad)[_/]s|mm|deg|rad|rpm|pct|percent|ms|us|ns)", name
    )
    return (end[2].lower().replace("_", "/"), end[1]) if end else ("", name)
