"""One picture a file: from plain results to a matplotlib figure, nothing of the engine."""
