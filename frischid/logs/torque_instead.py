"""Where the torque of a log without a torque column may come from: the remedy in an error message."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

_FROM_CURRENTS = (
    "currents become torques by [current_gain] in a mapping file (--map); `frischid gains` finds the gains from logs "
    "with and without a known payload"
)
_FROM_COMMANDS = "commanded positions become torques by --controller pd --kp ... (controller=frischid.PDController)"
_FROM_COMMANDS_LATER = (
    "the model was fitted to torques; commanded positions need a model from `frischid identify ROBOT LOG --controller "
    "pd --kp ...` (controller=frischid.PDController)"
)
_FROM_CTRL = (
    "MuJoCo's ctrl is a commanded position with position actuators (qcmd = 'ctrl_{joint}' under [default] in a mapping "
    "file, and --controller pd --kp ...), and a torque only with motors of gear 1 (tau = 'ctrl_{joint}'); "
    "qfrc_actuator is the torque with every actuator"
)
_FROM_CTRL_LATER = (
    "MuJoCo's ctrl is a torque only with motors of gear 1 (tau = 'ctrl_{joint}' under [default] in a mapping file); "
    "qfrc_actuator is the torque with every actuator"
)
_NOT_RECORDED = (
    "if torques, currents or commanded positions were recorded under other names, name their columns in a mapping "
    "file (`frischid map LOG ROBOT -o map.toml` proposes one); if not, record one of them"
)


def torque_instead(columns: Iterable[str], joints: Sequence[str], fitted: bool) -> str:
    """What to do about a log without torques, by the names of its columns.

    Parameters
    ----------
    joints : sequence of str
        Of the log: ``current_limit`` is the current of no joint.
    fitted : bool
        Whether the log is for a model that was fitted to torques.
    """
    kinds = {kind for name in columns for kind, _, of in [name.partition("_")] if of in joints or kind == "ctrl"}
    found = [_FROM_CURRENTS] if "current" in kinds else []
    if "qcmd" in kinds:
        found.append(_FROM_COMMANDS_LATER if fitted else _FROM_COMMANDS)
    elif "ctrl" in kinds:
        found.append(_FROM_CTRL_LATER if fitted else _FROM_CTRL)
    return "; ".join(found or [_NOT_RECORDED])
