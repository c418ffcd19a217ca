"""Learns laws if no library effect explains a recording, and finds formulas close to them."""
