"""What all logs of a fleet are read with: joints, filter, base parameters and lag of the torque.

A look at some logs, spread evenly over the fleet, decides. Moments of different robots can be added only if they are of
the same columns behind the same filter.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from frischid.core.parallel import Workers
from frischid.core.text import counted
from frischid.errors import InputError
from frischid.estimators.held_out import FOLDS
from frischid.fleet.fleet_options import FleetOptions
from frischid.fleet.jobs import Job, Look, look, torque_lag
from frischid.fleet.log_paths import LogPath
from frischid.logs.cutoff_choice import LogSpectra
from frischid.logs.filters import LowPass
from frischid.logs.summary import lock_absent
from frischid.regression.base_parameters import Reduction
from frischid.regression.regressor import Regressor
from frischid.regression.structure import structure
from frischid.robot.robot import Robot

_FIRST_LOOKS = 32  # logs, evenly spread over the fleet, that decide the filter and the joints
_LEAST_SHARE = 0.5  # share of those logs that must hold a joint or its torque; a log without it is skipped by name


def shared_job(
    pool: Workers, robot: Robot, logs: Sequence[LogPath], options: FleetOptions
) -> tuple[Job, Reduction, list[str]]:
    """Filter, joints and base parameters, from a look at some logs that are spread evenly over the fleet."""
    if not logs:
        raise InputError("there is no log to identify from; give at least one")
    index = np.unique(np.linspace(0, len(logs) - 1, min(_FIRST_LOOKS, len(logs))).astype(int))
    rows = options.torque_joints
    chosen = [logs[i] for i in index]
    looks = pool.gather(pool.map(look, chosen, (*robot.joints, *robot.locked), rows, options.mapping))
    good = [x for x in looks if isinstance(x, Look)]
    if not good:
        raise InputError(
            f"none of {len(looks)} logs looked at can be read; the first: {looks[0].address}: {looks[0].reason}"
        )
    most = _LEAST_SHARE * len(good)
    held = [n for n in robot.joints if sum(n in x.joints for x in good) > most]
    if not held:
        raise InputError(
            f"the logs share no joint with the robot; joints of the robot are {', '.join(robot.joints)}; "
            f"the logs hold {', '.join(good[0].joints)}"
        )
    kept = lock_absent(robot, held)
    have = [n for n in held if sum(n in x.torques for x in good) > most]
    fitted = [n for n in (rows or have) if n in held]
    if not fitted:
        raise InputError(
            "no joint of the logs has a torque channel; give tau_<joint> columns, or current gains in a mapping file"
        )
    spectra = sum((x.spectra for x in good), LogSpectra())
    lowpass = spectra.lowpass() if options.cutoff == "auto" else LowPass(options.cutoff)
    reduction = structure(Regressor(kept, options.effects), fitted)
    job = Job(
        json.dumps(kept.to_dict()),
        options.effects,
        tuple(fitted),
        tuple(reduction.base),
        lowpass,
        options.velocity,
        options.mapping,
    )
    filtering = "nothing is low-passed" if lowpass.cutoff is None else f"low-passed at {lowpass.cutoff:g} Hz"
    notes = [f"{filtering} ({lowpass.reason}), from {counted(len(good), 'log')} spread over the fleet"]
    whole = [p for p, x in zip(chosen, looks, strict=True) if isinstance(x, Look) and x.holds(held, fitted)]
    job, late = _in_time(pool, job, whole, options)
    return job, reduction, notes + late


def _in_time(pool: Workers, job: Job, logs: Sequence[LogPath], options: FleetOptions) -> tuple[Job, list[str]]:
    """The job with the lag of the fleet's torque, from as many logs as a fleet has parts, and a note where it is taken.

    The robots of a fleet are recorded in the same way. A robot that is not differs from the others.
    """
    taken, notes = options.torque_lag, list[str]()
    if taken == "auto":
        few = [logs[i] for i in np.unique(np.linspace(0, len(logs) - 1, min(FOLDS, len(logs))).astype(int))]
        # Without a log that has all joints and torques, each is skipped by name.
        taken, notes = pool.gather(pool.map(torque_lag, [few], job, options.prior))[0] if few else (0.0, notes)
    lowpass = replace(job.lowpass, torque_lag=float(taken))
    return replace(job, lowpass=lowpass), notes or [lowpass.lag_in_words] * bool(taken)
