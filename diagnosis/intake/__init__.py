"""Checks recordings before the diagnosis: wrong units, swapped columns, lost samples, clocks."""
