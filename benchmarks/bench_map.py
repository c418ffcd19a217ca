"""Maps: a full lattice of 100 x 100 runs of 4 s, and a refined map of the same boundary.

    python -m pytest benchmarks/bench_map.py --benchmark-only --benchmark-columns=min,median -s

All cores are used. Run on an idle machine.
"""

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.stability.fate_map import make_map
from zwidth.stability.fates import evaluate
from zwidth.stability.judging import Trial
from zwidth.stability.plane import Axis, Plane, with_friction

B, K = Axis("B", 0.0, 0.12), Axis("K", 0.5, 50.0)
PHANTOM = load_device("phantom_1_0")
STEPPED = PHANTOM.with_interface(encoder_step=1e-4, command_limit=0.5, delay=0.0023)
DEVICES = {"step, limit, delay": (STEPPED, 1), "friction": (with_friction(PHANTOM, 2e-3), 10)}


def plane(device: Device, substeps: int, limit: float) -> Plane:
    """Return the K-B plane of a device."""
    return Plane(device, B, K, trial=Trial(1e-3, 4.0, limit, substeps=substeps))


@pytest.mark.parametrize("name", list(DEVICES))
def test_full_lattice(benchmark: BenchmarkFixture, name: str) -> None:
    """10 000 runs of 4 s, none of them longer."""
    some = plane(*DEVICES[name], 4.0)
    b, k = np.meshgrid(B.values(100), K.values(100))
    benchmark.pedantic(evaluate, (some, b.ravel(), k.ravel()), rounds=3, warmup_rounds=1)


@pytest.mark.parametrize("name", list(DEVICES))
def test_refinement(benchmark: BenchmarkFixture, name: str) -> None:
    """Runs of up to 16 s; -s prints the runs saved, and how many fates differ from the full map."""
    some = plane(*DEVICES[name], 16.0)
    found = benchmark.pedantic(make_map, (some, 25, 3), rounds=1)
    x, y = np.meshgrid(found.x, found.y)
    full = evaluate(some, x.ravel(), y.ravel()).fate.reshape(x.shape)
    share = float(np.mean(full != found.fates.fate))
    saved = full.size / found.runs
    benchmark.extra_info |= {"runs": found.runs, "saved": saved, "wrong": share}
    print(f"\n{name}: {found.runs} runs, {saved:.1f} times fewer, {100.0 * share:.2f} % differ")
