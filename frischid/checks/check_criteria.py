"""Every number that decides the result of a check of a log, in one frozen object.

The text below each number gives its unit, the decision, and in parentheses the experiment that depends on it. Shares
and ratios have no unit. "NRMSE" is the rms error of the torque over the torque's standard deviation.

The numbers were chosen by hand; no sweep over them was recorded. A change of any number has to pass three experiments
(``tests/checks``):

- *clean*: 60 simulated logs without a fault (6 robots, 5 kinds of sensors, 2 motions): no check reports an issue;
- *planted*: 27 faults, each on 3 robots: the check names the fault and its joint; and payloads of 0.3 and 3 kg;
- *real*: public logs of TIAGo, Panda and UR10e: the checks report the faults that the data sets' authors state, and no
  others.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Any

import msgspec

from frischid.core.bursts import BURSTS, BurstRule
from frischid.logs.velocity_lag import LONGEST_VELOCITY_LAG

FAULT_COSTS = (
    ("all torque signs", 1.0),
    ("degrees", 2.0),
    ("common scale", 2.0),
    ("torque sign", 3.0),
    ("payload", 3.0),
    ("swapped torques", 4.0),
    ("position sign", 4.0),
    ("swapped joints", 4.0),
    ("joint zero", 4.0),
    ("mounting", 4.0),
    ("no gravity", 4.0),
    ("swapped positions", 5.0),
    ("torque scale", 5.0),
    ("spring", 6.0),
    ("motor coupling", 6.0),
    ("carried load", 6.0),
    ("wrong robot", 6.0),
)
"""Kinds of faults and their costs; `CheckCriteria.fault_costs` explains them."""


@dataclass(frozen=True)
class CheckCriteria:
    """Numbers that decide the results of `frischid.checks.inspect` and `frischid.checks.defects`."""

    # ---- data that must be there before anything is judged
    fewest_samples: int = 50
    """Samples. With fewer, neither velocities nor torques are judged: a correlation of so few samples is chance.
    (clean)"""
    enough_samples: int = 100
    """Samples. With fewer, neither the jitter of the stamps nor a lag is judged: both are statistics of steps.
    (clean)"""
    significant_errors: float = 4.0
    """Standard errors. A slope of the clock or a lag counts when it differs by more than this. The level is high
    because a log has many joints. (clean)"""

    # ---- the clock
    slowest_rate: float = 2.0
    """Hz. A lower rate means that the unit of time is wrong: nobody records dynamics so slowly. (planted: ms, ns)"""
    fastest_rate: float = 2e4
    """Hz. A higher rate means that the unit of time is wrong: no drive reports so fast. (planted: ms, ns)"""
    likely_rates: tuple[float, float] = (20.0, 5e3)
    """Hz. A unit of time is proposed if the rate is in this range with that unit. Robots log at 20 Hz to 5 kHz.
    (planted: ms, ns)"""
    gap_steps: float = 5.0
    """Usual steps. A longer step is a gap; resampling bridges shorter ones. (real: Panda's lost cycles)"""
    repeated_share: float = 0.01
    """Share of rows equal to the row before. Above this share the issue "repeated samples" is reported. (planted: stale
    rows; real: Panda)"""
    testimony_steps: float = 50.0
    """Steps of the position's resolution (or standard deviations of its noise). A joint that moved less testifies to
    neither clock nor velocity. (planted: small motions; real: LBR)"""
    repeat_motion: float = 3.0
    """Smallest changes of the channel per step. Only a joint that moves by more than this can show that a row was
    repeated. (clean: coarse)"""
    position_window: int = 31
    """Samples. The speed that turns positions into a clock is averaged over so many; they last less than a reversal.
    (clean)"""
    clear_slope_error: float = 0.2
    """Standard error of the slope of position steps over stamp steps. If the error is larger, the positions cannot tell
    which stamps are true. (clean)"""
    host_jitter: float = 0.003
    """Steps. Smaller jitter of the stamps costs less than the sensors' noise and is not reported. (planted: arrival)"""
    host_slope: float = 0.6
    """Slope of position steps over stamp steps. A significantly lower slope means that the stamps are times of arrival;
    true stamps have slope 1. (planted: arrival, bursts; true jitter: 1.00; real: TIAGo, Panda)"""
    buffer_jitter: float = 0.15
    """Steps. The issue "read from a buffer" needs a larger disagreement of positions and stamps. (real: Panda, host
    time)"""
    buffer_noise: float = 5.0
    """The same disagreement over the part that the positions' noise explains. (clean: noisy)"""
    unclear_jitter: float = 0.02
    """Steps. Larger jitter is reported even if the positions cannot tell whether it is real. (clean)"""
    untrusted_slope: float = 0.5
    """Slope of position steps over stamp steps. With a lower slope, evenly spaced stamps are better than the given
    ones, so the torques are judged with the mean step. (real: TIAGo)"""
    lost_stamp_steps: float = 100.0
    """Usual steps. A stamp farther than this from both its neighbours was never written (uninitialised memory). (CSV
    files with defects)"""

    # ---- an arm at standstill
    # Halved and doubled (`benchmarks/rest_constants.py`: 60 pushes of 3 to 30 standard deviations, 24 measured logs),
    # these numbers leave no false contact in any log, and find all pushes above 8 standard deviations (97 % with
    # the energy of a push doubled). Only that energy decides about smaller ones: of all 60 pushes 88, 73, 58 % are
    # found (half, as it is, doubled).
    least_rest: float = 1.0
    """s. A shorter rest is too short to see its torque before and after a push. (pushed; real: UR10e)"""
    push: BurstRule = BURSTS
    """Which changes of the torque count as a push, as in the diagnosis of contacts. (pushed; real: silent on the rests
    of UR10e, TX40, TIAGo and EMPS)"""
    settling_seconds: float = 0.5
    """s. A change that begins so soon after the arm has stopped, or ends so soon before it moves again, is the torque
    that settles, or that breaks the friction. (real: UR10e, TIAGo)"""

    # ---- channels
    grid_share: float = 0.5
    """Distinct values per sample. A channel with more distinct values has no grid. (clean: coarse encoder)"""
    grid_deviation: float = 0.05
    """Steps of the grid. A channel has no grid if the median distance of its values from the grid is larger. (clean)"""
    coarse_steps: float = 20.0
    """Steps of the grid over the middle 90 % of the torques. With fewer steps, rounding errors do not average out.
    (planted: coarse)"""
    tail_share: float = 0.05
    """Share of the samples that this range leaves out at either end, because peaks are not typical torques. (planted:
    coarse)"""
    dead_band_share: float = 0.1
    """Share of exact zeros. From this share on, a dead band is suspected. (planted: dead band; real: TIAGo's wrist)"""
    dead_band_ratio: float = 5.0
    """Zeros over samples of a neighbouring level. A higher ratio is more than rounding to zero explains. (planted: dead
    band; clean)"""
    saturated_samples: int = 10
    """Samples at the extreme value. Fewer are a signal that just turns back there. (planted: saturated)"""
    saturated_ratio: float = 8.0
    """Samples at the extreme value over samples of the two levels beside it. A sine has about two; more is saturation.
    (planted: saturated; clean)"""
    held_changes: int = 20
    """Changes of a channel. With fewer changes, a rhythm of the changes cannot be seen. (planted: held)"""
    held_share: float = 0.6
    """Changes per sample. A channel with more changes is not held; a value held over two samples gives 0.5. (planted:
    held)"""
    held_jump: float = 3.0
    """Steps of the grid. Held values jump by more than this; a coarse channel moves by one step. (planted: coarse,
    held)"""
    held_rhythm: float = 0.8
    """Share of the changes that must follow the same rhythm. (planted: held; clean)"""

    # ---- positions that jump
    jump_speed: float = 100.0
    """rad/s (m/s). No joint of a robot moves faster. (planted: -9999)"""
    jump_ratio: float = 50.0
    """Multiple of the joint's usual speed. Positions in degrees are fast, but do not jump. (planted: degrees, -9999)"""
    jump_percentile: float = 95.0
    """Percentile of the speed that counts as usual. (planted: -9999 in one sample of twenty at most)"""

    # ---- positions in degrees, without any torque
    degree_samples: int = 10
    """Samples. A joint's speed is taken over so many, because stamps of arrival may be next to one another. (bursts)"""
    degree_percentile: float = 95.0
    """Percentile of that speed. This percentile is compared with the URDF's limit. (planted: degrees)"""
    degree_speed: float = 3.0
    """Multiple of the URDF's speed limit. A faster joint that moves over more than a turn is in degrees: simulated
    robots reach twice their limits, and degrees are 57 times too large. (planted: degrees; clean)"""
    degree_range: float = 2 * pi
    """rad. A joint that stays within one turn is never called too fast, because simulated robots may be. (kinova, six
    times faster)"""
    unlimited_range: float = 4 * pi
    """rad. Where the URDF states no limit, a joint of an arm is suspicious from two full turns on. (clean)"""

    # ---- measured velocities
    longest_velocity_lag: float = LONGEST_VELOCITY_LAG
    """s. Longest lag that is searched: no filter is later. (planted: late velocity)"""
    late_velocity_steps: float = 0.5
    """Samples. A shorter lag comes from sampling itself. (clean)"""
    velocity_signal: float = 0.9
    """Share of the variance that is not white noise. A velocity with a smaller share is not judged. (clean: noisy)"""
    related_correlation: float = 0.9
    """Correlation of a velocity with the slope of a position. From this value on, the two belong together. (planted:
    swapped velocities; clean)"""
    factor_tolerance: float = 0.1
    """Relative difference. A factor this near to a known one (57.3, -1, 1000) is taken as the known one; gears and
    other units are farther apart. (planted: units and signs)"""

    # ---- the sketch: filtered samples on which hypotheses are tried
    sketch_cutoff: float = 10.0
    """Hz. Gross errors show below this cut-off frequency; above it, the noise of bad stamps would hide them. (planted;
    real: TIAGo)"""
    sketch_oversampling: int = 6
    """Samples per period of the cut-off, so that channels can be shifted in time. (planted: late torque)"""
    sketch_samples: int = 1500
    """Samples. Most samples of a sketch: gross errors show on a thousand. (time of a check)"""
    few_samples: int = 500
    """Samples. So many are enough to fit a handful of parameters. (time of a check)"""
    fewest_moving: int = 30
    """Samples in motion. A joint with fewer is not judged. (clean)"""
    clear_velocity: float = 0.3
    """Noise of the velocity over its standard deviation. Above this ratio the sign of the velocity is unclear, and so
    dry friction is undetermined. (clean: noisy)"""

    # ---- torques against the URDF
    bad_nrmse: float = 0.3
    """NRMSE of the URDF with fitted friction. A larger error asks for an explanation; real arms have 0.02 to 0.25.
    (real; clean)"""
    independent_time: float = 0.5
    """s. Errors of a URDF's torques are correlated over about so long: one independent sample. (planted)"""
    most_independent: float = 40.0
    """Samples. Independent samples of a joint count as at most so many: errors of a URDF repeat with the motion, so a
    longer log does not prove more. (planted)"""
    urdf_error: float = 0.1
    """NRMSE. Below this error, which URDFs of real arms have anyway, a smaller error proves nothing. (real)"""
    heard_share: float = 0.7
    """Share of the rms torque. A row takes part in a common factor only if a multiple of the URDF leaves less.
    (planted: mN·m)"""
    odd_factor: float = 2.0
    """Factor. A gain nearer to one is an error of the URDF's masses, not of the log. (real: LBR)"""
    unit_tolerance: float = 0.2
    """Relative difference. A common factor this near to that of a unit is taken as this unit. (planted: mN·m)"""
    fault_costs: tuple[tuple[str, float], ...] = FAULT_COSTS
    """Nats, the negative logarithm of how common each fault is. One convention for all drives is the most common fault;
    turned, exchanged and shifted joints follow; gains, springs and couplings are rarer. (planted: each, and pairs)"""
    most_faults: int = 3
    """Faults of one hypothesis, signs of torques not counted. More faults explain anything. (planted: pairs)"""
    least_odds: float = 20.0
    """Posterior odds against no fault. A hypothesis with lower odds is not named. (clean)"""
    likely_probability: float = 0.9
    """Probability against the rivals. Above it a fault is "likely", below it "possible". (planted)"""
    changed_nrmse: float = 0.02
    """NRMSE. A hypothesis changes the rows whose error changes by more than this. (planted)"""
    discrete_share: float = 0.5
    """Share of the squared error. Faults without a fitted number (signs, exchanges) are named if they explain this
    share: nothing is fitted that could explain it by chance, and URDFs have errors of their own. (real: LBR)"""
    explained_share: float = 0.85
    """Share of the squared error. A mistake of single joints is reported only if correcting it explains at least this
    share; correcting the true mistake explains nearly all. (planted: signs, exchanges, degrees, payloads)"""
    nrmse_cap: float = 2.0
    """NRMSE. Larger errors count as this one, so that one joint does not outvote all others. (planted: torque scale)"""
    rigid_share: float = 0.05
    """Share of the squared error. The URDF's inertial parameters are judged only if freely fitted ones explain at least
    this share. (real: TIAGo's torso)"""
    free_ratio: float = 0.3
    """Squared error with freely fitted parameters over the squared error with the URDF's. A lower ratio means that the
    joints carry other inertias than the URDF says. (planted: wrong robot)"""
    wrong_robot_share: float = 0.75
    """Share of the error explained by freely fitted parameters. If the URDF's own parameters explain less than this
    share, the URDF may be of another robot. (planted: wrong robot)"""
    likely_wrong_share: float = 0.4
    """The same share. Below this value another robot is "likely", not only "possible". (planted: wrong robot)"""
    payload_nrmse: float = 0.03
    """NRMSE. If the error is lower on every joint, no payload is searched. (clean)"""
    exact_share: float = 0.99
    """Share of the squared error. A body that explains errors below `urdf_error` must explain this share: else they may
    be errors of the URDF's links. (clean, with links that differ from the URDF's)"""
    link_error: float = 0.1
    """Share of a link's mass by which URDFs are wrong, one standard deviation. A body must explain more than such
    errors do. (planted: payload; clean, with links that differ from the URDF's by 10 %)"""
    payload_reach: float = 1.0
    """m from the last joint. Nobody carries a payload farther out. (planted: payload)"""
    missing_mass: float = 1.3
    """Multiple of the last body's mass. More mass than that body has cannot be missing; 0.3 is the error of the fit.
    (real: Panda without its hand)"""

    # ---- delay of the torque
    longest_torque_lag: float = 0.3
    """s. Longest lag that is searched; with a longer one, torque and motion are not of one recording. (planted: late
    torque)"""
    lag_lengths: float = 10.0
    """Longest lags. A stretch must last at least so many of them for its lag to be judged. (clean)"""
    lag_blocks: int = 8
    """Parts of the stretch that the jackknife leaves out one at a time. They give the standard error of the lag.
    (lags measured to 2 ms)"""
    common_lag_share: float = 0.5
    """Share of the squared error that a common delay explains. The issue "late torque" is "likely" above this share. A
    delay that is the only fault explains nearly all. (planted: late torque; real: UR10e)"""
    slight_lag_share: float = 0.1
    """Share of the squared error. A common delay that explains less is not reported. (planted; real: LBR)"""
    common_lag_odds: float = 10**1.5
    """Odds. A delay common to all joints is reported if it makes the joints' own delays more likely by this factor than
    friction that lags in each joint by its own time. Jeffreys calls this evidence "very strong". (planted: late torque;
    real: UR10e)"""

    # ---- excitation
    excitation_folds: int = 5
    """Stretches of time for cross-validation: each is predicted by a fit to the others. (clean)"""
    samples_per_parameter: float = 2.0
    """Torque samples per base parameter. With fewer, nothing is fitted. (short logs)"""
    weak_ratio: float = 1.5
    """Cross-validated error of a free fit over the error of the URDF. Above this ratio the log alone excites the robot
    too weakly. (clean)"""
    weak_nrmse: float = 0.15
    """NRMSE. A free fit with a lower error predicts well enough, even if the URDF predicts better. (clean)"""

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return dict(msgspec.json.decode(msgspec.json.encode(self)))


DEFAULT_CRITERIA = CheckCriteria()
