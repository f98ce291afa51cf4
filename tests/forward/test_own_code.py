"""An effect of one's own is simulated with every function that its exported code may use."""

from dataclasses import dataclass

import numpy as np

import frischid as fr


def test_the_functions_of_exported_code_can_be_simulated(tmp_path):
    @dataclass(frozen=True)
    class Bent(fr.Effect):
        """Friction with every function that only own effects use."""

        id = "bent_for_test"
        code = {"lf": "sign({v}) * log(1.0 + abs({v})) + tan(0.1 * {v})"}  # noqa: RUF012

        def terms(self, state):
            return self.per_joint(
                state,
                "lf",
                "",
                lambda i: np.sign(state.v[:, i]) * np.log1p(abs(state.v[:, i])) + np.tan(state.v[:, i] / 10),
            )

    try:
        robot, effects = fr.Robot.load("planar2"), (*fr.parse_effects("viscous, rotor_inertia"), Bent())
        values = {"lf1": 0.3, "lf2": 0.2, "fv1": 0.1, "fv2": 0.1}
        log = fr.simulate(robot, fr.random_fourier(robot, 8.0, seed=1), rate=100.0, effects=effects, parameters=values)
        model = fr.identify(robot, [log], effects=effects, recursion="none").model
        assert fr.export(model, tmp_path / "control.py").notes == ()
        q, v, a = log.q[300:310], log.v[300:310], log.a[300:310]
        found = fr.ForwardDynamics(model).acceleration(q, v, model.inverse_dynamics(q, v, a))
        assert np.allclose(found, a, atol=1e-6)
    finally:
        fr.EFFECTS.remove("bent_for_test")
