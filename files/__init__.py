"""Writing of files: whole or not at all, and never over a file that a user made."""
