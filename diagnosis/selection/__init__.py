"""Selects the model: one cost (likelihood plus prior) compares all hypotheses."""
