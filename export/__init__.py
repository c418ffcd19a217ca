"""Export of a device to other simulators: C, FMU, MJCF, URDF, SDF, and what each loses."""
