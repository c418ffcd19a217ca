"""What was recorded, what is known to have acted, and what is odd about it."""
