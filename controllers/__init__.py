"""One control law per file: virtual wall, recorded command, none, relay, excitation."""
