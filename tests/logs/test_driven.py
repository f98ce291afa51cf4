"""Logs with the torque of their drive are the same objects again and again, and no log lives because of them."""

import gc
import weakref

import numpy as np

import frischid as fr
from frischid.logs.driven import driven


def log_of_currents(**channels):
    t = np.arange(0.0, 2.0, 0.01)
    return fr.Log(t, ("elbow",), q=np.sin(t)[:, None], **channels)


def test_the_same_gains_give_the_same_log():
    log = log_of_currents(current=np.ones((200, 1)))
    (first,) = driven([log], None, fr.CurrentGains({"elbow": 12.0}))
    (again,) = driven([log], None, fr.CurrentGains({"elbow": 12.0}))
    (other,) = driven([log], None, fr.CurrentGains({"elbow": 13.0}))
    assert again is first
    assert np.all(first.tau == 12.0)
    assert np.all(other.tau == 13.0)


def test_a_log_that_needs_no_torque_is_freed():
    log = log_of_currents(tau=np.ones((200, 1)))
    assert driven([log], None, fr.CurrentGains({"elbow": 12.0})) == (log,)
    gone = weakref.ref(log)
    del log
    gc.collect()
    assert gone() is None
