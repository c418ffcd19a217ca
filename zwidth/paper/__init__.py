"""The reproduction of the paper: one file per section of the report."""
