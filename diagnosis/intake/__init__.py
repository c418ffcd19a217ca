"""Recordings as they are taken: what is odd or wrong about them."""
