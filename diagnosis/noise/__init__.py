"""Models of the noise of a recording; the likeliest is chosen."""
