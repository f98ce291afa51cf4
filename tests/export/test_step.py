"""Generated code of every effect is the model along a log, states included; memory and lag as a step function.

The code cannot see the future. `causal` puts the definitions of `frischid.export.code_columns` in the place of the few
functions of the model that look ahead; everything else of the expected torque is the model's own.
"""

import subprocess
from functools import cache, partial

import numpy as np
import pytest
from cases import exact_log, quick, robot
from test_code import module

from frischid.effects import EFFECTS, State, flexibility, friction_memory, parse_effects, self_heating
from frischid.effects.friction_memory import presliding
from frischid.effects.link_lag import Lag, lags
from frischid.effects.state import SIGN_WIDTH
from frischid.export.code_columns import CodeModel
from frischid.export.export import export
from frischid.export.names import identifier
from frischid.logs.preprocessing import Motion
from frischid.model.model import Model
from frischid.motions.simulation import Noise
from frischid.regression.regressor import Regressor

STEP = 0.005  # s; a link advances by one step of the log, and rests for more than START_WINDOW at first
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror", "-pedantic"]
SANE = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


@pytest.fixture
def causal(monkeypatch):
    """The model without its look into the future."""
    earlier = State.earlier

    def slid(t, v, distance):
        z, moving = presliding(t, v, distance), np.abs(v) > SIGN_WIDTH
        z[: int(moving.argmax()) if moving.any() else len(z)] = 0.0
        return z

    def past(self, x, by):
        if len(self.t) < 2:
            return earlier(self, x, by)
        old = np.array([np.interp(self.t - abs(by), self.t, row) for row in x.T]).T
        return old if by > 0 else x + (x - old)

    def lagged(state, gears):
        for gear in gears:
            (found,) = lags(state, [gear])
            if len(state.t) < 3:
                yield found
                continue
            h, place = np.diff(state.t), found.place
            speed = np.diff(place) / h
            acceleration = np.append([0.0, 0.0], 2 * np.diff(speed) / (h[1:] + h[:-1]))
            between = [found.friction[0]]  # the model's friction is the mean of the steps before and after
            for mean in found.friction[1:-1]:
                between.append(2 * mean - between[-1])
            yield Lag(place, np.append(0.0, speed), acceleration, np.append(0.0, between))

    monkeypatch.setattr(friction_memory, "presliding", slid)
    monkeypatch.setattr(State, "earlier", past)
    monkeypatch.setattr(flexibility, "lags", lagged)


def motion_of(machine, seconds=1.2, step=STEP):
    """Rest, then two harmonics of every joint, with temperatures that change."""
    t, J = np.arange(0.0, seconds, step), len(machine.joints)
    tau, rng = np.maximum(t - 0.15, 0.0)[:, None], np.random.default_rng(4)
    q, v, a = np.zeros((3, len(t), J))
    for size, omega in ((0.4, 3.0), (0.1, 11.0)):
        w = omega * rng.uniform(0.7, 1.4, J)
        x = size * rng.choice([-1.0, 1.0], J)
        q, v = q + x * (1 - np.cos(w * tau)), v + x * w * np.sin(w * tau)
        a = a + x * w**2 * np.cos(w * tau) * (tau > 0)
    lower, upper = np.maximum(machine.limits.lower, -1.0), np.minimum(machine.limits.upper, 1.0)
    q = q + (lower + upper) / 2
    extra = {f"temperature_{n}": 20 + 3 * t + i for i, n in enumerate(machine.joints)}
    return Motion(t, q, v, a, np.zeros_like(q), np.zeros_like(q, dtype=bool), "made", 0.0, extra)


@cache
def plain(name):
    machine = robot(name)
    return quick(machine, [exact_log(machine, (), noise=Noise(tau=0.01))], effects=()).model.to_dict()


def with_effects(name, effects, sign=1.0, seed=3):
    """A model of a robot with these effects; its parameters and its reference are random, its links physical."""
    machine = robot(name)
    motion, rng = motion_of(machine, 1.0), np.random.default_rng(seed)
    regressor = Regressor(machine, effects)
    Y = regressor(motion.t, motion.q, motion.v, motion.a, extra=motion.extra)
    size = np.maximum(np.abs(Y).max(axis=2).mean(axis=0), 1e-3)[len(machine.columns) :]
    names = [c.name for c in regressor.columns[len(machine.columns) :]]
    values = {n: float(sign * x / s) for n, x, s in zip(names, rng.uniform(0.5, 1.5, len(names)), size, strict=True)}
    standard = dict(zip(machine.all_names, map(float, machine.nominal), strict=True)) | dict(machine.known) | values
    reference = {c.name: float(standard[c.name] * rng.uniform(0.6, 1.4)) for c in regressor.columns}
    data = plain(name) | {"prior": None, "fitted": None, "previous": None, "history": []}
    changed = {"effects": [e.to_dict() for e in effects], "standard": standard, "reference": reference}
    return Model.from_dict(data | changed)


def expected(model, motion):
    """Torque and friction of the model along a motion, before any filter."""
    regressor = Regressor(model.robot, model.effects, model.reference)
    friction = np.array([EFFECTS[c.effect].friction if c.effect in EFFECTS else False for c in regressor.columns])
    known = model.robot.known_torque(motion.q, motion.v, motion.a)
    whole = regressor.torque(motion, model.full_theta)
    if not CodeModel.of(model).remembers:
        return whole, model.friction(motion.q, motion.v)
    part = regressor.torque(motion, model.full_theta * friction)
    return whole, part if known is None else part - known


HARNESS = """#include <stdio.h>
#include "control.c"
enum {{ J = {J} }};
int main(void)
{{
    double x[4 * J + 1], tau[J], friction[J];
    int j;
    {begin}
    while (fread(x, sizeof(double), 4 * J + 1, stdin) == 4 * J + 1) {{
        {step}
        fwrite(tau, sizeof(double), J, stdout);
        for (j = 0; j < J; j++)
            fwrite(&friction[j], sizeof(double), 1, stdout);
        {prints}
    }}
    return 0;
}}
"""


def harness(model):
    """A C program that reads rows of q, v, a, dt and temperatures, and writes torque, friction and states."""
    code, name, J = CodeModel.of(model), identifier(model.robot.name).lower(), len(model.robot.joints)
    if not code.remembers:
        step = f"{name}_inverse_dynamics(x, x + J, x + 2 * J, tau); {name}_friction(x, x + J, friction);"
        return HARNESS.format(J=J, begin="", step=step, prints="")
    shown = ["s.t", *(f"s.slide[{m.number}].z" for m in code.made if m.kind == "slide")]
    shown += [f"s.heat[{m.number}]" for m in code.made if m.kind == "heat"]
    shown += [f"s.lag[{m.number}].place" for m in code.made if m.kind == "lag"]
    heat = "for (j = 0; j < J; j++) { s.temperature[j] = x[3 * J + 1 + j]; }" if code.uses("temperature") else ""
    step = f"{heat} {name}_step(&s, x, x + J, x + 2 * J, x[3 * J], tau);"
    step += " for (j = 0; j < J; j++) { friction[j] = s.friction[j]; }"
    prints = " ".join(f"fwrite(&{x}, sizeof(double), 1, stdout);" for x in shown)
    return HARNESS.format(J=J, begin=f"{name}_state s;\n    {name}_init(&s);", step=step, prints=prints)


def c_run(model, motion, folder, optimise="-O0"):
    """Torque, friction and the whole state along a motion, by the generated C under the sanitizers."""
    export(model, folder / "control.c", force=True)
    (folder / "main.c").write_text(harness(model))
    program, J = str(folder / "main"), len(model.robot.joints)
    subprocess.run(["gcc", optimise, *STRICT, *SANE, str(folder / "main.c"), "-lm", "-o", program], check=True)
    done = subprocess.run([program], input=rows_of(model, motion).tobytes(), capture_output=True, check=True)
    out = np.frombuffer(done.stdout).reshape(len(motion.t), -1)
    return out[:, :J], out[:, J : 2 * J], out[:, 2 * J :]


def rows_of(model, motion):
    warm = np.array([motion.extra[f"temperature_{n}"] for n in model.robot.joints]).T
    dt = np.append(99.0, np.diff(motion.t))  # the first call takes no time
    return np.column_stack([motion.q, motion.v, motion.a, dt, warm])


def python_run(model, motion, folder):
    """The same by the generated Python."""
    export(model, folder / "control.py", force=True)
    control, J, code = module(folder / "control.py"), len(model.robot.joints), CodeModel.of(model)
    if not code.remembers:
        tau = control.inverse_dynamics(motion.q, motion.v, motion.a)
        return tau, control.friction(motion.q, motion.v), np.empty((len(tau), 0))
    state, found = control.init(), []
    for x in rows_of(model, motion):
        if code.uses("temperature"):
            state.temperature[:] = x[3 * J + 1 :]
        tau = control.step(state, x[:J], x[J : 2 * J], x[2 * J : 3 * J], x[3 * J])
        shown = [state.t, *(s[1] for s in state.slide), *state.heat, *(s["place"] for s in state.lag)]
        found.append((tau, state.friction, shown))
    return tuple(np.array(x) for x in zip(*found, strict=True))


def states_of(model, motion):
    """The states of the model itself: time, Dahl's z of every joint, deflections."""
    code, regressor = CodeModel.of(model), Regressor(model.robot, model.effects, model.reference)
    if not code.remembers:
        return np.empty((len(motion.t), 0))
    state, rows = regressor.state(motion), [motion.t - motion.start]
    rows += [
        friction_memory.presliding(motion.t, motion.v[:, m.joint], m.values[0]) for m in code.made if m.kind == "slide"
    ]
    rows += [self_heating.heat(motion.t, motion.v[:, m.joint], *m.values) for m in code.made if m.kind == "heat"]
    for m in code.made:
        if m.kind == "lag":
            geared = (e for e in model.effects if isinstance(e, flexibility.Elasticity | flexibility.Backlash))
            (effect,) = (e for e in geared if m.joint in [i for i, *_ in e.acts_on(model.robot)])
            (lag,) = flexibility.lags(state, [effect.gear(m.joint)])
            rows.append(lag.place / m.values[5])
    return np.array(rows).T


def check_along_a_log(model, folder, runs=(c_run, python_run)):
    motion = motion_of(model.robot)
    tau, friction = expected(model, motion)
    scale = 1e-9 * max(np.abs(tau).max(), 1.0)
    for run in runs:
        found, rubbed, states = run(model, motion, folder)
        np.testing.assert_allclose(found, tau, rtol=0, atol=scale, err_msg=str(run))
        np.testing.assert_allclose(rubbed, friction, rtol=0, atol=scale, err_msg=str(run))
        np.testing.assert_allclose(states, states_of(model, motion), rtol=0, atol=1e-9, err_msg=str(run))


EVERY = [
    *(n for n, kind in EFFECTS.items() if n not in ("coulomb", "offset", "formula") and not kind.of_controller),
    "offset", "joint_spring(form=cubic)", "joint_spring(form=curve)@turn", "payload(full=True)@elbow",
    "rotor_inertia(coupled=True, ratio=-30)", "joint_coupling(ratio=-2)@turn+elbow",
    "joint_coupling@turn+elbow, joint_coupling(ratio=-1)@turn+elbow",
    "self_heating(constant=0.4, exponent=1.3)",
    "hysteresis(distance=0.3)@elbow", "thermal_drift(by=temperature)", "torque_drift(by=temperature)",
    "elasticity(period=0.11)",
    "elasticity(period=0.2, rubbing=0.5)@elbow", "backlash(size=0.01)", "backlash(rubbing=0.7)",
    "time_delay(size=0.01)", "time_delay(size=0.0123)", "time_delay(size=-0.03)", "time_delay@elbow",
    'formula("sin(t)*temperature1 - 3")@elbow', 'formula("-q2**2/(abs(load)+2)*sign(v3) + pi*tau_model1")@elbow+turn',
    'formula("tan(v/9)*log(9+v1)*sqrt(abs(q))+exp(-v3)-+cos(q)**-2")',
]  # fmt: skip
TOGETHER = (
    'viscous, coulomb(lead=0.01), hysteresis@elbow, drive_gain, formula("tau_model1*tau_model2/50")@turn+elbow, '
    'payload, gravity_tilt, time_delay(size=0.0123), load_stribeck, encoder_zero, elasticity(period=0.3, rubbing=0.4), '
    'thermal_drift, self_heating, cable_hose@turn, formula("tau_model*t")@elbow'
)  # fmt: skip


def test_every_effect_of_the_catalogue_is_tried():
    tried = {e.id for text in EVERY for e in parse_effects(text)} | {"coulomb"}
    assert tried == {name for name, kind in EFFECTS.items() if not kind.of_controller}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("text", EVERY)
def test_code_is_the_model_along_a_log(causal, text, sign, tmp_path):
    effects = (*parse_effects("coulomb"), *parse_effects(text))
    runs = (c_run, python_run) if sign > 0 else (c_run,)
    check_along_a_log(with_effects("mixed mimic", effects, sign), tmp_path, runs)


@pytest.mark.parametrize("name", ["mixed mimic", "mixed mimic far_end known", "ur10 far_end tilted"])
def test_effects_read_the_torque_of_those_before_them(causal, name, tmp_path):
    joints = robot(name).joints
    text = TOGETHER.replace("elbow", joints[2]).replace("turn", joints[0])
    optimised = partial(c_run, optimise="-O1")  # only an optimiser sees values that may be used before they are set
    check_along_a_log(with_effects(name, parse_effects(text)), tmp_path, (optimised, python_run))
