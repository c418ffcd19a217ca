"""What `zwidth plan` promises of a session, against what `diagnose` finds in such sessions.

python -m benchmarks.plan_against_diagnosis [--times 3] [--seed 5]

Every effect at a number of times its limit is put into the PHANToM, a standard session of 20 s is
recorded with noise, and diagnosed with the device file alone. One line an effect.
"""

import argparse

from zwidth.diagnosis.diagnose import diagnose
from zwidth.planning.excitations import excitation, scale_for
from zwidth.planning.limits import Noise, limit, reference, sigma, strengthened
from zwidth.planning.rehearsal import rehearse
from zwidth.sim.device import place_label
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import make_physics

SEEN = Noise(2e-3, 1e-5)
FITTED = 0.7  # of a recording; the rest is held out
EFFECTS = [
    make_physics("coulomb_friction", "m1", level=1e-4),
    make_physics("coulomb_friction", "m3", level=1e-4),
    make_physics("backlash", "link12", gap=1e-6),
    make_physics("dead_band", "command", width=2e-4),
    make_physics("saturation", "command", limit=0.8),
    make_physics("quadratic_drag", "m1", coefficient=4e-6),
    make_physics("force_ripple", "m1", amplitude=1e-4, period=0.19, phase=0.3),
    make_physics("constant_force", "m1", level=7e-5),
    make_physics("cubic_stiffness", "link23", coefficient=2e3),
    make_physics("gain_asymmetry", "command", ratio=1.001),
    make_physics("actuator_lag", "command", time_constant=2e-5),
]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--times", type=float, default=3.0)
    parser.add_argument("--seed", type=int, default=5)
    asked = parser.parse_args()
    device = load_device("phantom_1_0")
    command = excitation("standard_session", device, 20.0, scale_for(device))
    prepared = reference(device, [rehearse(device, command, SEEN)], SEEN)
    print(
        "put in | sigma promised in the part fitted to | verdict: found, sigma, rivals below five"
    )
    for effect in EFFECTS:
        at_limit = limit(prepared, effect)
        assert at_limit is not None
        true = strengthened(at_limit, asked.times, prepared.peak)
        name = effect.effect.strength
        assert true is not None
        assert name is not None
        promised = FITTED**0.5 * sigma(prepared, true)
        recording = rehearse(device.with_physics(true), command, SEEN, seed=asked.seed)
        found = diagnose(device, [recording])
        words = [
            f"{f.effect}@{f.at} {estimate.value:.4g}, {f.separation_sigma:.1f}"
            + "".join(f", {r.effect}@{r.at} {r.separation_sigma:.1f}" for r in f.confusable_with)
            for f in found.findings
            for key, estimate in f.parameters.items()
            if key == name
        ]
        print(
            f"{place_label(true)} {true.values[name]:.4g} | {promised:.1f} |"
            f" {found.verdict.value}: {'; '.join(words)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
