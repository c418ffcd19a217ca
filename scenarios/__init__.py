"""Experiments on a device: described in TOML, run into a log, replayed from it bit for bit."""
