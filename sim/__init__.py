"""The engine: a device under a sampled controller, tick by tick; imports no higher package."""
