"""The paper from beginning to end: equations, Tables 1 to 4, Figures 1 to 4, and one page that shows them.

    points → Table 2, Figures 1 and 2 → noisy runs → Table 3, Figure 3 → eq. (24) → Table 4, Figure 4

The study as published and the study as corrected run on the same motion, each with its own arm.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from frischid.core.files import check_writable, write_text
from frischid.core.types import Array
from frischid.effects import parse_effects
from frischid.errors import InputError
from frischid.figures.style import Drawing
from frischid.motions.limits import MotionLimits
from frischid.motions.motion_request import check_seed
from frischid.motions.plan import Plan, plan
from frischid.motions.plan_options import PlanOptions
from frischid.motions.trajectory import Quintic, random_fourier
from frischid.paper import paper_figures as pictures
from frischid.paper.author_points import AuthorPoints, load_points
from frischid.paper.equations import equation_table
from frischid.paper.monte_carlo import ArmMotion, StudyRun, study
from frischid.paper.paper_page import paper_page
from frischid.paper.paper_tables import PaperTable, table_1, table_2, table_3, table_4
from frischid.paper.planar_arm import points_arm, study_arm
from frischid.paper.printed import LENGTH, POINT_LIMITS, RATE, RUNS

PAGE, FIGURES_JSON = "paper.html", "paper.json"
"""Files that `Reproduction.write` makes."""
_SEARCH_BUDGET = 5_000
"""Evaluations of cost (19) for Figure 1: some ten seconds; smaller budgets passed the paper's cost most times only."""
_FEWEST_RUNS = 2
"""A spread over the runs needs two."""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """The paper, computed again.

    Attributes
    ----------
    source : str
        Where the points come from.
    authors : bool
        Whether they are the authors', so that figures can be compared with the printed ones.
    runs : int
        Monte Carlo runs of each study.
    tables : tuple of PaperTable
        Equations, then Tables 1 to 4.
    drawings : tuple of Drawing
        Figures 1 to 4; Figure 3 only where the study as published was done.

    Examples
    --------
    >>> import frischid as fr
    >>> found = fr.reproduce_paper(own_motion=True, runs=2, which="corrected", search=False)
    >>> [table.title for table in found.tables][:3]
    ['Equations', 'Table 1: physical parameters', 'Table 2: exciting points']
    """

    source: str
    authors: bool
    runs: int
    tables: tuple[PaperTable, ...]
    drawings: tuple[Drawing, ...]

    def table(self, title: str) -> PaperTable:
        """The table whose title begins with `title`, for example ``"Table 2"``."""
        for table in self.tables:
            if table.title.startswith(title):
                return table
        raise InputError(f"there is no table '{title}'; the tables are {', '.join(t.title for t in self.tables)}")

    def to_dict(self) -> dict[str, Any]:
        """Every figure in full precision, as plain JSON values."""
        return {
            "schema": "frischid.paper/1",
            "points": self.source,
            "authors_points": self.authors,
            "runs": self.runs,
            "tables": {t.title: {"numbers": dict(t.numbers), "notes": list(t.notes)} for t in self.tables},
            "figures": [{"title": d.title, "reading": d.reading} for d in self.drawings],
        }

    def write(self, folder: str | Path) -> tuple[Path, Path]:
        """Write the page and the figures' JSON into a folder, which is made if there is none.

        Raises
        ------
        InputError
            The folder or a file in it cannot be written.
        """
        home = Path(folder)
        try:
            home.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{home}: the folder cannot be made ({error.strerror}); choose another with -o") from error
        page, numbers = home / PAGE, home / FIGURES_JSON
        for path in (page, numbers):
            check_writable(path)
        write_text(page, paper_page(self.source, self.authors, self.runs, self.tables, self.drawings))
        write_text(numbers, json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False) + "\n")
        return page, numbers


def reproduce_paper(
    points: str | Path | None = None,
    *,
    runs: int = RUNS,
    which: Literal["both", "published", "corrected"] = "both",
    own_motion: bool = False,
    seed: int = 0,
    search: bool = True,
    progress: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Compute the paper again: every equation, table and figure, ours beside the printed value.

    Parameters
    ----------
    points : str or Path, optional
        The authors' ``final.mat`` or a table of the 100 points; by default the one below FRISCHID_DATA.
    runs : int
        Monte Carlo runs of each study; the paper has 250.
    which : {"both", "published", "corrected"}
        Studies to do: with eq. (16) and the rules of the authors' code, or with both put right.
    own_motion : bool
        Use a random motion of the same length instead of the authors' points. Nothing can then be compared.
    seed : int
        Of the noise, and of the random motion.
    search : bool
        Whether to search for exciting points, for Figure 1.
    progress : callable
        Called with the name of each step of the work.

    Returns
    -------
    Reproduction

    Raises
    ------
    InputError
        There are no points, or an option has no such value.

    Examples
    --------
    With the authors' points, leave `own_motion` out and give their file; two runs are enough to look around:

    >>> import frischid as fr
    >>> found = fr.reproduce_paper(own_motion=True, runs=2, which="corrected", search=False)
    >>> found.table("Equations").rows[0]
    ('τ = Γ θ', 'torque is linear in the parameters', 'apart by ... of the torque', 'yes')
    """
    check_seed(seed)
    if runs < _FEWEST_RUNS:
        raise InputError(f"the number of runs must be at least {_FEWEST_RUNS}, because a spread is wanted; got {runs}")
    if which not in ("both", "published", "corrected"):
        raise InputError(f"which must be both, published or corrected, not '{which}'")
    given = _own_points(seed) if own_motion else load_points(points)
    t = np.arange(round(float(given.t[-1] - given.t[0]) * RATE) + 1) / RATE
    states = np.stack(Quintic(given.t, given.q, given.v, given.a)(t))
    authors = not own_motion
    published, corrected = _studies(t, states, runs, which, seed, progress)
    case = ArmMotion.of(points_arm(as_published=False), t, states)
    progress("tables")
    theta = points_arm(as_published=False).theta
    tables = [equation_table(given, published, corrected), table_1(), table_2(given, authors=authors)]
    if published:
        tables += [
            table_3(published, corrected, authors=authors),
            table_4(published, corrected, theta, authors=authors),
        ]
    drawings = [pictures.descent(_search(seed, progress))] if search else []
    drawings.append(pictures.motion(case, given))
    if published:
        drawings += [pictures.bounds(published, len(t)), pictures.torque(case, published)]
    return Reproduction(given.source, authors, runs, tuple(tables), tuple(drawings))


def _studies(
    t: Array, states: Array, runs: int, which: str, seed: int, progress: Callable[[str], None]
) -> tuple[Sequence[StudyRun], Sequence[StudyRun]]:
    """Runs as published and as corrected; those that are not wanted are empty."""

    def done(name: Literal["published", "corrected"]) -> list[StudyRun]:
        if which not in ("both", name):
            return []
        as_published = name == "published"
        case = ArmMotion.of(study_arm(as_published=as_published), t, states)

        def told(count: int, of: int) -> None:
            progress(f"study as {name}: {count} of {of} runs")

        return study(case, runs, as_published=as_published, seed=seed, progress=told)

    return done("published"), done("corrected")


def _own_points(seed: int) -> AuthorPoints:
    """Points of a random Fourier motion, one a second, as many as the authors'."""
    robot = points_arm(as_published=False).regressor.robot
    t = np.arange(LENGTH + 1)
    q, v, a = random_fourier(robot, LENGTH, seed=seed)(t)
    return AuthorPoints("a random motion, not the authors' points", t, q, v, a, None)


def _search(seed: int, progress: Callable[[str], None]) -> Plan:
    """Search for 100 exciting points with the paper's cost and limits, by `frischid.motions.plan`."""
    progress("searching for exciting points")
    ones = np.ones(2)
    q, v, a = POINT_LIMITS
    options = PlanOptions(
        duration=LENGTH,
        family="points",
        criterion="paper",
        bounds="points",
        limits=MotionLimits(-q * ones, q * ones, v * ones, a * ones, np.full(2, np.inf)),
        budget=_SEARCH_BUDGET,
        seed=seed,
    )
    effects = parse_effects("viscous, coulomb(width=1e-3), rotor_inertia(coupled=true, ratio=0.1)@joint2")
    return plan(points_arm(as_published=False).regressor.robot, effects, options)
