"""Settings of all tests."""

import signal

import pytest
from hypothesis import settings

settings.register_profile("shared", deadline=None)  # machines are shared: time is no property
settings.load_profile("shared")


@pytest.fixture
def interruptible():
    """Python's own answer to SIGINT, here and in child processes.

    A run that was started with ``nohup``, or by ``&`` in a script, ignores SIGINT, and so does
    whatever it starts.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
