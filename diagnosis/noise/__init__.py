"""Models of the noise of a recording; the most likely is chosen."""
