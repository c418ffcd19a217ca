"""How near the search comes to play of 0.01 rad, from a device file that is exact: one row a seed.

Two masses at 500 Hz (tests/test_fitting.py), 7000 ticks, alone and beside friction of 0.03 N m; the
fit begins at a gap of 0.003 rad, where descent ends. Columns: the cost of a fit that begins at the
truth, of the one that begins at 0.003, and of what populations arrived at, with its gap.

    python -m benchmarks.arrive_at_play --seeds 7 8 9 10 11 12
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.selection.effort import NORMAL
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.selection.search import Search, look_for_valleys, silent
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from fitting_examples import drive, recording  # pyright: ignore[reportMissingImports]

GAP, FROM, LEVEL = 0.01, 0.003, 0.03


def model_of(physics: tuple[Physics, ...], gap: float) -> Model:
    """The drive's model with friction as put in, if it was, and play of a gap."""
    model = Model(drive())
    for p in physics[1:]:
        model = model.with_effect(p, dict(p.values))
    play = make_physics("backlash", "link12", gap=gap)
    return model.with_effect(play, {"gap": GAP})


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[7, 8, 9, 10, 11, 12])
    asked = parser.parse_args()
    play = make_physics("backlash", "link12", gap=GAP)
    friction = make_physics("coulomb_friction", "m1", level=LEVEL)
    print("seed  friction   from truth  from 0.003    arrived      gap  off by  seconds")
    for seed in asked.seeds:
        for physics in ((play, friction), (play,)):
            made = [recording(drive().with_physics(*physics), 10_000, seed).split()[0]]
            there, begun = (
                settled(judged(made, m, np.zeros(len(m.parameters))))
                for m in (model_of(physics, GAP), model_of(physics, FROM))
            )
            found = Search(begun, begun, NORMAL, silent)
            since = time.perf_counter()
            look_for_valleys(found)
            spent = time.perf_counter() - since
            best = found.best
            gap = best.model.effects_at(best.x)[-1].values["gap"]
            print(
                f"{seed:4d}  {LEVEL if len(physics) > 1 else 0.0:8.2f}  {there.cost.misfit:11.0f}"
                f" {begun.cost.misfit:11.0f} {best.cost.misfit:10.0f} {gap:8.5f}"
                f" {100.0 * (gap / GAP - 1.0):5.1f} % {spent:8.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
