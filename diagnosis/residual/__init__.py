"""Forces that have no name: where, and following what."""
