"""Every number that decides what a check of a log says.

Shares and ratios have no unit. "NRMSE" is the error of the torque over the torque's standard deviation.

The numbers were chosen by hand. No sweep over them was recorded. Three experiments hold them in place, and a change of
any number has to pass all three (``tests/checks``):

- *clean*: 60 simulated logs without a fault (6 robots, 5 kinds of sensors, 2 motions): no check says anything;
- *planted*: 27 faults, each on 3 robots: the fault is named, with its joint; and payloads of 0.3 and 3 kg;
- *real*: public logs of TIAGo, Panda and UR10e: the checks say what the data sets' authors say, and no more.

Each field names the experiment that it decides.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import pi
from typing import Any


@dataclass(frozen=True)
class CheckCriteria:
    """Numbers that decide what `frischid.checks.inspect` and `frischid.checks.defects` say."""

    # ---- data that must be there before anything is judged
    fewest_samples: int = 50
    """Samples: below, neither velocities nor torques are judged; a correlation of fewer is chance. (clean)"""
    enough_samples: int = 100
    """Samples: below, neither the stamps' jitter nor a lag is judged; both are statistics of steps. (clean)"""
    significant_errors: float = 4.0
    """Standard errors: a slope of the clock or a lag counts beyond this; a log has many joints. (clean)"""

    # ---- the clock
    slowest_rate: float = 2.0
    """Hz: below, the unit of time is wrong; nobody records dynamics so slowly. (planted: ms, ns)"""
    fastest_rate: float = 2e4
    """Hz: above, the unit of time is wrong; no drive reports so fast. (planted: ms, ns)"""
    likely_rates: tuple[float, float] = (20.0, 5e3)
    """Hz: a unit of time with a rate in this range is proposed; robots log at 20 Hz to 5 kHz. (planted: ms, ns)"""
    gap_steps: float = 5.0
    """Usual steps: a longer one is a gap; shorter ones the resampling bridges. (real: Panda's lost cycles)"""
    repeated_share: float = 0.01
    """Share of rows equal to the row before: beyond, "repeated samples". (planted: stale rows; real: Panda)"""
    repeat_motion: float = 3.0
    """Smallest changes per step: only a joint that moves by more can show that a row was repeated. (clean: coarse)"""
    position_window: int = 31
    """Samples over which the speed is averaged that turns positions into a clock: shorter than a reversal. (clean)"""
    clear_slope_error: float = 0.2
    """Standard error of the slope of position steps over stamp steps: above, the positions cannot tell. (clean)"""
    host_jitter: float = 0.003
    """Steps: below, jitter of stamps costs less than the sensors' noise, and nothing is said. (planted: arrival)"""
    host_slope: float = 0.6
    """A significantly lower slope of position steps over stamp steps: stamps of arrival; true stamps have slope 1.
    (planted: arrival, bursts; true jitter: 1.00; real: TIAGo, Panda)"""
    buffer_jitter: float = 0.15
    """Steps by which positions and stamps must disagree for "read from a buffer". (real: Panda, host time)"""
    buffer_noise: float = 5.0
    """The same in units of what the positions' noise explains. (clean: noisy)"""
    unclear_jitter: float = 0.02
    """Steps of jitter that are reported although the positions cannot tell whether the jitter is real. (clean)"""
    untrusted_slope: float = 0.5
    """Below this slope the stamps are worse than even ones; the torques are judged on the mean step. (real: TIAGo)"""
    lost_stamp_steps: float = 100.0
    """Usual steps: a stamp so far from both its neighbours is unwritten memory. (CSV files with defects)"""

    # ---- channels
    grid_share: float = 0.5
    """Distinct values per sample: a channel with more has no grid. (clean: coarse encoder)"""
    grid_deviation: float = 0.05
    """Steps: median distance of the values from their grid, beyond which there is no grid. (clean)"""
    coarse_steps: float = 20.0
    """Steps of the grid over the middle 90 % of the torques: fewer make errors that do not average out.
    (planted: coarse)"""
    tail_share: float = 0.05
    """Share of samples left out at either end for that range, because peaks are no usual torque. (planted: coarse)"""
    dead_band_share: float = 0.1
    """Share of exact zeros from which a dead band is suspected. (planted: dead band; real: TIAGo's wrist)"""
    dead_band_ratio: float = 5.0
    """Zeros per sample of a neighbouring level: more than rounding to zero explains. (planted: dead band; clean)"""
    saturated_samples: int = 10
    """Samples at the extreme value, fewer of which are a signal that turns round. (planted: saturated)"""
    saturated_ratio: float = 8.0
    """Samples at the extreme per sample of the two levels below: a sine has about two. (planted: saturated; clean)"""
    held_changes: int = 20
    """Changes of a channel needed to see that it changes in a rhythm. (planted: held)"""
    held_share: float = 0.6
    """Changes per sample above which a channel is not held: held over two samples gives 0.5. (planted: held)"""
    held_jump: float = 3.0
    """Steps of the grid: held values jump by more; a coarse channel moves by one. (planted: coarse, held)"""
    held_rhythm: float = 0.8
    """Share of the changes that must come in the same rhythm. (planted: held; clean)"""

    # ---- positions in degrees, without any torque
    degree_samples: int = 10
    """Samples over which a joint's speed is taken, because stamps of arrival stand next to one another. (bursts)"""
    degree_percentile: float = 95.0
    """Percentile of that speed which is compared with the limit. (planted: degrees)"""
    degree_speed: float = 3.0
    """URDF speed limits: faster, and over more than a turn, is degrees; simulated robots reach twice theirs, and a
    degree is 57 times too large. (planted: degrees; clean)"""
    degree_range: float = 2 * pi
    """rad: a joint that stays within one turn is never called too fast: simulated robots are. (kinova, six times
    faster)"""
    unlimited_range: float = 4 * pi
    """rad: without any limit to compare with, two full turns are where a joint of an arm becomes suspicious. (clean)"""

    # ---- measured velocities
    brief_seconds: float = 20.0
    """s of a log that suffice for its velocities where a check must be short. (the same issues as the whole log)"""
    longest_velocity_lag: float = 1.0
    """s: no filter is later. (planted: late velocity)"""
    late_velocity_steps: float = 0.5
    """Samples: an earlier lag is that of the sampling itself. (clean)"""
    velocity_signal: float = 0.9
    """Share of the variance that must not be white noise for a velocity to be judged. (clean: noisy)"""
    related_correlation: float = 0.9
    """Correlation from which a velocity is that of a position. (planted: swapped velocities; clean)"""
    factor_tolerance: float = 0.1
    """Relative: a factor so near to a known one (57.3, -1, 1000) is that one; gears and units are farther apart.
    (planted: units and signs)"""

    # ---- the sketch: filtered samples on which hypotheses are tried
    sketch_cutoff: float = 10.0
    """Hz: enough for gross errors; above, the noise of bad stamps would drown them. (planted; real: TIAGo)"""
    sketch_oversampling: int = 6
    """Samples per period of the cut-off, so that channels can be shifted in time. (planted: late torque)"""
    sketch_samples: int = 1500
    """At most so many samples: what is grossly wrong shows on a thousand. (time of a check)"""
    few_samples: int = 500
    """Samples that suffice for a handful of parameters. (time of a check)"""
    fewest_moving: int = 30
    """Samples in motion that a joint needs to be judged. (clean)"""
    clear_velocity: float = 0.3
    """Noise over spread of the velocity above which its sign, and so dry friction, is undetermined. (clean: noisy)"""

    # ---- torques against the URDF
    bad_nrmse: float = 0.3
    """NRMSE of the URDF with fitted friction that calls for an explanation; real arms: 0.02 to 0.25. (real; clean)"""
    explained_share: float = 0.85
    """Share of the squared error that an explanation of single joints must remove: a true one removes nearly all.
    (planted: signs, exchanges, degrees, payloads)"""
    nrmse_cap: float = 2.0
    """NRMSE above which worse is not more telling: one joint must not outvote all others. (planted: torque scale)"""
    equal_share: float = 0.03
    """Difference of shares below which the simpler explanation is taken. (planted: turned axis, swapped joints)"""
    gravity_tolerance: float = 0.15
    """Relative: a direction of gravity is accepted when its fitted length, which nothing forces, is gravity's.
    (planted: mounting)"""
    rigid_share: float = 0.05
    """Share of the squared error that free inertial parameters must explain before the URDF's are compared with them.
    (real: TIAGo's torso)"""
    free_ratio: float = 0.3
    """Squared error with free parameters over that with the URDF's: below, the joints have other inertias.
    (planted: wrong robot)"""
    wrong_robot_share: float = 0.75
    """Share of what free parameters explain that the URDF's own must explain. (planted: wrong robot)"""
    likely_wrong_share: float = 0.4
    """The same share, below which another robot is likely and not only possible. (planted: wrong robot)"""
    payload_nrmse: float = 0.03
    """NRMSE: below on every joint, no payload is looked for. (clean)"""
    payload_reach: float = 1.0
    """m from the last joint: nobody carries a payload farther out. (planted: payload)"""
    missing_mass: float = 1.3
    """Masses of the last body: more cannot be missing; 0.3 is the fit's error. (real: Panda without its hand)"""

    # ---- delay of the torque
    longest_torque_lag: float = 0.3
    """s: recordings that are later are no recordings of one motion. (planted: late torque)"""
    lag_lengths: float = 10.0
    """Longest lags that a stretch must last for its lag to be judged. (clean)"""
    lag_quarters: int = 4
    """Parts of the stretch whose lags give the standard error. (lags measured to 2 ms)"""
    common_lag_share: float = 0.5
    """Share of the squared error that a delay of all joints must remove; a delay that is the only fault removes nearly
    all, friction that lags at reversals looks like one and leaves more. (planted: late torque; real: UR10e)"""
    slight_lag_share: float = 0.1
    """The same share where nearly all joints show the same delay. (real: UR10e)"""
    seen_lag_errors: float = 3.0
    """Standard errors beyond which a joint's own lag is seen. (real: UR10e)"""
    alike_lag: float = 0.35
    """Relative difference up to which a joint's lag is the common one. (real: UR10e)"""
    alike_lag_errors: float = 2.0
    """Standard errors that are added to that difference. (real: UR10e)"""
    alike_lag_joints: float = 0.6
    """Share of the joints that must show the common lag. (real: UR10e)"""

    # ---- excitation
    excitation_folds: int = 5
    """Stretches of time that are predicted from the others. (clean)"""
    samples_per_parameter: float = 2.0
    """Torque samples per base parameter: below, nothing is fitted. (short logs)"""
    weak_ratio: float = 1.5
    """Held-out error of a free fit over the URDF's: above, the log alone is too weak. (clean)"""
    weak_nrmse: float = 0.15
    """NRMSE: below, a free fit predicts well enough whatever the URDF does. (clean)"""

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {name: list(x) if isinstance(x, tuple) else x for name, x in asdict(self).items()}


DEFAULT_CRITERIA = CheckCriteria()
