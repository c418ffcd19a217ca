"""What a device is, from its signals: frequency response, ten parameters, relay critical points."""
