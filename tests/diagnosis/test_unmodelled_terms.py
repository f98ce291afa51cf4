"""A torque outside the catalogue on one joint, beside an effect of the catalogue on another."""

from dataclasses import replace

import numpy as np
import pytest

import frischid as fr
from frischid.diagnosis.rivals import sentence_of

PLANAR2 = fr.Robot.load("planar2")
DRY = {"fv1": 0.5, "fv2": 0.3, "fc1": 0.5, "fc2": 0.3, "Ia1": 0.02, "Ia2": 0.01}


def diagnosed(strange: float) -> fr.Diagnosis:
    """Diagnosis of an arm with a weak spring on joint 2; the direction of joint 2 brakes joint 1, N·m."""
    logs = []
    for seed in (1, 2):
        log = fr.simulate(
            PLANAR2,
            fr.random_fourier(PLANAR2, 25.0, seed=seed, scale=0.8),
            rate=100.0,
            effects=(*fr.BASELINE, *fr.parse_effects("joint_spring@joint2")),
            parameters=DRY | {"ks2": 0.1},
            noise=fr.Noise(q=1e-6, tau=0.01),
            seed=seed,
            name=f"log {seed}",
        )
        tau = np.array(log.tau)
        tau[:, 0] += strange * np.sign(log.v[:, 1])
        logs.append(replace(log, tau=tau))
    return fr.diagnose(fr.identify(PLANAR2, logs, recursion="none").model, logs)


@pytest.mark.parametrize("strange", [0.0, 1.2])
def test_the_joint_with_the_largest_error_is_asked_too(strange):
    found = diagnosed(strange)
    best = max(found.probabilities, key=lambda name: found.probabilities[name])
    if not strange:
        assert (found.verdict, best) == ("effect", "joint_spring")
        return
    assert (found.verdict, best) == ("unknown", "outside"), "the verdict and the most probable answer agree"
    assert found.probabilities["outside"] > 0.9
    said = "on joint1 'sign(v2)' explains more error than joint_spring does, so joint_spring is not the main cause"
    assert said in found.notes
    assert found.findings[0].to_dict()["withheld"] == "", "a verdict is not withheld"
    assert not sentence_of(found.findings, found.probabilities, PLANAR2), "nothing is left to tell apart"
