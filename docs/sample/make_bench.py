"""Make `bench.csv`, a simulated bench whose physics is known, and `bench.svg`, what is found in it.

    python docs/sample/make_bench.py

A motor with an arm on its shaft: one rotating mass with a damper, Stribeck friction and the gravity
of the arm. The torque is a sum of sines; the angle is read with noise of 0.005 degrees (rms).
"""

import csv
from pathlib import Path

import numpy as np

import zwidth

PERIOD = 0.002  # [s]
SECONDS = 8.0
TORQUES = ((0.11, 0.5), (0.07, 1.3), (0.05, 2.9), (0.03, 7.1))  # [N m], [Hz]
NOISE = 0.005  # [degrees], rms


def bench() -> zwidth.Device:
    """Return the bench as it is; what `zwidth diagnose` is asked to find is its physics."""
    rotor = zwidth.make_chain(masses=[1.2e-3], ground_dampers=[3e-3])  # kg m2, N m s/rad
    friction = zwidth.make_physics(
        "stribeck_friction", "m1", level=0.025, static_level=0.040, velocity=0.6
    )
    arm = zwidth.make_physics("gravity_pendulum", "m1", level=0.08, angle=0.0)
    interface = zwidth.Interface(period=PERIOD)
    return zwidth.Device("bench", "", True, rotor, interface).with_physics(friction, arm)


def main() -> None:
    """Write the recording and the picture of its diagnosis beside this file."""
    t = np.arange(round(SECONDS / PERIOD)) * PERIOD
    random = np.random.default_rng(5)
    torque = np.zeros(t.size)
    for amplitude, f in TORQUES:
        torque = torque + amplitude * np.sin(2 * np.pi * f * t + random.uniform(0, 6))
    run = zwidth.simulate(bench(), zwidth.recorded(torque))
    angle = np.degrees(run.trace.channels["position_m1"])[: t.size]
    angle = angle + random.normal(0, NOISE, t.size)
    recording = Path(__file__).with_name("bench.csv")
    with recording.open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["time_s", "torque_Nm", "angle_deg"])
        rows = zip(t, torque, angle, strict=True)
        lines.writerows([f"{a:.3f}", f"{b:.5f}", f"{c:.4f}"] for a, b, c in rows)
    zwidth.diagnose(recording).plot("motion").savefig(recording.with_suffix(".svg"))


if __name__ == "__main__":
    main()
