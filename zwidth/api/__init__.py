"""The Python functions, one question per file, with the defaults of its command."""
