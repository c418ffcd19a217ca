"""The public leader boards of nonlinear identification, by their own loaders, splits and metrics."""
