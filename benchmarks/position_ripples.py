"""What repeats with position on real drives, as a curve, a formula and an improved fit.

A fine ripple shows in the next sample, friction over half a second, and an answer is one of two
searches (docs/diagnosis.md). So this takes the first of them: the search one sample ahead names
what it can, and where a ripple is among that, which is one sine, a law of any shape that repeats is
learned in its place, at a period that is fitted with it.

    python -m benchmarks.position_ripples RECORDINGS [NAME...]

RECORDINGS as for docs/make_machine_pages.py. Printed for each machine: the names, the ripple's
period, the curve with its 95 % band, its formulas; and on held-out data, with friction alone, with
the ripple and with the law in its place, the error one sample ahead, -2 ln of the likelihood, and
the rms force that the motion needs less the force that acts; and by how much less the law costs
than the sine, beside what makes one believed over it. A picture is left in runs/position_ripples.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path

from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.answer.inverse import force_errors
from zwidth.diagnosis.answer.laws import LearnedLaw, like_what
from zwidth.diagnosis.answer.result import HeldOut
from zwidth.diagnosis.intake.take_in import Taken, take_in
from zwidth.diagnosis.learning.curves import as_learned, over_turns
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against, judged, settled
from zwidth.diagnosis.selection.search import Search, search
from zwidth.diagnosis.selection.searched import Searched, as_found
from zwidth.figures.learned import learned_figure
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device

PICTURES = Path(__file__).parents[1] / "runs" / "position_ripples"
NAMES = ("emps", "rack_and_pinion")
RIPPLE = "force_ripple"
LN = math.log(1.0 / ALPHA)


def main() -> None:
    """Print what repeats on each machine."""
    from docs.make_machine_pages import MACHINES, PAGES, experiments

    parser = argparse.ArgumentParser()
    parser.add_argument("recordings", type=Path)
    parser.add_argument("names", nargs="*", default=list(NAMES))
    asked = parser.parse_args()
    for name in asked.names:
        device = load_device(PAGES / name / "device.toml")
        every = experiments(name, MACHINES[name].fit, device, asked.recordings)
        taken = take_in(device, every, None)
        found = search(device, taken.fit_on, QUICK)
        print(f"{name}: {found.best.model.label}", flush=True)
        with_law = _learned(device, taken, found)
        if with_law is None:
            print("  no ripple is named one sample ahead")
            continue
        PICTURES.mkdir(parents=True, exist_ok=True)
        learned_figure(with_law, device.rotary).savefig(PICTURES / f"{name}_ripple.png", dpi=110)


def _learned(device: Device, taken: Taken, found: Search) -> LearnedLaw | None:
    """The law in the place of the first ripple, what is known of it printed."""
    best = found.best
    ripples = [i for i, p in enumerate(best.model.effects) if p.effect.name == RIPPLE]
    for i in ripples:
        p = best.model.effects_at(best.x)[i]
        print("  ripple", {key: float(f"{v:.5g}") for key, v in p.values.items()}, flush=True)
    turned = next(over_turns(best, silent), None)
    if turned is None:
        return None
    h, site = turned
    curve = as_learned(h, site, best, found)
    model, x = best.model.less(best.x, *ripples)
    without = settled(judged(best.experiments, model, x, best.family))
    _fits(device, taken, found, without, "without")
    names, _ = _fits(device, taken, found, best, "with the ripple")
    after, with_law = _fits(device, taken, found, h, "with the law")
    looks, whole = like_what(curve)
    print(f"  period {curve.period:.6g}, beside {', '.join(curve.names)}")
    phi = against(h, best).phi
    print(f"  costs {curve.gained:.0f} less than the ripple, {2.0 * phi * LN:.0f} is believed")
    for s, f, low, high in zip(curve.states, curve.forces, curve.lower, curve.upper, strict=True):
        print(f"    {s:.6g}: {f:.4g} ({low:.4g} to {high:.4g})")
    for f in looks:
        print(f"  looks like {f.form.name}: {f.text('q')} (chance {f.chance:.2g})")
    return LearnedLaw(curve, names, after, with_law, looks, whole)


def _fits(
    device: Device, taken: Taken, found: Search, h: Hypothesis, name: str
) -> tuple[HeldOut, Searched]:
    """Held-out fits of a hypothesis, printed; its free runs, and it as found."""
    there = as_found(device, replace(found, best=h))
    step, free = held_out(device, there, taken.judge_by)
    near = h.family.near(h.ratio)
    cost = judged(taken.judge_by, h.model, h.x, h.family, near).cost.misfit
    forces = force_errors(device, there, taken.fit_on, taken.judge_by)
    lacks = ", ".join(
        f"{f.errors['after']:.3g} {f.unit} of {f.sizes['after']:.3g} below {f.band:.0f} Hz"
        for f in forces
        if f.held_out
    )
    print(
        f"  {name}: next sample {step.after:.4g} of the motion, -2 ln {cost:.0f},"
        f" free run {free.after:.4g}, force {lacks}",
        flush=True,
    )
    return free, there


if __name__ == "__main__":
    main()
