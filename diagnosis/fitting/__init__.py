"""Models brought to the recordings: the cost of many at once, and searches that arrive."""
