"""Follows a log while it is written: its faults, its diagnosis, the stiffest wall."""
