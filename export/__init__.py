"""What was found, for other simulators: C, FMU, Modelica, MJCF, URDF, SDF, and what each loses."""
