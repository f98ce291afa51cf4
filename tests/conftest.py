"""Hypothesis draws the same examples on every CI run, and new ones on a developer's machine."""

import os

from hypothesis import settings

os.environ.pop("COLUMNS", None)  # a narrow terminal leaves columns out
settings.register_profile("here", deadline=None)  # a busy machine is slow, not wrong
settings.register_profile("ci", derandomize=True, deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "here")
