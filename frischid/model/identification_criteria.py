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
    """

    unexplained_nrmse: float = 0.8
    clear_rank_gap: float = 100.0
    friction_pieces: int = 4
    most_noise: float = 0.9
    bbrf_rows: int = 100_000
    bbrf_window: int = 1000
    bbrf_rows_per_parameter: int = 20
    bbrf_steps_kept: int = 40

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return asdict(self)
