"""The public benchmarks of nonlinear identification: their own loaders, splits and metrics."""
