"""The installed version of frischid; a model file, a report and a cluster's workers carry the version."""

from importlib import metadata

__version__ = metadata.version("frischid")
