"""Writes traces to files and reads them back: MCAP logs, and recordings of other tools."""
