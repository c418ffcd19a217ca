"""Tests are deterministic: hypothesis draws the same examples every time."""

import os

from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices, and tests run side by side

settings.register_profile("same", derandomize=True, deadline=None, database=None)
settings.load_profile("same")
