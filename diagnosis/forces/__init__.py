"""Forces that no library effect explains: where they act and which state they follow."""
