"""The paper reproduced: one section of the report a file."""
