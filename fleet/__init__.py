"""Many recordings at once: what is the same in all, what differs, and what it follows."""
