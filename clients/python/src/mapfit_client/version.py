"""This package's version."""

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as _installed

try:
    VERSION = _installed("mapfit-client")
except PackageNotFoundError:  # from a source tree
    VERSION = "0"
