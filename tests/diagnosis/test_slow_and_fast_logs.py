"""A slow log leaves the rotors open and cannot predict a fast one; that error is no missing effect and hides none."""

from dataclasses import dataclass, replace

import pytest

import frischid as fr
from frischid.diagnosis.floor import Floor, error_of
from frischid.diagnosis.situation import cross_validator
from frischid.motions.trajectory import Fourier


@dataclass(frozen=True)
class Slowed:
    """A motion at a share of its speed."""

    path: Fourier
    rate: float
    duration: float = 25.0

    def __call__(self, t):
        q, v, a = self.path(self.rate * t)
        return q, self.rate * v, self.rate**2 * a


def slow_and_fast(arm, seed, spring=0.0):
    machine = fr.Robot.load(arm)
    hidden = (*fr.BASELINE, *fr.parse_effects(f"joint_spring@{machine.joints[1]}")) if spring else fr.BASELINE
    numbers = range(1, len(machine.joints) + 1)
    values = {f"{kind}{n}": x for n in numbers for kind, x in (("fv", 0.5), ("fc", 0.5), ("Ia", 1.0))}
    logs = []
    for k, rate in enumerate((0.1, 1.0)):
        log = fr.simulate(
            machine,
            Slowed(fr.random_fourier(machine, 25, seed=10 * seed + k), rate),
            rate=100,
            effects=hidden,
            parameters=values | ({"ks2": spring} if spring else {}),
            noise=fr.Noise(q=1e-6, tau=0.05),
            channels=(),
            seed=seed,
        )
        logs.append(replace(log, source=("slow", "fast")[k]))
    return fr.identify(machine, logs[:1], recursion="none").model, logs


@pytest.mark.parametrize(("arm", "seed"), [("planar2", 0), ("planar2", 2), ("ur5", 1), ("ur5", 3)])
def test_a_spring_is_found_in_a_slow_and_a_fast_log(arm, seed):
    model, logs = slow_and_fast(arm, seed, 6.0)
    first = fr.diagnose(model, logs).findings[0]
    assert (first.effect, first.joints) == ("joint_spring", (model.robot.joints[1],))
    assert first.probability > 0.8
    assert first.share > 0.9


@pytest.mark.parametrize("arm", ["planar2", "ur5"])
def test_a_healthy_robot_is_healthy_at_every_speed(arm):
    model, logs = slow_and_fast(arm, 1)
    assert fr.diagnose(model, logs).verdict == "none"
    validator, _ = cross_validator(model, logs)
    error, floor = error_of(validator), Floor.of(validator).noise
    assert (validator.base_nrmse() * validator.spread / error).max() > 3
    assert (error < 1.5 * floor).all()
