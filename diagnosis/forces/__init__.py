"""Forces that no library effect explains: their place and the state they depend on."""
