"""Export of a device to other simulators (C, FMU, MJCF, URDF, SDF), with the losses of each."""
