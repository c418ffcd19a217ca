"""A recording as the diagnosis sees it."""
