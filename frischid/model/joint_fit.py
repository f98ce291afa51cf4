"""Errors of joints on logs that were not fitted, and the sums over blocks of samples from which they are computed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from frischid.core.types import Array


@dataclass(frozen=True)
class Worst:
    """The sample with the largest error of a joint."""

    source: str
    t: float
    measured: float
    predicted: float


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


@dataclass(eq=False)
class TorqueSums:
    """Running sums of the measured torque over the samples of all joints."""

    joints: int
    count: Array = field(init=False)
    tau: Array = field(init=False)
    tau2: Array = field(init=False)

    def __post_init__(self) -> None:
        self.count, self.tau, self.tau2 = np.zeros((3, self.joints))

    def add_torque(self, measured: Array, used: Array) -> None:
        """Add torques and whether they count, (M, J)."""
        self.count += used.sum(axis=0)
        self.tau += (measured * used).sum(axis=0)
        self.tau2 += (measured**2 * used).sum(axis=0)

    @property
    def std(self) -> Array:
        """Standard deviation of each joint's torque, shape (J,)."""
        count = np.maximum(self.count, 1)
        return np.asarray(np.sqrt(np.maximum(self.tau2 / count - (self.tau / count) ** 2, 0.0)))

    @property
    def changing(self) -> NDArray[np.bool_]:
        """Joints that move with a torque that changes, (J,): only their errors can be measured."""
        rms = np.sqrt(self.tau2 / np.maximum(self.count, 1))
        return np.asarray((self.count >= 2) & (self.std > 1e-7 * rms))


@dataclass(eq=False)
class ErrorSums(TorqueSums):
    """The same with the sums of a model's errors."""

    samples: int = 0
    error: Array = field(init=False)
    error2: Array = field(init=False)
    nominal2: Array = field(init=False)
    worst: list[Worst | None] = field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.error, self.error2, self.nominal2 = np.zeros((3, self.joints))
        self.worst = [None] * self.joints

    def add(self, t: Array, measured: Array, predicted: Array, nominal: Array, used: Array, source: str) -> None:
        """Add samples: times (M,), torques and whether they count, (M, J)."""
        self.add_torque(measured, used)
        residual = (measured - predicted) * used
        self.samples += len(t)
        self.error += residual.sum(axis=0)
        self.error2 += (residual**2).sum(axis=0)
        self.nominal2 += ((measured - nominal) ** 2 * used).sum(axis=0)
        for j, i in enumerate(np.abs(residual).argmax(axis=0)):
            before = self.worst[j]
            if before is None or abs(residual[i, j]) > abs(before.measured - before.predicted):
                self.worst[j] = Worst(source, float(t[i]), float(measured[i, j]), float(predicted[i, j]))

    def of(self, kept: NDArray[np.bool_]) -> ErrorSums:
        """The sums of some joints, (J,)."""
        found = ErrorSums(int(kept.sum()), self.samples)
        for name in ("count", "tau", "tau2", "error", "error2", "nominal2"):
            setattr(found, name, getattr(self, name)[kept])
        found.worst = [worst for worst, stays in zip(self.worst, kept, strict=True) if stays]
        return found
