"""What a recording scatters by: a family of models of the noise, one of which is the likeliest."""
