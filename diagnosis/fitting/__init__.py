"""Fits models to recordings: cost of many models at once, local and global searches."""
