"""How a diagnosis goes, while it runs: the effect that is being tried, and a ranking of all effects tried so far.

The ranking grows while the diagnosis runs: each effect at its best place, in the order of its evidence alone. It is not
the ranking of the finished diagnosis, which weighs the effects against one another.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

from frischid.core.text import listed
from frischid.effects import EFFECTS

if TYPE_CHECKING:
    from frischid.diagnosis.scored_candidate import ScoredCandidate

SHOWN = 6
"""Effects of the ranking that are shown."""
RANKING_PAUSE, SAYING_PAUSE = 0.5, 0.2
"""Least time between two rankings and between two texts, s: a browser draws on the processors that compute."""


class Tried(NamedTuple):
    """An effect at its best place so far.

    ``gain`` is that of `ScoredCandidate`; ``change`` the relative change of the mean cross-validated NRMSE.
    """

    effect: str
    joints: tuple[str, ...]
    gain: float
    change: float

    @property
    def words(self) -> str:
        """The effect in a line."""
        return f"{self.effect} on {listed(self.joints) or 'the robot'}: error {100 * self.change:+.0f} %"


class Watch:
    """A `frischid.diagnosis.scored_candidate.Watcher`.

    Parameters
    ----------
    proceed : callable
        Called first of all at each stage; raises an error to end the diagnosis.
    say : callable
        Called with the effect or the stage, and the share of the catalogue that was tried.
    show : callable
        Called with the ranking so far.
    """

    def __init__(
        self, proceed: Callable[[], None], say: Callable[[str, float], None], show: Callable[[Sequence[Tried]], None]
    ) -> None:
        self._proceed, self._say, self._show = proceed, say, show
        self._names: set[str] = set()
        self._best: dict[str, Tried] = {}
        self._shown = self._said = 0.0

    def __call__(self, text: str, /) -> None:
        """Say what is being done."""
        self._proceed()
        name = text.removeprefix("trying ").partition(" (")[0]
        self._names.add(name)
        if time.monotonic() - self._said > SAYING_PAUSE:
            self._said = time.monotonic()
            self._say(name, len(self._names & EFFECTS.keys()) / len(EFFECTS))

    def scored(self, found: ScoredCandidate, change: float) -> None:
        """Put a candidate into the ranking."""
        effect = found.effect
        new = Tried(effect.id, tuple(effect.joints or ()), found.gain, change)
        if new.gain > 0 and (effect.id not in self._best or new.gain > self._best[effect.id].gain):
            self._best[effect.id] = new
            if time.monotonic() - self._shown > RANKING_PAUSE:
                self._shown = time.monotonic()
                self._show(sorted(self._best.values(), key=lambda x: -x.gain)[:SHOWN])
