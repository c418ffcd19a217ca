"""What was found, for other simulators: C, MJCF, URDF, SDF, and what each of them cannot hold."""
