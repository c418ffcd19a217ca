"""A device with free parameters."""
