"""Settings of all tests."""

from hypothesis import settings

settings.register_profile("shared", deadline=None)  # machines are shared: time is no property
settings.load_profile("shared")
