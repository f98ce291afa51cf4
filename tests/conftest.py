"""Hypothesis draws the same examples on every CI run, new ones elsewhere; Ctrl-C works; one BLAS thread a process."""

import os
import signal

from hypothesis import settings

os.environ.pop("COLUMNS", None)  # a narrow terminal leaves columns out
# A shell lets its background jobs ignore Ctrl-C, and every process that they start. Tests of Ctrl-C run there too.
signal.signal(signal.SIGINT, signal.default_int_handler)
# Two test processes with a BLAS thread for each core wait for each other; OpenBLAS reads this when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
settings.register_profile("here", deadline=None)  # a busy machine is slow, not wrong
settings.register_profile("ci", derandomize=True, deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "here")
