import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from frischid.errors import InputError, UnknownNameError
from frischid.logs.log import Log, check_motion, check_torque
from frischid.logs.recording import check_logs

N = 50
T = np.arange(N) * 0.01
JOINTS = ("shoulder", "elbow", "wrist")
Q = np.sin(2 * np.pi * T[:, None] * [1.0, 2.0, 3.0] + [0.1, 0.2, 0.3])


def make(**changes):
    return Log(**{"t": T, "joints": JOINTS, "q": Q, "source": "made.csv"} | changes)


def changed(array, row, column, value):
    copy = np.array(array)
    copy[row, column] = value
    return copy


def test_arrays_are_read_only_copies():
    q = Q.copy()
    log = make(q=q, extra={"temperature_elbow": T.copy()})
    q[0, 0] = 99.0
    assert log.q[0, 0] == Q[0, 0]
    for array in (log.t, log.q, log.extra["temperature_elbow"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(TypeError):
        log.extra["more"] = T


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"q": Q[:, :2]}, ["q has shape (50, 2)", "expected (50, 3)"]),
        ({"v": Q[:-1]}, ["v has shape (49, 3)"]),
        ({"t": T[:, None]}, ["t has shape (50, 1)"]),
        ({"extra": {"lift": T[1:]}}, ["extra 'lift' has shape (49,)"]),
        ({"joints": ("a", "a", "b")}, ["one or more joints", "different names"]),
        ({"joints": (), "q": Q[:, :0]}, ["one or more joints"]),
        ({"extra": {"tau_elbow": T}}, ["tau_elbow", "rename"]),
        ({"q": changed(Q, 6, 1, np.nan)}, ["row 7", "q_elbow", "nan", "1 of 50"]),
        ({"tau": changed(Q, 6, 1, np.inf)}, ["row 7", "tau_elbow", "inf"]),
        ({"v": changed(Q, 0, 2, np.nan)}, ["row 1,", "v_wrist", "nan"]),
        ({"q": np.full_like(Q, np.nan)}, ["row 1,", "q_shoulder"]),
        (
            {"current": changed(Q, 49, 0, -1e306)},
            ["row 50", "current_shoulder", "-1e+306", "not a measurement"],
        ),
        ({"extra": {"lift": changed(T[:, None], 3, 0, np.nan)[:, 0]}}, ["row 4", "'lift'"]),
        ({"t": changed(T[:, None], 5, 0, T[4])[:, 0]}, ["row 6", "0.04 after 0.04", "1 repeated"]),
        ({"t": changed(T[:, None], 5, 0, 0.0)[:, 0]}, ["row 6", "0.0 after 0.04", "1 steps backwards"]),
        ({"t": changed(T[:, None], 5, 0, np.nan)[:, 0]}, ["row 6", "'t'", "nan"]),
        ({"t": T[:9], "q": Q[:9]}, ["9 samples", "at least 10"]),
    ],
)
def test_unusable_input_is_refused_with_its_place(changes, words):
    with pytest.raises(InputError) as error:
        make(**changes)
    for word in ["made.csv", *words]:
        assert word in str(error.value)


def test_absent_channels():
    tau = changed(Q, slice(None), 1, np.nan)
    log = make(tau=tau, v=np.full_like(Q, np.nan))
    assert log.v is None
    assert log.has("tau").tolist() == [True, False, True]
    assert not log.has("v").any()
    assert log.has("q").all()
    assert [name for name in log.to_table() if name.startswith("tau")] == ["tau_shoulder", "tau_wrist"]
    with pytest.raises(UnknownNameError, match="torque"):
        log.has("torque")


def test_select_and_slice():
    log = make(tau=2 * Q, extra={"lift": T}, notes=("said",), sha256="0")
    part = log.select(["wrist", "shoulder"]).slice(10, -10)
    assert part.joints == ("wrist", "shoulder")
    np.testing.assert_array_equal(part.tau, 2 * Q[10:-10, [2, 0]])
    np.testing.assert_array_equal(part.extra["lift"], T[10:-10])
    assert (part.source, part.notes, len(part)) == ("made.csv", ("said",), 30)
    with pytest.raises(UnknownNameError, match=r"unknown joint 'elbo' in made\.csv; did you mean: elbow"):
        log.select(["elbo"])
    with pytest.raises(InputError, match="5 samples"):
        log.slice(0, 5)


@pytest.mark.parametrize("sha256", [None, "0"])
def test_two_parts_of_a_log_are_two_logs(sha256):
    log = make(sha256=sha256)
    assert len({x.identity for x in (log, log.slice(stop=20), log.slice(20), log.slice(20, 40))}) == 4
    assert log.slice(-30).identity == log.slice(20).identity
    assert log.slice().identity == log.identity
    check_logs([log.slice(stop=20), log.slice(20, 40)], [log.slice(40)])


def test_logs_with_the_same_numbers_in_other_channels_are_two_logs():
    same = [make(qcmd=Q), make(vcmd=Q), make(extra={"temperature_elbow": T}), make(extra={"temperature_wrist": T})]
    assert len({log.identity for log in same}) == 4


def test_duration_rate_repr():
    log = make()
    assert log.duration == pytest.approx(0.49)
    assert log.rate == pytest.approx(100.0)
    assert repr(log) == "Log('made.csv': 50 samples, 0.49 s at 100 Hz, q of shoulder, elbow, wrist)"


def test_pickle_keeps_everything_read_only():
    log = make(tau=Q, extra={"lift": T})
    again = pickle.loads(pickle.dumps(log))
    assert list(again.to_table()) == list(log.to_table())
    assert all(np.array_equal(again.to_table()[name], x) for name, x in log.to_table().items())
    assert not again.q.flags.writeable


@given(st.permutations(JOINTS), st.sets(st.sampled_from(["v", "a", "tau", "current"])))
def test_select_permutes_every_channel(order, channels):
    log = make(**{c: Q + k for k, c in enumerate(sorted(channels))})
    table, permuted = log.to_table(), log.select(order).to_table()
    assert sorted(table) == sorted(permuted)
    assert all(np.array_equal(table[name], permuted[name]) for name in table)


def test_no_motion_is_refused():
    check_motion(make())
    with pytest.raises(InputError, match=r"made\.csv: no joint moves"):
        check_motion(make(q=1.0 + 1e-4 * Q))


def test_torque_that_cannot_be_fitted_is_refused():
    check_torque(make(tau=Q))
    with pytest.raises(InputError, match=r"no torque column.*shoulder.*the log has t, q_shoulder") as error:
        check_torque(make())
    assert "current_gain" not in str(error.value)
    with pytest.raises(InputError, match=r"current_gain.*; the log has .*current_wrist"):
        check_torque(make(current=Q))
    zero = make(tau=changed(0 * Q, slice(None), 0, Q[:, 0]))
    check_torque(zero)
    with pytest.raises(InputError, match="zero throughout in tau_elbow, tau_wrist"):
        check_torque(zero, ["elbow", "wrist"])
    with pytest.raises(UnknownNameError):
        check_torque(zero, ["elbo"])
