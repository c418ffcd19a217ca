"""How stiff a wall is stable: exact linear theory, and verdicts from runs in the time domain."""
