"""Linear algebra of the public functions is on one thread, and the caller's number of threads comes back."""

import pytest
import scipy.linalg
from threadpoolctl import threadpool_info, threadpool_limits

import frischid as fr
from frischid.core.threads import on_one_thread

assert scipy.linalg  # the libraries must be there before their threads are counted


def threads():
    return [x["num_threads"] for x in threadpool_info() if x["user_api"] == "blas"]


@pytest.mark.parametrize("fails", [False, True])
def test_the_callers_threads_come_back(fails):
    @on_one_thread
    def inside():
        assert set(threads()) == {1}
        if fails:
            raise ValueError("its own")
        return 3

    with threadpool_limits(limits=2, user_api="blas"):
        before = threads()
        if fails:
            with pytest.raises(ValueError, match="its own"):
                inside()
        else:
            assert inside() == 3
        assert threads() == before


def test_a_fit_and_a_search_are_on_one_thread():
    """Before, `identify` of an arm with 12 joints took 49 s in place of 4 s where other programs used the cores too."""
    robot, seen = fr.Robot.load("planar2"), []
    log = fr.simulate(robot, fr.random_fourier(robot, 6.0, seed=1), rate=50.0, noise=fr.Noise(tau=0.01))

    def watch(*_):
        seen.append(threads())

    with threadpool_limits(limits=2, user_api="blas"):
        model = fr.identify(robot, [log], recursion="none", progress=watch).model
        fr.diagnose(model, [log], effects=["joint_spring"], progress=watch)
        fr.add(model, fr.parse_effects("stribeck(speed=0.1)"), [log], progress=watch)
        fr.improve(model, [log], effects=["joint_spring"], max_steps=1, progress=watch)
    assert seen
    assert all(set(x) == {1} for x in seen)
