"""One picture per file: from plain results to a matplotlib figure, without the engine."""
