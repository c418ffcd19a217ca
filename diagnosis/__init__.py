"""Find why a recording differs from its simulation: what physics is missing, where, how sure."""
