"""The moment at which dry friction changes its direction, as a nuisance where a delay is in doubt.

    τ = Y θ + Σ_j λ_j c_j + noise,      c_j = (s(q̇_j + (T + h) q̈_j) − s(q̇_j + (T − h) q̈_j)) / 2h,      λ_j = fc_j δT_j

The lead T of dry friction's sign s is chosen by cross-validation from a few values. An error δT of it moves the step of
friction at each reversal. A torque that is computed from commands moves with the delay of the commands, so a delay that
is fitted takes the place of the error: on a simulated Panda, a lead that was 1 ms wrong moved the delay by 0.5 ms, and
with the delay the armatures and the viscous friction, by many of their standard errors. So each joint has a free
coefficient λ_j, which is no torque of the robot and no part of the model: the columns c_j are taken out of the moments
(partial regression), as fits of other columns beside them would do:

    M ← M − M_c (cᵀc)⁻¹ M_cᵀ

h is the step of the motion: between two samples, a log does not show when friction changes.

Source: Frisch and Waugh 1933, Partial time regressions as compared with individual trends, Econometrica 1(4).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from frischid.core.types import Array
from frischid.effects import Coulomb, Effect, State, Term
from frischid.effects.commands import CommandDelay
from frischid.logs.preprocessing import Motion
from frischid.regression.moment_blocks import Blocks, total

_ANY = 1e-12
"""Share of a joint's largest moment below which a column is zero: the joint never reverses."""


@dataclass(frozen=True)
class _Lead(Coulomb):
    """The column of an error of the lead: rate of dry friction's sign by the lead."""

    span: float = 1e-3
    """h of the module's text, s."""

    def terms(self, state: State) -> list[Term]:
        """One column per joint, λ in N·m·s (N·s)."""

        def rate(joint: int) -> Array:
            after, before = (self.sign_at(state, joint, self.lead + h) for h in (self.span, -self.span))
            return np.asarray((after - before) / (2.0 * self.span))

        terms = self.per_joint(state, "early", "velocity", rate)
        return [replace(term, column=replace(term.column, effect="friction_lead")) for term in terms]


def lead_effects(effects: Sequence[Effect], motions: Iterable[Motion]) -> tuple[Effect, ...]:
    """The nuisance of each dry friction of a model whose delay is in doubt; none elsewhere.

    Parameters
    ----------
    effects : sequence of Effect
        Of the model.
    """
    if not any(effect.id == CommandDelay.id for effect in effects):
        return ()
    span = max((motion.step for motion in motions if not motion.at_poses), default=0.0)
    dry = [effect for effect in effects if isinstance(effect, Coulomb)] if span else []
    return tuple(_Lead(joints=e.joints, width=e.width, lead=e.lead, span=span) for e in dry)


def without_columns(blocks: Blocks, count: int) -> Blocks:
    """Blocks of moments in which the last columns are fitted beside the others, and left out.

    Parameters
    ----------
    count : int
        Number of the last columns; each acts on one joint alone.
    """
    if not count:
        return blocks
    whole = total(blocks)
    size = len(whole.columns) + 1
    kept = [*range(size - 1 - count), size - 1]
    taken = np.zeros((len(whole.joints), count, len(kept)))
    for j, moments in enumerate(whole.moments):
        for k in range(count):
            column = moments[size - 1 - count + k]
            own = column[size - 1 - count + k]
            if own > _ANY * np.diag(moments).max(initial=0.0):
                taken[j, k] = column[kept] / own
    found = []
    for block in blocks:
        maps = np.zeros((len(whole.joints), size, len(kept)))
        maps[:, kept, range(len(kept))] = 1.0
        maps[:, size - 1 - count : size - 1] = -taken
        moments = maps.transpose(0, 2, 1) @ block.moments @ maps
        sums = np.einsum("ja,jab->jb", block.sums, maps)
        found.append(replace(block, columns=block.columns[: size - 1 - count], moments=moments, sums=sums))
    return Blocks(found)
