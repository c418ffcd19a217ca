"""The Python functions, one per file, with the defaults of its command."""
