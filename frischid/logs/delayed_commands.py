"""Commands as they act: later than their stamps, along a curve or held; and the velocity beside which they act.

u(t) = c(t − d)                        c a curve of local cubics through the commands
u(t) = (1 / T) ∫ c(s − d) ds           over s from t − T to t, for a command that is held for a step T
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import Akima1DInterpolator, CubicSpline

from frischid.core.types import Array
from frischid.logs.log import Log


def velocity_of(log: Log) -> Array:
    """Velocities (N, J): measured where the log has them, otherwise the slope of the spline through the positions."""
    slope = np.asarray(CubicSpline(log.t, log.q)(log.t, 1))
    return slope if log.v is None else np.where(log.has("v"), log.v, slope)


def delayed(t: Array, command: Array, delay: float, held: bool = False) -> Array:
    """A command (N,) as it acts at the times t (N,), `delay` s after its stamp; before the first, the first.

    Between two samples lies a cubic that does not overshoot at a step. A straight line would make a motion of frequency
    ω smaller by up to ω² T² / 8, which is like an armature of kp T² / 8. A held command is the mean of this curve over
    the last step T of the log: the hold delays a motion by T / 2 and makes it smaller by ω² T² / 24.

    Parameters
    ----------
    t : ndarray, shape (N,)
    command : ndarray, shape (N,)
    delay : float
        s, not negative.
    held : bool
        Whether the drive keeps a command until the next one.

    Returns
    -------
    ndarray, shape (N,)

    Examples
    --------
    >>> import numpy as np
    >>> from frischid.logs.delayed_commands import delayed
    >>> t = np.arange(0.0, 2.0, 0.1)
    >>> late, held = delayed(t, np.sin(t), 0.1), delayed(t, np.sin(t), 0.05, held=True)
    >>> bool(np.abs(late - held)[3:].max() < 1e-3)  # the curve has no neighbour before the first command
    True
    """
    if not held:
        return command if delay == 0.0 else np.asarray(_curve(t, command)(np.maximum(t - delay, t[0])))
    step = float(np.median(np.diff(t)))
    whole = _curve(np.append(t[0] - step - delay, t), np.append(command[0], command)).antiderivative()
    return np.asarray((whole(t - delay) - whole(np.maximum(t - delay - step, t[0] - step - delay))) / step)


def _curve(t: Array, command: Array) -> Akima1DInterpolator:
    """Local cubics through the commands; Akima 1970, J. ACM 17(4), with the weights of MATLAB's makima."""
    return Akima1DInterpolator(t, command, method="makima")
