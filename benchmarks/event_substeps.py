"""How far dry friction and play are off, by the substeps of a tick in which one turns or opens.

    python benchmarks/event_substeps.py

White torque on the PHANToM of Table I for 5 s, and the account's rig with play and friction at
500 Hz for 12 s: innovations with so many substeps less those with 512, in standard deviations of
the innovations, all samples together.
"""

import numpy as np

from benchmarks.account_rigs import RIGS
from benchmarks.bench_diagnosis import record
from zwidth.diagnosis.noise.predictor import (
    SETTLING,
    Fineness,
    Gain,
    innovations,
    observer_for,
    prepared,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import make_physics

SECONDS, REFERENCE = 5.0, 512
SUBSTEPS = (1, 2, 4, 8, 16, 32)
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
        show(name, there, experiment, gain)
    rig = RIGS["two masses, play and friction"]()
    there, experiment = rig.device.with_physics(*rig.physics), rig.experiment()
    show("backlash, coulomb_friction", there, experiment, observer_for(there, experiment, 1e-3))


def show(name: str, device: Device, experiment: Experiment, gain: Gain) -> None:
    """Print how far off a device is."""

    def ahead(substeps: int) -> np.ndarray:
        ready = prepared(device, Fineness(8, substeps))
        return innovations(device, experiment, gain, ready=ready)[SETTLING:]

    truth = ahead(REFERENCE)
    size = float(truth.std())
    off = [float(np.linalg.norm(ahead(n) - truth)) / size for n in SUBSTEPS]
    print(name, *(f"{sigma:.2g}" for sigma in off))


if __name__ == "__main__":
    main()
