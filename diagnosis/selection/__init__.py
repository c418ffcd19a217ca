"""What is believed, and why: one cost for every hypothesis."""
