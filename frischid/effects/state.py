"""Input and output of an effect: a stretch of motion goes in, columns of the regressor come out.

    τ_j = Σ_terms rows_j(state) θ_term

`State` holds the motion and the torque of the reference parameters along it. `Term` is one column with its parameter's
name, unit and known sign. Derivatives and delays of a channel are those of the spline through its samples.

Source of the splines: de Boor 2001, A Practical Guide to Splines, Springer.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from frischid.core.types import Array, Column
from frischid.effects.dynamics import RigidDynamics, Slopes
from frischid.errors import InputError
from frischid.robot.robot import Robot

SIGN_WIDTH = 0.005
"""Speed over which the sign of a speed is smoothed, rad/s (m/s). At standstill the measured speed is noise, so its sign
is random."""
NO_SIGN = 1e300
"""rad/s (m/s). Width at which every smoothed sign is zero: an effect of this width has no dry friction."""


@dataclass(frozen=True, eq=False)
class State:
    """A stretch of motion, the input of an effect.

    Attributes
    ----------
    robot : Robot
    t : ndarray, shape (N,)
        Time, s.
    q, v, a : ndarray, shape (N, J)
        Joint positions (rad, m), velocities and accelerations.
    load : ndarray, shape (N, J)
        Rigid-body torque of the reference parameters, N·m (N); zero unless the effect is `Effect.loaded`.
    torque : ndarray, shape (N, J)
        Torque of the reference parameters with all columns that come before this effect's, N·m (N); zero unless the
        effect is `Effect.loaded`.
    start : float
        Time at which the log begins, s.
    extra : mapping of str to ndarray, shape (N,)
        Other channels of the log, for example ``temperature_<joint>``.
    reference : ndarray, shape (R,), optional
        Reference values of ``robot.columns``, from which `load` is computed; None: the URDF's own.
    dry : ndarray, shape (J,), optional
        Dry friction according to the reference parameters, N·m (N); None: unknown, counts as zero.

    Examples
    --------
    >>> from frischid.effects import State, Viscous
    >>> from frischid.robot.robot import Robot
    >>> [term.column.name for term in Viscous().terms(State.empty(Robot.load("planar2")))]
    ['fv1', 'fv2']
    """

    robot: Robot
    t: Array
    q: Array
    v: Array
    a: Array
    load: Array
    torque: Array
    start: float = 0.0
    extra: Mapping[str, Array] = dataclasses.field(default_factory=dict)
    reference: Array | None = None
    dry: Array | None = None

    @classmethod
    def empty(cls, robot: Robot) -> State:
        """A motion without samples: it asks an effect only for the names and units of its columns."""
        none = np.empty((0, len(robot.joints)))
        return cls(robot, np.empty(0), none, none, none, none, none)

    @cached_property
    def rigid(self) -> RigidDynamics:
        """Rigid-body dynamics of the reference parameters, for states other than the measured ones."""
        return RigidDynamics.of(self.robot, self.reference)

    @cached_property
    def slopes(self) -> Slopes:
        """Derivatives of the reference's rigid torque along this motion."""
        return self.rigid.slopes(self.q, self.v, self.a)

    def rates(self, x: Array) -> tuple[Array, Array]:
        """First and second time derivative of a channel (N,) or of several (N, ...), by a spline.

        Raises
        ------
        InputError
            The times do not increase, so nothing can be differentiated.
        """
        degree = min(5, len(self.t) - 1)
        if degree < 2:
            return np.zeros_like(x), np.zeros_like(x)
        spline = self._spline(x, degree)
        return np.asarray(spline.derivative(1)(self.t)), np.asarray(spline.derivative(2)(self.t))

    def earlier(self, x: Array, by: float) -> Array:
        """Channels (N, ...) as they were `by` seconds earlier, or later where `by` is negative, by a spline.

        Raises
        ------
        InputError
            The times do not increase.
        """
        if len(self.t) < 2:
            return x
        spline = self._torque_spline if x is self.torque else self._spline(x, min(3, len(self.t) - 1))
        return np.asarray(spline(np.clip(self.t - by, self.t[0], self.t[-1])))

    def require_times(self) -> None:
        """Raise InputError unless the times increase from sample to sample."""
        if (np.diff(self.t) <= 0).any():
            raise InputError(
                "an effect needs the torque's past and its rate: give the samples' times, in increasing order"
            )

    @cached_property
    def _torque_spline(self) -> BSpline:
        return self._spline(self.torque, min(3, len(self.t) - 1))  # once, for delays of every size

    def _spline(self, x: Array, degree: int) -> BSpline:
        self.require_times()
        return make_interp_spline(self.t, x, k=degree)


@dataclass(frozen=True, eq=False)
class Term:
    """One column that an effect adds.

    Attributes
    ----------
    column : Column
        Name, unit, joint, effect and known sign of its parameter.
    rows : dict of int to ndarray, shape (N,)
        Index of a joint -> torque on that joint per unit of the parameter; zero on joints that are absent.
    """

    column: Column
    rows: Mapping[int, Array]
