"""Errors of one joint on logs that were not fitted, and what they are compared with."""

from __future__ import annotations

from dataclasses import dataclass

from frischid.model.error_sums import Worst


@dataclass(frozen=True)
class JointFit:
    """Errors of one joint.

    Attributes
    ----------
    name : str
        The joint.
    rmse, bias : float
        Rms and mean of the residual, N·m (N).
    std : float
        Standard deviation of the measured torque, N·m (N).
    nrmse : float
        Rms residual over the standard deviation of the measured torque.
    fit : float
        100 (1 − nrmse): 100 is perfect, 0 as good as the mean torque.
    nominal, constant : float
        NRMSE of the URDF's links with fitted friction, and of a constant torque.
    noise_floor : float
        NRMSE that the noise of the sensors alone would make.
    expected : float
        NRMSE to expect from the model's own uncertainty.
    worst : Worst
        The largest residual, N·m (N), and its time.
    """

    name: str
    rmse: float
    nrmse: float
    fit: float
    bias: float
    std: float
    nominal: float
    constant: float
    noise_floor: float
    expected: float
    worst: Worst
