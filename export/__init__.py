"""What was found, for other simulators: C, FMU, MJCF, URDF, SDF, and what each loses."""
