"""A data frame stands wherever a log may stand, with a mapping or without."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

import frischid as fr
from frischid.errors import InputError
from frischid.logs.given import as_logs, whole_logs

PLANAR2 = fr.Robot.load("planar2")


def frame_of(log, names=("q", "tau"), scale=1.0):
    """A pyarrow table with the positions (times `scale`) and torques of a log."""
    columns = {"t": log.t}
    for name, values in zip(names, (scale * log.q, log.tau), strict=True):
        columns |= {f"{name}_{joint}": values[:, k] for k, joint in enumerate(log.joints)}
    return pa.table(columns)


@pytest.fixture(scope="module")
def logs():
    motions = [fr.random_fourier(PLANAR2, 8.0, seed=seed) for seed in (1, 2)]
    noise = fr.Noise(q=1e-5, tau=0.01)
    return [fr.simulate(PLANAR2, motion, rate=50.0, noise=noise, channels=()) for motion in motions]


@pytest.fixture(scope="module")
def frames(logs):
    return [frame_of(log) for log in logs]


@pytest.fixture(scope="module")
def model(logs):
    return fr.identify(PLANAR2, logs[:1], recursion="none").model


def test_identify_takes_frames(logs, frames, model):
    found = fr.identify(PLANAR2, frames[0], valid=[frames[1]], recursion="none")
    np.testing.assert_allclose(found.model.estimate.theta, model.estimate.theta, rtol=1e-9)
    assert found.comparison.nrmse == pytest.approx(fr.compare(model, logs[1:]).nrmse)
    assert found.model.history[-1]["logs"][0]["source"] == "logs[0]"
    assert found.comparison.sources == ("valid[0]",)


def test_frames_and_logs_may_be_mixed(logs, frames):
    both, mixed = (fr.identify(PLANAR2, given, recursion="none").model for given in (logs, [logs[0], frames[1]]))
    np.testing.assert_allclose(both.estimate.theta, mixed.estimate.theta, rtol=1e-9)


def test_a_mapping_explains_the_columns(logs, model):
    frame = frame_of(logs[0], ("angle", "moment"), scale=180 / np.pi)
    joints = {n: {"q": f"angle_{n}", "angle_unit": "deg", "tau": f"moment_{n}"} for n in PLANAR2.joints}
    found = fr.identify(PLANAR2, frame, mapping={"joint": joints}, recursion="none")
    np.testing.assert_allclose(found.model.estimate.theta, model.estimate.theta, rtol=1e-6)


def test_every_function_on_a_model_takes_a_frame(logs, frames, model, tmp_path):
    assert fr.compare(model, frames[1]).nrmse == pytest.approx(fr.compare(model, logs[1:]).nrmse)
    assert fr.headline(model, frames[1:]).measured == "test"
    asked = {"effects": ["joint_spring"]}
    found = fr.diagnose(model, frames[0], valid=frames[1], **asked)
    assert found.verdict == fr.diagnose(model, logs[:1], valid=logs[1:], **asked).verdict == "none"
    assert fr.improve(model, frames[0], valid=frames[1], **asked)[0] == []
    step = fr.add(model, fr.parse_effects("joint_spring@joint2"), frames[0], valid=frames[1])
    assert step.test_after == pytest.approx(step.test_before, rel=0.1)
    assert fr.check(PLANAR2, frames[0])[0].issues == ()
    fr.report(model, frames, tmp_path / "page.html", diagnosis=found)
    assert "logs[1]" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert fr.compare_simulated(model, frames[1], horizons=[0.1]).sources == ("logs[0]",)


def test_drive_gains_take_frames(logs):
    payload = fr.parse_effects("payload@joint2")
    motion = fr.random_fourier(PLANAR2, 5.0, seed=3)
    loaded = fr.simulate(
        PLANAR2, motion, rate=100.0, effects=(*fr.BASELINE, *payload), parameters={"dm2": 2.0, "dmx2": 0.1}, channels=()
    )
    bare = fr.simulate(PLANAR2, fr.random_fourier(PLANAR2, 5.0, seed=4), rate=100.0, channels=())
    known = fr.KnownPayload(2.0)
    one = fr.find_gains(PLANAR2, [bare], [loaded], known)
    other = fr.find_gains(PLANAR2, frame_of(bare), frame_of(loaded), known)
    np.testing.assert_allclose(one.gains, other.gains, rtol=1e-9)


def test_a_recording_is_no_whole_log():
    with pytest.raises(InputError, match="a whole log is needed here"):
        whole_logs([fr.Recording("long.bag", lambda _: iter(()))], PLANAR2.joints)


def test_a_fitted_frame_is_known_again(frames):
    model = fr.identify(PLANAR2, frames[0], recursion="none").model
    assert fr.headline(model, frames[0]).measured == "cross-validated"
    with pytest.raises(InputError, match="both fitted and held out"):
        fr.identify(PLANAR2, frames[0], valid=frames[0])


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_other_libraries(library, logs, model):
    given = pytest.importorskip(library).DataFrame(frame_of(logs[1]).to_pydict())
    assert fr.compare(model, given).nrmse == pytest.approx(fr.compare(model, logs[1:]).nrmse)


def test_what_is_neither_is_refused(model):
    for wrong in (3, {"t": [0.0]}, [np.zeros(3)], "run.csv"):
        with pytest.raises(InputError, match="a data frame may stand in place of a log"):
            fr.compare(model, wrong)


def test_logs_in_memory_that_share_a_name_get_numbers(logs):
    numbered = as_logs([*logs, logs[0]], PLANAR2.joints)
    assert [log.source for log in numbered] == ["simulated", "simulated (2)", "simulated (3)"]
    assert as_logs(logs, PLANAR2.joints)[1] is numbered[1], "what is remembered of it holds in the next call"
    assert numbered[1].identity == logs[1].identity


def test_a_push_takes_no_seconds_out_of_another_log():
    motions = [fr.random_fourier(PLANAR2, 20.0, seed=seed) for seed in (1, 2)]
    logs = [fr.simulate(PLANAR2, motion, rate=50.0, noise=fr.Noise(q=1e-6, tau=0.01)) for motion in motions]
    tau = np.array(logs[1].tau)
    tau[(logs[1].t > 8) & (logs[1].t < 9.5)] += 3 * tau.std(axis=0)
    found = fr.diagnose(fr.identify(PLANAR2, logs, recursion="none").model, [logs[0], replace(logs[1], tau=tau)])
    assert found.verdict == "contact"
    assert {contact.source for contact in found.contacts} == {"simulated (2)"}


def test_a_numbered_log_and_a_new_one_do_not_share_a_name(logs):
    second = as_logs(logs, PLANAR2.joints)[1]
    third = replace(logs[0], tau=2 * logs[0].tau)
    names = [log.source for log in as_logs([logs[0], second, third], PLANAR2.joints)]
    assert names == ["simulated", "simulated (2)", "simulated (3)"]


def test_a_simulated_motion_that_comes_again_may_be_held_out():
    """Its positions are the same to the last bit; the noise of its torque is another one."""
    motion = fr.random_fourier(PLANAR2, 5.0, seed=1)
    first, again = (fr.simulate(PLANAR2, motion, rate=50.0, noise=fr.Noise(tau=0.05), seed=seed) for seed in (1, 2))
    assert np.array_equal(first.q, again.q)
    assert fr.identify(PLANAR2, [first], valid=[again], recursion="none").headline.measured == "test"
    with pytest.raises(InputError, match="both fitted and held out"):
        fr.identify(PLANAR2, [first], valid=[replace(first, v=None, sha256="of another file")])
