"""Many recordings at once: which parameters are shared, which differ, and what they depend on."""
