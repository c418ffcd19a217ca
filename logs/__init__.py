"""A trace to a file and back: MCAP logs that viewers open and replays trust."""
