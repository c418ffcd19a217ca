"""Proposes effects to add: how much of a model's residual each could explain."""
