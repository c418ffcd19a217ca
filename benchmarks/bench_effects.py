"""What each effect costs: the scalar kernel with it, beside the same substeps without.

    python -m pytest benchmarks/bench_effects.py --benchmark-only --benchmark-columns=min -s

One effect at a time, at its first place, ten substeps a tick; -s prints nanoseconds a substep. The
linear path is what runs where every effect is off. Run on an idle machine.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from zwidth.controllers.wall import wall
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.kernel import advance, scratch
from zwidth.sim.physics import EFFECTS
from zwidth.sim.run import Start, prepare

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from physics_examples import example  # pyright: ignore[reportMissingImports]

LAW = wall(10.0, 0.03)
TICKS, SUBSTEPS = 2000, 10


def measure(benchmark: BenchmarkFixture, device: Device) -> None:
    """Time the kernel alone and say what a substep costs."""
    setup = prepare(device, LAW, duration=TICKS * 1e-3, start=Start(1e-3), substeps=SUBSTEPS)
    record, space = np.zeros((0, 1)), scratch(setup.eq)
    fine, start = np.zeros((0, setup.eq.states)), setup.memory.x.copy()

    def run() -> int:
        setup.memory.x[:] = start
        done, _ = advance(
            setup.eq, LAW.step, LAW.parameters, setup.memory, space, TICKS, setup.external, 1e6,
            record, fine, False,
        )  # fmt: skip
        return done

    done = benchmark.pedantic(run, rounds=40, warmup_rounds=2)  # a rectified sensor loses the wall
    if benchmark.stats is None:
        return
    cost = 1e9 * np.min(benchmark.stats.stats.data) / (done * int(setup.eq.substeps.sum()))
    benchmark.extra_info["ns_per_substep"] = cost
    print(f"\n{benchmark.name}: {cost:.1f} ns per substep")


def test_all_off(benchmark: BenchmarkFixture) -> None:
    measure(benchmark, load_device("phantom_1_0"))


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_effect(benchmark: BenchmarkFixture, name: str) -> None:
    measure(benchmark, load_device("phantom_1_0").with_physics(example(name)))


@pytest.mark.parametrize("places", [("m1", "m2"), ("m1", "m2", "m3")])
def test_friction_at_several_masses(benchmark: BenchmarkFixture, places: tuple[str, ...]) -> None:
    effects = [example("coulomb_friction", place) for place in places]
    measure(benchmark, load_device("phantom_1_0").with_physics(*effects))
