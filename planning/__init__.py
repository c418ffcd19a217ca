"""What a planned recording would show, and what to record next."""
