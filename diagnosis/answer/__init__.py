"""What is said in the end, and whether it is any good."""
