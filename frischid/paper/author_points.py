"""The authors' 100 points, one a second, and the noise they were optimised against, where it is known.

The points are not part of frischid: the authors' repository (github.com/massastrello/Robot-Frisch at ed664b7) has no
licence that lets others pass them on. They are read from a file that the reader has:

    final.mat              the authors' own file, with points and noise (variables q, qd, qdd and nq, nqd, nqdd)
    exciting_points.csv    columns t, q_joint1, q_joint2, v_joint1, …, a_joint2: points only

Without a name, both are looked for in the folder ``frisch_planar`` below the one that FRISCHID_DATA names.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from frischid.core.types import Array
from frischid.errors import InputError
from frischid.logs.readers import read_log

AUTHORS = "github.com/massastrello/Robot-Frisch at ed664b7"
_JOINTS = ("joint1", "joint2")
_MATLAB_STATES, _MATLAB_NOISE = ("q", "qd", "qdd"), ("nq", "nqd", "nqdd")


@dataclass(frozen=True, eq=False)
class AuthorPoints:
    """The points of the exciting motion."""

    source: str
    """The file they were read from."""
    t: Array
    """Seconds, (M,)."""
    q: Array
    v: Array
    a: Array
    """`q`, `v`, `a`: Position, rad, (M, 2); velocity, rad/s; acceleration, rad/s²."""
    noise: Array | None
    """The one draw of standard normal noise on q, q̇ and q̈ that the authors' search used throughout, (3, M, 2), or
    None."""

    @property
    def states(self) -> Array:
        """q, q̇ and q̈ stacked, shape (3, M, 2)."""
        return np.stack([self.q, self.v, self.a])


def load_points(path: str | Path | None = None) -> AuthorPoints:
    """Read the authors' points.

    Parameters
    ----------
    path : str or Path, optional
        The authors' ``final.mat``, or a table with the columns of a log.

    Raises
    ------
    InputError
        There is no file, or it holds something else.
    """
    file = Path(path) if path is not None else _found()
    if not file.is_file():
        raise InputError(
            f"{file}: there is no such file; give the authors' final.mat ({AUTHORS}), "
            "or a table with the columns t, q_joint1, q_joint2, v_joint1, v_joint2, a_joint1, a_joint2"
        )
    points = _from_matlab(file) if file.suffix == ".mat" else _from_table(file)
    if points.q.shape != points.v.shape or points.q.shape != points.a.shape or points.q.shape[1:] != (2,):
        raise InputError(f"{file}: positions {points.q.shape}, velocities and accelerations must all be (M, 2)")
    if len(points.t) < 3 or not np.isfinite(points.states).all():
        raise InputError(f"{file}: the points must be at least three, and all numbers finite")
    return points


def _found() -> Path:
    folder = os.environ.get("FRISCHID_DATA")
    files = [Path(folder) / "frisch_planar" / name for name in ("final.mat", "exciting_points.csv")] if folder else []
    for file in files:
        if file.is_file():
            return file
    raise InputError(
        "the authors' 100 points do not come with frischid, because their repository has no licence: get "
        f"'Model & Trajectories/final.mat' from {AUTHORS} and give it with --points, or use --own-motion to run "
        "the study on a random motion, which no table of the paper can be compared with"
    )


def _from_table(file: Path) -> AuthorPoints:
    log = read_log(file, _JOINTS)
    if log.v is None or log.a is None:
        raise InputError(f"{file}: points need columns v_joint1, v_joint2, a_joint1 and a_joint2 too")
    return AuthorPoints(str(file), log.t, log.q, log.v, log.a, None)


def _from_matlab(file: Path) -> AuthorPoints:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = loadmat(file, variable_names=[*_MATLAB_STATES, *_MATLAB_NOISE])
    except (ValueError, NotImplementedError, OSError, MatReadError) as error:
        raise InputError(f"{file}: not a MATLAB file of version 4 to 7.2 ({error})") from error
    missing = [name for name in _MATLAB_STATES if name not in content]
    if missing:
        raise InputError(
            f"{file}: variable {missing[0]} is missing; the authors' final.mat holds {', '.join(_MATLAB_STATES)}"
        )
    q, v, a = (np.asarray(content[name], dtype=float) for name in _MATLAB_STATES)
    noise = None
    if all(name in content for name in _MATLAB_NOISE):
        draws = [np.asarray(content[name], dtype=float) for name in _MATLAB_NOISE]
        if any(draw.shape != q.shape for draw in draws):
            raise InputError(f"{file}: the noise {', '.join(_MATLAB_NOISE)} must have the shape of q, {q.shape}")
        noise = np.stack(draws)
    return AuthorPoints(str(file), np.arange(len(q), dtype=float), q, v, a, noise)
