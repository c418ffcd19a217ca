"""How stiff a wall can be: exact linear theory, and verdicts from runs in the time domain."""
