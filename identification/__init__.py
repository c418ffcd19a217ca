"""Identification from signals: frequency response, ten parameters, relay critical points."""
