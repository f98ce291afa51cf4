"""The simulated robot in the studio's scene, for models of commanded positions."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import frischid as fr

pytest.importorskip("viser", reason="the extra frischid[studio] is not installed")

from frischid.figures.torque import side_by_side
from frischid.studio import ghost as ghost_module
from frischid.studio.bench import Bench
from frischid.studio.ghost import LOOK, Ghost, simulated_at

KP, KD = 300.0, 9.0


def commanded(seed: int) -> fr.Log:
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 6.0, seed=seed), rate=100.0, parameters={"fv1": 0.5, "fc2": 0.4})
    assert log.tau is not None
    assert log.v is not None
    return fr.Log(log.t, robot.joints, q=log.q, qcmd=log.q + (log.tau + KD * log.v) / KP, source=f"{seed}.csv")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    logs = [commanded(1), commanded(2)]
    model = fr.identify(fr.Robot.load("planar2"), logs[:1], controller=fr.PDController(KP, KD), recursion="none").model
    return Bench(model, logs, tmp_path_factory.mktemp("studio") / "model.json")


def test_the_ghost_stands_near_the_measured_robot_on_the_test_log(bench: Bench) -> None:
    beside = bench.state.beside
    assert beside is not None
    assert beside.source == "2.csv"
    start = float(side_by_side(bench.state.prediction)[0][1])
    q = simulated_at(bench.state, start + 2.0)
    assert q is not None
    k = int(np.searchsorted(beside.t, 2.0))
    assert np.abs(q - beside.measured[k]).max() < 0.02
    assert simulated_at(bench.state, start + 1e3) is None
    assert simulated_at(bench.state, 1.0) is None  # the fitted log


def test_the_ghost_is_transparent_and_hidden_where_nothing_is_simulated(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = SimpleNamespace(show_visual=True, poses=[])
    drawn.update_cfg = drawn.poses.append
    asked: dict[str, object] = {}

    def urdf(*_: object, **given: object) -> SimpleNamespace:
        asked.update(given)
        return drawn

    monkeypatch.setattr(ghost_module, "ViserUrdf", urdf)
    ghost = Ghost(None, bench, lambda q: q)
    ghost.show(1.0)
    assert not asked  # nothing is drawn before it is needed
    ghost.show(float(side_by_side(bench.state.prediction)[0][1]) + 1.0)
    assert asked["mesh_color_override"] == LOOK
    assert LOOK[3] < 0.5
    assert len(drawn.poses) == 1
    ghost.show(1.0)
    assert not drawn.show_visual


def test_a_log_of_torque_has_a_ghost_too(tmp_path: Path) -> None:
    robot = fr.Robot.load("planar2")
    log = fr.simulate(robot, fr.random_fourier(robot, 5.0, seed=1), rate=100.0)
    model = fr.identify(robot, [log], recursion="none").model
    beside = Bench(model, [log], tmp_path / "model.json").state.beside
    assert beside is not None
    assert not beside.closed
