"""Time of one call of the exported C, for several robots and effects, compiled with ``gcc -O2``.

Each program calls its function on 4096 random states, a few hundred thousand times; the figure is the fastest of
several rounds, in ns of processor time per call.
"""

from __future__ import annotations

import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from common import parser, publish

import frischid as fr
from frischid.effects import columns_of
from frischid.export.code import c_source
from frischid.export.code_columns import CodeModel
from frischid.export.names import identifier

ROBOTS = ("planar2", "ur10", "panda")
MODELS = {
    "links alone": "",
    "the usual effects": "viscous, coulomb, offset, rotor_inertia",
    "+ presliding": "viscous, coulomb, offset, rotor_inertia, hysteresis",
    "+ load-dependent friction": "viscous, coulomb, offset, rotor_inertia, load_friction",
    "+ delay": "viscous, coulomb, offset, rotor_inertia, time_delay",
    "+ one elastic joint": "viscous, coulomb, offset, rotor_inertia, elasticity(period=0.1)@{joint}",
}
PROGRAM = """#include <stdio.h>
#include <time.h>
#include "control.c"
enum {{ J = {J}, STATES = 4096, CALLS = 200000, ROUNDS = 5 }};
static double x[STATES][3 * J];
int main(void)
{{
    double tau[J], sum = 0.0, best = 1e300;
    int round, k;
    {begin}
    if (fread(x, sizeof(double), (size_t)STATES * 3 * J, stdin) != (size_t)STATES * 3 * J)
        return 1;
    for (round = 0; round < ROUNDS; round++) {{
        clock_t start = clock();
        for (k = 0; k < CALLS; k++) {{
            const double *s = x[k % STATES];
            {call}
            sum += tau[0];
        }}
        const double ns = 1e9 * (double)(clock() - start) / CLOCKS_PER_SEC / CALLS;
        best = ns < best ? ns : best;
    }}
    printf("%.1f %g\\n", best, sum);
    return 0;
}}
"""


def main() -> None:
    """Print the table."""
    options = parser(__doc__).parse_args()
    rows = [
        {"model": title} | {name: round(nanoseconds(name, effects)) for name in ROBOTS}
        for title, effects in MODELS.items()
    ]
    publish(
        "ns per call of the exported C", rows, options.json, ["gcc -O2, one core; best of 5 rounds of 200 000 calls"]
    )


def nanoseconds(name: str, effects: str) -> float:
    """Processor time of one call for a robot with these effects, ns."""
    robot = fr.Robot.load(name)
    log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0, noise=fr.Noise(tau=0.01))
    model = fr.identify(robot, [log], effects=(), recursion="none", prior="none").model
    chosen = fr.parse_effects(effects.format(joint=robot.joints[1])) if effects else ()
    values = dict(zip(robot.all_names, map(float, robot.nominal), strict=True))
    names = [c.name for c in columns_of(robot, chosen)]
    model = replace(model, effects=chosen, standard={**dict.fromkeys(names, 0.3), **values})
    prefix, J = identifier(robot.name).lower(), len(robot.joints)
    begin, call = "", f"{prefix}_inverse_dynamics(s, s + J, s + 2 * J, tau);"
    if CodeModel.of(model).remembers:
        begin = f"static {prefix}_state state;\n    {prefix}_init(&state);"
        call = f"{prefix}_step(&state, s, s + J, s + 2 * J, 0.001, tau);"
    states = np.random.default_rng(0).normal(size=(4096, 3 * J))
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "control.c").write_text(c_source(model), encoding="utf-8")
        (Path(folder) / "main.c").write_text(PROGRAM.format(J=J, begin=begin, call=call), encoding="utf-8")
        command = ["gcc", "-std=gnu99", "-O2", "main.c", "-lm", "-o", "main"]
        subprocess.run(command, cwd=folder, check=True)
        done = subprocess.run([f"{folder}/main"], input=states.tobytes(), capture_output=True, check=True)
    return float(done.stdout.split()[0])


if __name__ == "__main__":
    main()
