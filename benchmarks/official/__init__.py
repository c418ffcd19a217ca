"""The public leader boards of nonlinear identification: their own loaders, splits and metrics."""
