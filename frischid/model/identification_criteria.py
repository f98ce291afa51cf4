"""Every number that decides the steps and the warnings of an identification, with its unit and its reason."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class IdentificationCriteria:
    """Numbers that decide in `frischid.identify`.

    Attributes
    ----------
    unexplained_nrmse : float
        Cross-validated NRMSE above which a joint's torque counts as not predicted at all: its log is suspected, not its
        model. A constant torque has NRMSE 1.
    clear_rank_gap : float
        Ratio of the smallest singular value kept to the largest one dropped, below which the rank of the regressor is
        called unclear. All serial arms of example-robot-data lie above it (`tests/model/test_identification.py`).
    friction_pieces : int
        Motions of a recording, from its beginning, on which the width of dry friction's sign is chosen: reading all of
        a recording takes long, and four motions, of half a minute each at 1 kHz, have many reversals.
    most_noise : float
        Share of the column of an open damping gain, beside the other columns, that may be removed as noise of the
        velocity. Encoders of 4096 counts per turn make up to half of it (`benchmarks/commanded_mujoco.py
        --open-damping`); near 1, the difference of signal and noise is arbitrary.
    bbrf_rows : int
        Torque rows, at most, that the bounding-box recursion looks at: it holds them in memory and inverts a matrix
        per row.
    bbrf_window : int
        Rows of a recursion window, at least, unless half the rows are fewer.
    bbrf_rows_per_parameter : int
        Rows of a recursion window per parameter, at least, unless half the rows are fewer.
    bbrf_steps_kept : int
        Steps of the recursion that are stored with the model, for the picture of how the bounds closed in.
    lag_p_value : float
        Largest p-value of a lag of the torque that counts. The errors of the models of six measured robots imitate lags
        with p-values down to 4e-4 (Stäubli TX40); half a sample step of simulated logs has 1e-5 or less. The UR10e's
        1e-5 is not one lag: its joints differ.
    lag_differs_p_value : float
        Level, shared by all joints, at which a joint's lag differs from that of all joints.
    lag_differs_share : float
        Difference, as a share of the lag of all joints, from which a joint's lag is another one: simulated logs with
        one lag of half a step reach 0.25 on a joint, the UR10e's measured joints 2 and more.
    lag_likely_p_value : float
        p-value below which a lag is estimated again with corrected parameters.
    lag_sampling_steps : float
        Longest lag, in sample steps, that sampling and held commands explain, and that a model takes back: a held
        command acts half a step late on average, and its record may be a step late.
    lag_stretches : int
        Stretches of time, at least, that give the lag's standard error.
    """

    unexplained_nrmse: float = 0.8
    clear_rank_gap: float = 100.0
    friction_pieces: int = 4
    most_noise: float = 0.9
    bbrf_rows: int = 100_000
    bbrf_window: int = 1000
    bbrf_rows_per_parameter: int = 20
    bbrf_steps_kept: int = 40
    lag_p_value: float = 1e-4
    lag_differs_p_value: float = 0.01
    lag_differs_share: float = 0.5
    lag_likely_p_value: float = 0.05
    lag_sampling_steps: float = 1.5
    lag_stretches: int = 6

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self)
