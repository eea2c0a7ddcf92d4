"""What the whole suite shares: a table cache of its own, and no windows."""

import os
import tempfile

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Give all processes of the run one empty table cache; the user's own is left alone."""
    os.environ["PYVISTA_OFF_SCREEN"] = "true"
    if not hasattr(config, "workerinput"):  # workers inherit the environment of the controller
        cache = tempfile.TemporaryDirectory(prefix="limitsurf-tests-")
        config.add_cleanup(cache.cleanup)
        os.environ["LIMITSURF_CACHE_DIR"] = cache.name
