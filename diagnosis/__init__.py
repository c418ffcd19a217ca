"""Why a recording differs from the simulation: where, what physics is missing, and how sure."""
