"""One control law a file: virtual wall, recorded command, none, relay, excitation."""
