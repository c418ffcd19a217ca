"""How files are written: whole or not at all, and over nothing that a user made."""
