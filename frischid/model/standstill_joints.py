"""Joints that never move in a log, so that no error of the model can be measured there.

At standstill dry friction takes any value up to break-away, and the model makes no prediction: no torque sample of the
joint counts. The other joints are judged by the model without the rows of that joint. Its columns stay: the position at
which it stands acts on their torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from frischid.core.text import listed
from frischid.model.model import Model

STANDSTILL_LOG = (
    "A log at standstill shows gravity at most, and only up to the dry friction: give the files of several poses "
    "together, or record a motion of all joints (frischid excite plans one)"
)


def rows_of(model: Model, kept: NDArray[np.bool_]) -> Model:
    """The model with the torque rows of some of its joints.

    Parameters
    ----------
    kept : ndarray of bool, shape (J,)
        The rows, in the order of ``model.joints``.

    Returns
    -------
    Model
        The same parameters; its `joints` are those kept.
    """
    if kept.all():
        return model
    e, fitted = model.estimate, model.fitted
    joints = tuple(name for name, stays in zip(e.joints, kept, strict=True) if stays)
    if fitted is not None:
        fitted = replace(
            fitted,
            velocity=fitted.velocity[kept],
            acceleration=fitted.acceleration[kept],
            scores=fitted.scores[:, kept],
            model_share=fitted.model_share[kept],
            spread=fitted.spread[kept],
        )
    return replace(
        model,
        estimate=replace(e, joints=joints, sigma=e.sigma[kept], weights=e.weights[kept]),
        mean_torque=model.mean_torque[kept],
        fitted=fitted,
    )


def standstill_note(names: Sequence[str]) -> str:
    """Warn of figures that a log without motion of some joints cannot give; empty where all move."""
    if not names:
        return ""
    never = "it does not move" if len(names) == 1 else "they do not move"
    return (
        f"no error of {listed(names)} can be measured, and no effect found there: {never} in these logs, or the torque "
        "never changes; record a motion of all joints"
    )


def pose_note(poses: int, samples: int) -> str:
    """Parts of a model that poses at standstill show; empty without any."""
    if not poses:
        return ""
    these = "The samples are" if poses == samples else f"{poses} of the {samples} samples are"
    return (
        f"{these} poses of an arm at standstill: they compare gravity only. Dry friction can take any torque up to its "
        "own size there; the noise floor includes the dry friction of the model. Inertia and viscous friction are not "
        "compared: record a motion"
    )
