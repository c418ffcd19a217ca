"""What a recording would show before it is made, and what to record next."""
