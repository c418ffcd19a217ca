"""Make `docs/what_the_linear_boundary_does_not_say.md` and its pictures.

    python docs/make_linear_boundary_page.py

Thirty-six maps of the PHANToM over B and K: four encoder steps, three limits, three levels of
friction; and two over start amplitude and K. They are kept under `runs/` as they are made, so an
interrupted run goes on where it stopped. All took 45 s of processor time, compiled before.
"""

import itertools
import math
import sys
import textwrap
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from zwidth.figures.map import draw_fates, legend
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text, write_with
from zwidth.sim.device_file import load_device
from zwidth.sim.fate import Fate
from zwidth.sim.jit import cache_folder
from zwidth.sim.readable import plain
from zwidth.stability.fate_map import FateMap, make_map
from zwidth.stability.fates import evaluate
from zwidth.stability.judging import Trial
from zwidth.stability.map_summary import summary
from zwidth.stability.plane import Axis, Plane, with_friction
from zwidth.stability.plane_theory import describing_lines

DOCS = Path(__file__).parent
MAPS = DOCS.parent / "runs" / "linear_boundary" / cache_folder().name  # by version of the kernels
PAGE = "what_the_linear_boundary_does_not_say"
PICTURES = "linear_boundary"
STEPS = (0.0, 1e-5, 1e-4, 1e-3)  # rad
LIMITS = (math.inf, 0.5, 0.1)  # N m
LEVELS = (0.0, 0.002, 0.010)  # N m
COARSE, REFINEMENTS = 25, 2
ALIKE = 0.01  # of the points of a map, up to which another says the same
AGAIN, LONG_S = 200, 128.0  # points of a map that are judged again, over a longer time
Key = tuple[float, float, float]


def plane(key: Key) -> Plane:
    """Return the K-B plane of the PHANToM with (encoder step, limit, friction)."""
    step, limit, level = key
    device = load_device("phantom_1_0").with_interface(encoder_step=step, command_limit=limit)
    trial = Trial(1e-3, 4.0, 16.0, substeps=10 if level > 0.0 else 1)
    return Plane(with_friction(device, level), Axis("B", 0.0, 0.12), Axis("K", 0.5, 50.0), 1.0,
                 0.0, trial)  # fmt: skip


def maps() -> dict[Key, FateMap]:
    """Return all maps, from their folders where they are finished."""
    found: dict[Key, FateMap] = {}
    for key in itertools.product(STEPS, LIMITS, LEVELS):
        name = "step_{:g}_limit_{:g}_friction_{:g}".format(*key)
        found[key] = make_map(plane(key), COARSE, REFINEMENTS, MAPS / name)
        print(name, found[key].runs, "runs", file=sys.stderr)
    return found


def named(key: Key) -> str:
    """Return the title of a panel: its own settings."""
    step, limit, level = key
    words = [
        f"step {plain(step)} rad" if step else "",
        f"limit {limit:g} N m" if limit < math.inf else "",
        f"friction {1e3 * level:g} mN m" if level else "",
    ]
    return ", ".join(w for w in words if w) or "nothing but the linear loop"


def told_apart(found: dict[Key, FateMap], step: float) -> list[Key]:
    """Return the maps of a step, a row a limit, without the rows that repeat the one above."""
    kept = [LIMITS[0]]
    for limit in LIMITS[1:]:
        pairs = ((found[step, kept[-1], f], found[step, limit, f]) for f in LEVELS)
        unlike = [np.mean(a.fates.fate != b.fates.fate) for a, b in pairs]
        kept += [limit] if max(unlike) > ALIKE else []
    return list(itertools.product((step,), kept, LEVELS))


def picture(found: dict[Key, FateMap], keys: list[Key], columns: int, name: str) -> str:
    """Draw some maps side by side; returns the picture's file name."""
    rows = -(-len(keys) // columns)
    figure = Figure(figsize=(3.1 * columns, 2.75 * rows + 0.5), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for place, key in zip(axes.ravel(), keys, strict=True):
        draw_fates(place, found[key])
        place.set_title(named(key), fontsize=8)
        place.label_outer()
        place.tick_params(labelsize=7)
        place.xaxis.label.set_fontsize(7)
        place.yaxis.label.set_fontsize(7)
    figure.legend(
        handles=legend([found[k] for k in keys]), loc="outside lower center", ncols=3, fontsize=7
    )
    return saved(figure, name)


def saved(figure: Figure, name: str) -> str:
    """Write a picture; returns its place seen from the page."""
    file = f"{PICTURES}/{name}.png"
    write_with(DOCS / file, partial(figure.savefig, format="png", dpi=100))
    return file


def basin(levels: tuple[float, ...]) -> str:
    """Draw K over the amplitude of the start for some levels of friction, theory beside it."""
    figure = Figure(figsize=(4.6 * len(levels), 3.6), layout="constrained")
    for place, level in zip(figure.subplots(1, len(levels)), levels, strict=True):
        one = plane((0.0, math.inf, level))
        wide = replace(one, x=Axis("amplitude", 1e-4, 1e-1, "log"), damping=0.03)
        result = make_map(wide, COARSE, REFINEMENTS, MAPS / f"amplitude_friction_{level:g}")
        lines = describing_lines(wide)
        draw_fates(place, result, lines)
        place.set_title(f"friction {1e3 * level:g} mN m, B = 0.03 N m s/rad", fontsize=8)
    handles = legend([result], lines)
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=7)
    return saved(figure, "basin")


def percent(share: float) -> str:
    """Return a share as a percentage for the text."""
    value = 100.0 * share
    if 0.0 < value < 0.1:
        return "< 0.1\u00a0%"
    return f"{value:.0f}\u00a0%" if value >= 10.0 or value == 0.0 else f"{value:.1f}\u00a0%"


def table(facts: dict[Key, dict[str, Any]]) -> str:
    """Return the table of all maps; limits under which all shares are the same share a row."""
    lines = [
        "| encoder step [rad] | friction [mN m] | limit [N m] | stable, but does not rest |"
        " stable, but felt or grows | unstable, but rests | unstable, grows |",
        "|---|---|---|---|---|---|---|",
    ]
    shares = ("stable_but_not_resting", "stable_but_perceptible", "unstable_but_resting",
              "unstable_and_growing")  # fmt: skip
    for step, level in itertools.product(STEPS, LEVELS):
        rows: dict[tuple[str, ...], list[str]] = {}
        for limit in LIMITS:
            cells = tuple(percent(facts[step, limit, level][s]) for s in shares)
            rows.setdefault(cells, []).append("none" if limit == math.inf else f"{limit:g}")
        for cells, limits in rows.items():
            row = (f"{step:g}", f"{1e3 * level:g}", ", ".join(limits), *cells)
            lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines)


def facts_of(found: FateMap) -> dict[str, Any]:
    """Return the numbers of a map that the page uses."""
    grows = found.fates.fate == Fate.GROWS
    unstable = found.linear >= 0.0
    return summary(found) | {
        "unstable_and_growing": float(grows[unstable].mean()),
        "stable_but_growing": float(grows[~unstable].mean()),
    }


def judged_again(found: dict[Key, FateMap]) -> str:
    """Say how many of some points of three maps keep their fate over a longer time."""
    rng, same, asked = np.random.default_rng(1), 0, 0
    for step in STEPS[1:]:
        key = step, math.inf, 0.0
        result, longer = found[key], plane(key)
        longer = replace(longer, trial=replace(longer.trial, limit_s=LONG_S))
        j, i = np.nonzero(result.run)
        some = rng.choice(j.size, AGAIN, replace=False)
        now = evaluate(longer, result.x[i[some]], result.y[j[some]]).fate
        same += int(np.sum(now == result.fates.fate[j[some], i[some]]))
        asked += AGAIN
    return f"{same} of {asked}"


def unlike_in_full(found: dict[Key, FateMap]) -> float:
    """Return the share of a map's points that a full lattice shows differently."""
    key = STEPS[2], math.inf, 0.0
    result = found[key]
    x, y = np.meshgrid(result.x, result.y)
    full = evaluate(plane(key), x.ravel(), y.ravel()).fate.reshape(x.shape)
    return float(np.mean(full != result.fates.fate))


def text(found: dict[Key, FateMap]) -> str:
    """Return the page, with the numbers of these maps."""
    facts = {key: facts_of(one) for key, one in found.items()}
    inf = math.inf
    fine, middle, rough = (facts[step, inf, 0.0] for step in STEPS[1:])
    slight, firm = (facts[0.0, inf, level] for level in LEVELS[1:])
    held = facts[0.0, 0.1, 0.0]["describing_function"]
    both, loose = facts[1e-3, inf, 0.002], facts[1e-3, inf, 0.0]
    tight = facts[1e-3, 0.1, 0.0]
    # Without steps they are the picture of friction, whatever the limit.
    pictures = {s: picture(found, told_apart(found, s), 3, f"step_{s:g}") for s in STEPS[1:]}
    single = [
        picture(found, [(step, inf, 0.0) for step in STEPS], 2, "steps"),
        picture(found, [(0.0, inf, level) for level in LEVELS], 3, "friction"),
        basin(LEVELS[1:]),
    ]
    runs = sum(f["runs"] for f in facts.values())
    lattice = sum(f["lattice"] for f in facts.values())
    return f"""# What the linear boundary does not say

In linear theory a wall is stable or unstable. With an encoder, an amplifier and bearings, a run
comes to rest, dithers (keeps oscillating by a few encoder steps, felt or not), or grows, up to the
amplifier's limit or without bound. The maps below show the outcome for the PHANToM of the paper
with 2 ms of delay, released at rest 1 mrad inside a two-sided wall. The black line is the linear
boundary.

Dither counts as felt from a command of 0.01 N m on. `--felt-force` changes this assumption. At 0.1
m from the axis it is 0.1 N, and fingertips notice forces from 0.03 N on (King, Donlin and
Hannaford, Haptics Symposium 2010). Vibration of the skin is left out, because the radius of the
handle is not known.

`python docs/make_linear_boundary_page.py` computes all pictures and numbers of this page, with
{runs} runs of 4 to 16 s for lattices of {lattice} points. `zwidth map` draws such a map of any
device.

## One thing at a time

![Maps for four encoder steps]({single[0]})

**Encoder steps.** With encoder steps, few stable walls come to rest. Of the linearly stable part,
{percent(fine["stable_but_not_resting"])} dithers at a step of 1e-5 rad,
{percent(middle["stable_but_not_resting"])} at 1e-4 and {percent(rough["stable_but_not_resting"])}
at 1e-3; the median amplitude is {fine["fates"]["dithers"]["encoder_steps"][0]:.1f} steps at 1e-5.
The size of the step decides how much of the stable part is felt:
{percent(fine["stable_but_perceptible"])}, {percent(middle["stable_but_perceptible"])} and
{percent(rough["stable_but_perceptible"])}. Coarse steps also keep some walls beyond the line from
growing: at 1e-3, {percent(1.0 - rough["unstable_and_growing"])} of the unstable part does not grow.

**Limits.** If the encoder is fine, the limit of the amplifier does not move the boundary. Beyond
the boundary, growth ends in a steady oscillation. A describing function predicts its frequency
within {percent(held["frequency_error"])} and its amplitude within
{percent(held["amplitude_error"])} (median of {held["points"]} points at 0.1 N m).

![Maps for three levels of friction]({single[1]})

**Friction.** With dry friction, {percent(slight["unstable_but_resting"])} (2 mN m) and
{percent(firm["unstable_but_resting"])} (10 mN m) of the unstable part come to rest from a start of
1 mrad. A wall that was stable in a gentle test may therefore be far beyond the linear boundary.

![K over start amplitude with friction]({single[2]})

**The outcome depends on the start.** Friction stops only small motions: the larger the oscillation,
the less a constant force damps it. At large start amplitudes the boundary is again the linear one.
The describing function (dashed) predicts this; near the top it is slightly too low.

**One-sided walls.** Friction stops a mass that hits a wall from outside if its speed is below a
limit, which depends on the time of the impact between two samples. The describing function of a
two-sided wall predicts a limit of 4 f_c / (pi (K tau - b)) for friction f_c, damping b and tau =
T/2. With b = K tau / 2 the true limit is 0 to 1 % higher at omega tau = 0.01 (omega = sqrt(K/m)), 2
to 4 % at 0.03 and 6 to 12 % at 0.08; with b = 0 half of that. The two-sided value is thus a lower
bound, and a measurement of a real wall scatters by this much (`tests/test_physics_wall_energy.py`).

## All together

Each row has one limit, each column one friction (0, 2 and 10 mN m). Maps were computed without a
limit and with limits of 0.5 and 0.1 N m. A row is left out if at most {100 * ALIKE:g}\u00a0% of its
points differ from the row above it.

**No steps.** The maps are those of friction above, for every limit: from a start of 1 mrad, a run
that friction stops never reaches the limit.

![Maps with steps of 1e-5 rad]({pictures[1e-5]})

**Steps of 1e-5 rad.** 2 mN m of friction stop every oscillation that the encoder causes. One step
changes the command by K times 1e-5 rad, at most 0.5 mN m here. Friction above half of this
change stops the oscillation.

![Maps with steps of 1e-4 rad]({pictures[1e-4]})

**Steps of 1e-4 rad.** One step now changes the command by up to 5 mN m. In the stable part 2 mN m
of friction are still enough. On the right of the maps, where B times a step per sample dominates
the command, the edge becomes ragged.

![Maps with steps of 1e-3 rad]({pictures[1e-3]})

**Steps of 1e-3 rad.** With 2 mN m of friction, {percent(both["stable_but_perceptible"])} of the
stable part is felt instead of {percent(loose["stable_but_perceptible"])}. With a limit of 0.1 N m
and B of at least 0.1 N m s/rad, one step within a sample already commands the whole limit, so the
picture does not depend on B there. Near the top and the right of the picture,
{percent(tight["stable_but_growing"])} of the stable part swings from limit to limit.

## Numbers

The table has the shares of the linearly stable part that do not come to rest, and that are felt or
grow, and the shares of the linearly unstable part that rest, and that grow. The rest of the
unstable part dithers.

{table(facts)}

## How the answers are found

A run is judged after 4 s and, if that is not enough, after up to 16 s. A run rests if its amplitude
stays below 1e-3 of the start and 0.02 of a step. It dithers if its amplitude neither falls nor
rises, and is no larger than steps alone can maintain: 32 steps, or more if a describing function
allows it (`sim/fate.py` has the derivation). It grows if its energy does, if its command swings
from limit to limit, or if it settles on a larger oscillation. For encoder steps of 1e-5, 1e-4 and
1e-3 rad, {AGAIN} points each were judged again over {LONG_S:g}\u00a0s: {judged_again(found)} keep
their outcome. Cells whose corners agree are filled in; at a step of 1e-4 rad
{percent(unlike_in_full(found))} of the points differ from a full lattice, near ragged edges.
"""


def main() -> None:
    """Write the pictures and the page over those that are in the tree."""
    with writing_as("make_linear_boundary_page", overwrite=True):
        paragraphs = text(maps()).split("\n\n")
        page = "\n\n".join(p if p[0] in "#|!" else textwrap.fill(p, 100) for p in paragraphs)
        print(f"wrote {write_text(DOCS / f'{PAGE}.md', page.rstrip() + chr(10))}")


if __name__ == "__main__":
    main()
