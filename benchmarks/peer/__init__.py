"""What `benchmarks/peers.py` compares: the sets, one method a file, and the page."""
