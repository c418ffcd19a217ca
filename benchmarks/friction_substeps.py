"""How far dry friction is off, by the substeps of a tick in which it turns.

    python benchmarks/friction_substeps.py

White torque on the PHANToM of Table I for 5 s: innovations with so many substeps less those with
512, in standard deviations of the innovations, all samples together.
"""

import numpy as np

from benchmarks.bench_diagnosis import ENCODER_NOISE, record
from zwidth.diagnosis.noise.predictor import SETTLING, Fineness, innovations, observer_for, prepared
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import make_physics

SECONDS, REFERENCE = 5.0, 512
SUBSTEPS = (2, 4, 8, 16, 32, 64)
LAWS = {
    "coulomb_friction": {"level": 4e-3},
    "stribeck_friction": {"level": 3e-3, "static_level": 5e-3, "velocity": 1.0},
    "directional_friction": {
        "level_plus": 3e-3, "level_minus": 5e-3, "viscous_plus": 1e-4, "viscous_minus": 0.0,
    },
}  # fmt: skip


def main() -> None:
    """Print a line a law."""
    device = load_device("phantom_1_0").with_interface(delay=0.0)
    coulomb = make_physics("coulomb_friction", "m1", level=4e-3)
    experiment = record(device.with_physics(coulomb), SECONDS)
    gain = observer_for(device, experiment, 1e-3)
    print("substeps:", *SUBSTEPS)
    for name, values in LAWS.items():
        there = device.with_physics(make_physics(name, "m1", **values))

        def ahead(substeps: int) -> np.ndarray:
            ready = prepared(there, Fineness(8, substeps, (16, 32)))  # noqa: B023
            return innovations(there, experiment, gain, ready=ready)[SETTLING:]  # noqa: B023

        truth = ahead(REFERENCE)
        off = [float(np.linalg.norm(ahead(n) - truth)) / ENCODER_NOISE for n in SUBSTEPS]
        print(name, *(f"{sigma:.2g}" for sigma in off))


if __name__ == "__main__":
    main()
