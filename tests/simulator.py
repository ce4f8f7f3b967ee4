"""ngspice in tests: those that need it are skipped where there is none, and fail in CI instead."""

import os
import shutil

import pytest

needs_ngspice = pytest.mark.skipif(
    shutil.which("ngspice") is None and "CI" not in os.environ, reason="ngspice is not installed"
)
