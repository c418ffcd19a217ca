"""Recordings in which physics is concealed, made by other code than the engine's."""
