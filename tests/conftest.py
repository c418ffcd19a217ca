"""Tests are deterministic: hypothesis draws the same examples every time."""

from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None, database=None)
settings.load_profile("same")
