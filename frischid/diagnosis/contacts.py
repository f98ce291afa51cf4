"""Contacts: for a while something touches the robot. Such a stretch of time is left out; no effect is added for it.

A contact makes the residual e_j of joint j large for a few tenths of a second to a few seconds, in a log that the model
otherwise explains. With u_j the robust standard deviation of e_j (from the median absolute deviation), the smoothed
energy of the residual is

    z_j(t) = mean of e_j² / (u_j² + x_jᵀ H⁻¹ x_j + s_j²) over 0.25 s around t,

where x_j are the columns of the model at that time and H is the information of its parameters. The second term is the
variance of a prediction: a fit that has not seen the fast part of a motion predicts it badly, and nothing has touched
the robot there (a studentised residual). The third term is that of sampling: samples tell only to half a step when a
torque jumps, such as where a trapezoidal motion begins to brake (`variance_of_jumps`). e_j is the residual without what
friction with memory remembers from before the log (`start_states`).

A *burst* is a stretch of time with z_j > 6 in which z_j exceeds 30 at least once. A contact also biases the parameters.
So bursts are those beside a robust fit (`robust_fit`). Then the parameters are fitted again without the bursts, and the
bursts are searched again, until they stay the same (a trimmed estimate).

Bursts that return with the state of their joint are no contacts (`contacts_that_return`). Nor is a burst where joints
reverse, if its energy is at most that of dry friction, which is undetermined there. The bursts must hold most of the
error above the noise; otherwise only a strong burst on more than one joint is a contact, since a push turns all joints
before the touched link. The filter spreads a push, so a contact lasts where the residual has half of its largest value,
while the fit leaves out the whole burst.

While the arm stands still, dry friction holds any torque up to break-away, so a model can predict gravity only, and a
missing effect cannot be distinguished from friction. But gravity and friction stay as they are: a torque that appears
for a while is a contact (`frischid.checks.standing`).

Sources: Rousseeuw and Leroy 1987, Robust Regression and Outlier Detection, Wiley; Cook 1977, "Detection of influential
observation in linear regression", Technometrics 19(1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from frischid.checks.standing import pushes
from frischid.core.bursts import robust_std
from frischid.core.text import listed
from frischid.core.types import Array
from frischid.diagnosis.candidate_columns import Candidate
from frischid.diagnosis.contacts_that_return import returning_share
from frischid.diagnosis.criteria import DiagnosisCriteria
from frischid.diagnosis.cross_validation import CrossValidator
from frischid.diagnosis.findings import Finding
from frischid.diagnosis.residual_variables import MOST_ROWS, speeds, thinned
from frischid.diagnosis.reversal_residuals import filtered_width
from frischid.diagnosis.robust_fit import robust_parameters
from frischid.diagnosis.start_states import remembered_torque, without_memory
from frischid.diagnosis.stretches import Stretch
from frischid.diagnosis.unmodelled_terms import best_unmodelled
from frischid.logs.log import Log
from frischid.logs.poses import in_motion
from frischid.logs.recording import Recording
from frischid.model.model import Model

_ROUNDS = 5  # of the trimmed fit; the bursts usually stay the same after two


@dataclass(frozen=True)
class Contact:
    """A stretch of time in which something touched the robot.

    Attributes
    ----------
    source : str
        The log.
    start, stop : float
        s. There the residual has half of its largest value.
    joints : list of str
        Joints whose torque shows the contact.
    strength : float
        Largest residual in robust standard deviations.
    log_start : float
        First time stamp of the log, s; 0 for a recording that is read in pieces.
    """

    source: str
    start: float
    stop: float
    joints: list[str]
    strength: float
    log_start: float = 0.0

    @property
    def when(self) -> str:
        """The times in words, counted from the log's first sample as those of ``frischid cut``.

        >>> Contact("log.csv", 1018.1, 1029.0, ["joint1"], 9.0, log_start=1000.0).when
        'from 18.10 to 29.00 s'
        """
        return f"from {self.start - self.log_start:.2f} to {self.stop - self.log_start:.2f} s"


@dataclass(frozen=True)
class Burst:
    """A contact, and the longer stretch over which the filter spreads the contact's torque."""

    contact: Contact
    start: float
    stop: float
    """`start`, `stop`: s. The fit leaves this stretch out."""


def stretches(bursts: Sequence[Burst]) -> list[Stretch]:
    """The bursts as `CrossValidator.without` takes them: source, start, stop."""
    return [(b.contact.source, b.start, b.stop) for b in bursts]


def find_contacts(validator: CrossValidator, floor: Array) -> list[Burst]:
    """Find bursts of the residual in logs that the model otherwise explains.

    Parameters
    ----------
    floor : ndarray, shape (J,)
        Sensor noise of each joint, N·m (N): lower limit of the joint's robust standard deviation.
    """
    found, rest, theta = _trimmed(validator, floor)
    if found and not _stands_out(validator, rest, floor, theta):
        found = [burst for burst in found if _strong(validator, burst.contact)]
    return [] if _return(validator, rest, found) else found


def _strong(validator: CrossValidator, contact: Contact) -> bool:
    """Whether it must be a push: it turns all joints before the touched link, while a fault of a drive shows on one."""
    several = len(contact.joints) >= min(2, len(validator.joints))
    return several and contact.strength > validator.criteria.strong_push


def bursts_of(validator: CrossValidator, floor: Array) -> list[Burst]:
    """Bursts that do not return with the motion, whatever share of the error they hold.

    Parameters
    ----------
    validator, floor
        As in `find_contacts`.
    """
    found, rest, _ = _trimmed(validator, floor)
    return [] if _return(validator, rest, found) else found


def _trimmed(validator: CrossValidator, floor: Array) -> tuple[list[Burst], CrossValidator, Array]:
    """Bursts, none where they are too long; the fit without them; and the robust parameters that show them."""
    found: list[Burst] = []
    rest, unit = validator, np.maximum(floor, validator.criteria.smallest_error * validator.spread)
    for _ in range(_ROUNDS):
        theta = robust_parameters(rest, unit)
        new = _bursts(validator, rest, theta, unit)
        if not new or not validator.may_leave_out(stretches(new)):
            return [], validator, theta
        if stretches(new) == stretches(found):
            break
        found = new
        rest = validator.without(stretches(found))
    return found, rest, theta


def _return(validator: CrossValidator, rest: CrossValidator, found: Sequence[Burst]) -> bool:
    """Whether bursts return with the state of their joint."""
    return bool(found) and returning_share(validator, rest, stretches(found)) > validator.criteria.returning_share


def _stands_out(validator: CrossValidator, rest: CrossValidator, floor: Array, theta: Array) -> bool:
    """Whether the bursts hold half of the error above the noise, and more than an uncertain floor may hide."""
    criteria = validator.criteria
    whole = outside = 0.0
    for row, spread in enumerate(validator.spread):
        whole += validator.squares(row, theta) / spread**2
        outside += rest.squares(row, theta) / spread**2
    inside = whole - outside
    noise = float((validator.counts.sum(axis=0) * (floor / validator.spread) ** 2).sum())
    return inside > max(criteria.half_explained * (whole - noise), (criteria.floor_tolerance - 1) * noise)


def _bursts(validator: CrossValidator, rest: CrossValidator, theta: Array, unit: Array) -> list[Burst]:
    """Bursts in all rows under some parameters; `unit`, (J,): least robust standard deviation, N·m (N)."""
    data, scale = validator.data, np.maximum(robust_spread(rest, theta), unit)
    dry = data.cache.regressor.dry[list(validator.model.torque_index)]
    covariance = rest.fit.covariance
    found: list[Burst] = []
    motions = zip(data.sources, data.times, speeds(validator), strict=True)
    for number, (source, t, speed) in enumerate(motions):
        z, friction = np.zeros((2, len(t), len(scale)))
        motion = data.cache.motions[number]
        remembered = remembered_torque(data.cache, motion, theta)
        for row, noise in enumerate(scale):
            joint, active = data.of_motion(row, number), data.cache.active[row]
            variance = np.einsum("ni,ij,nj->n", joint.Y, covariance[np.ix_(active, active)], joint.Y, optimize=True)
            variance += noise**2 + joint.jumps
            error = validator.columns.residual(joint, theta)
            if row in remembered:
                error, variance = without_memory(error, variance, remembered[row][joint.picked])
            sigma = np.sqrt(variance)
            z[joint.picked, row], friction[joint.picked, row] = error / sigma, dry[row] / sigma
        reach = filtered_width(validator.model.lowpass, motion.step)
        found += _of_motion(source, t, z**2, friction**2, speed, reach, validator)
    return found


def robust_spread(rest: CrossValidator, theta: Array) -> list[float]:
    """Robust standard deviation of each joint's residual under some parameters, N·m (N), from evenly spread rows."""
    every = [max(1, -(-n // MOST_ROWS)) for n in rest.counts.sum(axis=0).tolist()]
    left = [thinned(rest.residuals(row, theta), k) for row, k in enumerate(every)]
    return [float(robust_std(x)) for x in left]


def _of_motion(
    source: str, t: Array, squares: Array, friction: Array, speed: Array, reach: int, validator: CrossValidator
) -> list[Burst]:
    """Bursts of one motion.

    Squares of residual and dry friction in robust units, and speed over its rms, (N, J); the filter's reach in rows.
    """
    criteria, joints = validator.criteria, validator.joints
    step = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    smooth, bursts = criteria.burst.bursts(squares, step)
    found = []
    for place in bursts:
        where = np.arange(len(t))[place]
        energy, shown = squares[where], np.flatnonzero(smooth[where].max(axis=0) > criteria.burst.edge)
        if _at_reversals(energy[:, shown], friction[where][:, shown], speed[where][:, shown], criteria):
            continue
        touched = [joints[j] for j in shown.tolist()]
        margin = criteria.burst.seconds / 2  # as far as the smoothing reaches
        largest = ndimage.maximum_filter1d(energy, 2 * reach - 1, axis=0, mode="constant")
        half = where[np.any((energy > largest / 4) & (energy > criteria.burst.edge), axis=1)]
        contact = Contact(source, float(t[half[0]]), float(t[half[-1]]), touched, float(np.sqrt(smooth[where].max())))
        found.append(Burst(contact, float(t[where[0]]) - margin, float(t[where[-1]]) + margin))
    return found


def _at_reversals(energy: Array, friction: Array, speed: Array, criteria: DiagnosisCriteria) -> bool:
    """Whether a burst lies where its joints stop or start, and is no larger than the dry friction there."""
    slow = float((energy * np.abs(speed)).sum()) < criteria.slow_speed * float(energy.sum())
    largest = np.maximum(friction.sum(axis=0), criteria.burst.edge * len(energy))
    return slow and bool(np.all(energy.sum(axis=0) <= largest))


# ---------------------------------------------------------------------- bursts without a contact


def made_by_something_steady(validator: CrossValidator, rest: CrossValidator, findings: Sequence[Finding]) -> bool:
    """Whether a term that acts all the time causes the bursts: an effect that was found, or one outside the catalogue.

    The latter is a term of another joint's state.

    Parameters
    ----------
    validator, rest : CrossValidator
        Fits to all rows, and to the rows without the bursts.
    """
    if any(_explains(validator, rest, validator.candidates(f.members)) for f in findings if f.significant):
        return True
    worst = int(np.argmax(_error_of_bursts(validator, rest)))
    term = best_unmodelled(validator, worst, jumping=False, significant=False)
    return term is not None and _explains(validator, rest, [term.candidate])


def _explains(validator: CrossValidator, rest: CrossValidator, found: Sequence[Candidate]) -> bool:
    """Whether the model with some candidates explains most of the bursts' energy."""
    extended, between = validator, rest
    effects = [c.effect for c in found]
    for whole, part in zip(found, rest.candidates(effects), strict=True):
        extended, between = extended.extended(whole), between.extended(part)
    before, after = _error_of_bursts(validator, rest), _error_of_bursts(extended, between)
    return float(after.sum()) < validator.criteria.burst_left_share * float(before.sum())


def _error_of_bursts(validator: CrossValidator, rest: CrossValidator) -> Array:
    """Squared residual in the stretches left out of `rest`, over each joint's squared spread, (J,)."""
    joints = range(len(validator.joints))
    everywhere, between = ([v.squares(row, validator.theta) for row in joints] for v in (validator, rest))
    return np.asarray((np.array(everywhere) - np.array(between)) / validator.spread**2)


def contacts_at_rest(model: Model, logs: Sequence[Log | Recording]) -> list[Contact]:
    """Torques that appear while the whole arm stands still, on the model's joints.

    Parameters
    ----------
    logs : sequence of Log or Recording
        Long recordings are not searched.
    """
    found = []
    for log in logs:
        if isinstance(log, Recording):
            continue
        part = log.select(model.robot.joints)
        if part.tau is not None:  # joints without a fitted torque still have to stand still
            tau = part.tau.copy()
            tau[:, [j for j, name in enumerate(part.joints) if name not in model.joints]] = 0.0
            part = replace(part, tau=tau)
        first = float(log.t[0])
        found += [Contact(log.source, p.start, p.stop, list(p.joints), p.strength, first) for p in pushes(part)]
    return found


def said_of(model: Model, logs: Sequence[Log | Recording]) -> list[str]:
    """A sentence on static logs among logs in which the arm moves; none without any."""
    moving = in_motion(logs, model.robot.joints)
    still = [log.source for log in logs if all(log is not other for other in moving)]
    if not still:
        return []
    return [f"{listed(still)}: the arm stands still, so only contacts are searched there"]
