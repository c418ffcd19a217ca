"""Six simulated recordings whose diagnosis is accounted for.

White or swept torque, noise of force and reading, an encoder that is read at full precision. They
are the rows that `python -m benchmarks.bench_diagnosis` prints.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Rig:
    """A device file, what the machine has besides, its recording's length [s] and period [s].

    both: whether both masses are measured. hand: a torque pulse [N m] that nobody commanded.
    """

    device: Device
    physics: tuple[Physics, ...]
    seconds: float
    both: bool = False
    hand: float = 0.0

    def experiment(self) -> Experiment:
        """Return what its encoder says."""
        period = self.device.interface.period
        ticks = round(self.seconds / period)
        masses = self.device.chain.masses.size
        random = np.random.default_rng(11)
        t = np.arange(ticks) * period
        slow = sum(np.sin(2.0 * np.pi * f * t + p) for f, p in ((0.4, 0.3), (1.1, 2.0), (2.7, 4.0)))
        white = noise(duration=self.seconds, seed=1)
        white = np.interp(np.arange(ticks), np.linspace(0.0, ticks, white.size), white)
        command = 0.08 * slow + 0.05 * white / white.std()
        force = np.zeros((ticks, masses))
        force[:, 0] = 1e-3 * random.standard_normal(ticks)
        if self.hand:
            pushed = (t > 5.0) & (t < 5.8)
            force[pushed, 0] += self.hand * np.sin(np.pi * (t[pushed] - 5.0) / 0.8)
        run = simulate(
            self.device.with_physics(*self.physics), recorded(command), duration=self.seconds,
            disturbance=force if masses > 1 else force[:, 0], substeps=32 if self.physics else 1,
        )  # fmt: skip
        names = ["position_m1", "position_m2"][: 2 if self.both else 1]
        read = np.column_stack([run.trace[name] for name in names])
        read = read + 2e-5 * random.standard_normal(read.shape)
        outputs = tuple(Output("position", i) for i in range(len(names)))
        return Experiment(period, command, read, outputs)


ONE = Device("one mass", "", True, make_chain([1.5e-3], [4e-3]), Interface(period=1e-3))


def _two(period: float) -> Device:
    chain = make_chain([1.0e-3, 0.8e-3], [4e-3, 2e-3], 0.0, [12.0], [4e-3])
    return Device("two masses", "", True, chain, Interface(period=period))


def _rigs() -> Mapping[str, Callable[[], Rig]]:
    coulomb = make_physics("coulomb_friction", "m1", level=0.03)
    return {
        "one mass, clean": lambda: Rig(ONE, (), 10.0),
        "one mass, friction": lambda: Rig(ONE, (coulomb,), 10.0),
        "two masses, friction": lambda: Rig(_two(1e-3), (coulomb,), 8.0),
        "two masses, gravity, friction and a limit": lambda: Rig(
            _two(5e-3),
            (
                make_physics("gravity_pendulum", "m2", level=0.05, angle=0.4),
                make_physics(
                    "stribeck_friction", "m1", level=0.02, static_level=0.03, velocity=0.4
                ),
                make_physics("saturation", "command", limit=0.17),
            ),
            12.0,
        ),
        "two masses, play and friction": lambda: Rig(
            _two(2e-3), (make_physics("backlash", "link12", gap=0.02), coulomb), 12.0
        ),
        "one mass, a hand for 0.8 s": lambda: Rig(ONE, (coulomb,), 10.0, hand=0.06),
    }


RIGS = _rigs()
