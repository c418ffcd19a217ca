"""Make `docs/haptics.md` and its pictures.

    python docs/make_haptics_page.py

Every number of the page is computed here. On one core of a busy machine it took three and a half
minutes, most of it for the maps and the paddle.
"""

import math
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import paddle_prediction
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import j1

from zwidth.controllers.guarded import guarded
from zwidth.controllers.none import none
from zwidth.controllers.region import region
from zwidth.controllers.wall import wall
from zwidth.figures.map import draw_fates, legend
from zwidth.figures.style import AFTER, BEFORE, COLOURS, DASHES, SHAPES, STYLE
from zwidth.figures.sweep import sweep_figure
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text, write_with
from zwidth.scenarios.table_2 import table_2
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.ensemble import walls
from zwidth.sim.fate import Fate
from zwidth.sim.interface import Interface
from zwidth.sim.law import Law
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate
from zwidth.stability.bisection import find_brackets
from zwidth.stability.fate_map import FateMap, make_map
from zwidth.stability.hand import draw_hands, hand_quantiles, with_hand
from zwidth.stability.judging import Trial, judge
from zwidth.stability.linear import boundary, corner, critical_stiffness, last_stable_damping
from zwidth.stability.plane import Axis, Plane
from zwidth.stability.sweep import Sweep, sweep

Floats = NDArray[np.float64]
DOCS = Path(__file__).parent
PICTURES = "haptics"
T = 1e-3
COARSE, REFINEMENTS = 25, 2
BEST = "second"  # filter
LEVER = 0.05  # m, from the axis to the finger
HANDS = 200
JUMP = 100.0  # Hz, above which the second mode oscillates
SHARE = 0.1  # of the last stable damping, that a passivity controller may add


TEXT = """# Haptics: everything between controller and hand

How stiff a wall a device can render depends on the device, the filter of its velocity, the rates of
its loops, the law of the wall, a force sensor, and the hand. `boundary`, `map`, `sweep` and
`simulate` can simulate all of these.

`python docs/make_haptics_page.py` computes every picture and number below. The device is the
PHANToM of the paper, with 2 ms of delay unless another value is given. Lines are theory, dots are
simulations.

## Velocity filters

    zwidth sweep phantom_1_0 --over cutoff --order 2

![Area of stable walls over the cut-off of the velocity filter, and boundaries](haptics/filter.png)

A wall's damper needs a velocity. The difference of two readings is rough; a low-pass makes it
smooth but late. The Z-width, the area of stable walls in the plane of B and K, is largest in
between. Chawda, Celik and O'Malley found this by simulation and confirmed it on a device (J.
Dynamic Systems, Measurement, and Control 137, 024503, 2015):

[[filters]]

The filter helps here because it weakens the delayed damper, which excites a mode at 170 Hz. Encoder
steps cost hardly any area if runs start at 200 steps. The command writes the device with the best
filter as `best.toml`. `--over` also accepts period, delay, encoder step and the rates of the loops.
The keys of a device file are `velocity_cutoff_hz` and `velocity_order`.

## Velocity estimators

    zwidth boundary gaming_wheel --estimator foaw:window=8

`--estimator`, or `velocity_estimator` in a device file, replaces the difference: `foaw` or
`foaw_end` (adaptive windows: Janabi-Sharifi, Hayward and Chen, IEEE T. Control Systems Technology
8, 1003, 2000), `levant` (a sliding mode: Automatica 34, 379, 1998), `kalman` or
`kalman_acceleration` (steady Kalman filters). Linear theory includes the Kalman filters; walls with
the others can only be simulated. `velocity_step` is the resolution of a register for the velocity,
as in `serial_bus_servo`.

## Two loops, two rates

    [interface]
    period_s = 0.0001       # the device's own loop: 10 kHz
    position_ticks = 10     # the law is given a new position at 1 kHz
    velocity_ticks = 1      # and a new velocity at 10 kHz

![Boundaries at one rate and at two, and stiffness over delay](haptics/rates.png)

A simulated world is often slower than the loop on the device. The law gets a new position every
`position_ticks` periods and a new velocity every `velocity_ticks` (the difference over as many
periods). K_CR and K_max are in N m/rad, B in N m s/rad:

[[rates]]

(No real amplifier can render some of these walls; they are limits of sampling alone.) Without
delay, a slow position with a fast velocity still allows stiff walls; a slow velocity does not,
however fast the position. With a delay the rate hardly matters: K_CR = b / (T/2 + t_d) for a rigid
device, and from t_d = 2 ms on the T/2 is small (J. J. Gil, E. Sanchez, T. Hulin, C. Preusche, G.
Hirzinger, J. Computing and Information Science in Engineering 9, 011005, 2009).

Why a slower velocity? With an encoder step q and a velocity period T_v, the command of a damper
chatters by B q / T_v, even in a smooth motion. With q = 1e-4 rad and B = 0.02 N m s/rad:

[[chatter]]

The largest B with the same chatter therefore grows with T_v: tenfold from 20 to 2 kHz. Koul,
Manivannan and Saha measured this gain (J. Intelligent & Robotic Systems 91, 2018): with position
and velocity at 20 kHz, walls end at about 0.1 N m s/rad; with the velocity at 2 kHz, at 1 N m
s/rad.

## A passivity observer and controller

    zwidth boundary phantom_1_0 --delay-ms 0 --law guarded
    zwidth map phantom_1_0 --delay-ms 0 --law guarded

![A wall of three times the critical stiffness; the gain over the delay](haptics/guarded.png)

An unstable wall returns more energy than it received. The observer of Hannaford and Ryu (IEEE T.
Robotics and Automation 18, 1, 2002) counts this energy, and the controller adds damping at the tick
that would return too much. Without delay the count is exact and the gain in stiffness large. The
gain falls with every millisecond, since the force that acts is not the force that was counted. K is
in N m/rad at B = 0; the controller may add a tenth of the damping that is stable by itself:

[[guard]]

If this damping is not enough for a tick, the wall still returns a little energy (middle). More
damping does not help, because the added damping counts towards the largest stable damping of a
sampled loop: the map at the end of this page shows walls lost at large B. A passive wall is not
changed. In a scenario, use `kind = "guarded"`.

## Textures and regions of damping

    zwidth boundary phantom_1_0 --law texture --wavelength 0.01

![Amplitudes in a grating; boundaries with the worst hands](haptics/textures.png)

A texture is a force that varies with position as a sine, alone or on a spring; K is its steepest
slope. A small motion in a trough is like one on a spring K, and is stable up to the same K_CR
(within 0.1 %). Above K_CR the oscillation grows until the mean slope over its swing equals K_CR
again; a describing function predicts its amplitude (left). Buzzing in a texture is such an
oscillation.

A region of damping has K = 0; its largest B depends on the hand. A device of damping b is passive
with a wall if b > K T/2 + B (J. E. Colgate, G. Schenkel, J. Robotic Systems 14, 37, 1997). No hand
makes a wall below that line unstable. The worst hand reaches the line: a rod that a wave crosses in
T/2, whose resonances all lie at half the sampling rate (right).

[[textures]]

In Python: `zwidth.texture`, `zwidth.region`; in a scenario `kind = "texture"` and `"region"`
([scenarios](scenarios.md)).

## A hand, and its spread

    zwidth boundary phantom_1_0 --hands 200 --lever 0.05

![Boundaries over hands](haptics/hands.png)

Fingers differ: mass, damping and stiffness are drawn independently, log-uniformly, from ranges
ascribed to A. Z. Hajian and R. D. Howe (J. Biomechanical Engineering 119, 109, 1997), not yet
verified there. A rigid device has K_CR = 2 (b + b_h)/T, whatever the hand's mass and spring; b_h is
the hand's damping.

[[hands]]

## A force sensor in the loop

    [interface]
    force_sensor = "link12"    # the force of this link is measured
    force_gain = 1.0           # u = w + G (w - F)

![Mass that the hand moves, and remaining stiffness, over the gain](haptics/force.png)

Feedback of the measured force divides the mass and the friction that a hand feels by 1 + G. With a
delay it reduces the stiffness. G must stay below 1 + M/m_h, with the masses M before and m_h behind
the sensor: above this, the force that a command causes amplifies the command. With t = T/2 + t_d
for the position and, since a sample shows a force half a period later, t_F = T + t_d:

    b = (1 + G) K_CR (t - G m_h t_F / (M + (1 + G) m_h)).

[[force]]

## Maps

![Maps of the laws](haptics/maps.png)

The colours are outcomes of runs, as in [what the linear boundary does not
say](what_the_linear_boundary_does_not_say.md). The black line is linear theory, with filter, rates
and force sensor, but without grating and passivity controller.

[[maps]]

## Compared with a published measurement

Gil, Puerto, Diaz and Sanchez measured the boundary of this PHANToM by the relay method, with 2, 4
and 8 ms of delay (IROS 2010, Table II). The device here is their Table I, identified from another
recording; nothing in it is fitted to the walls below. Only rows with B > 0 are shown, up to the
sudden rise of frequency. K is in N m/rad and B in N m s/rad, as printed; two values are misprints,
and are read as the other rows imply ([the paper](paper.md), `fig_10`). "Refitted" has two numbers,
inertia and damping, fitted to the same rows ([table_2.md](../benchmarks/notes/table_2.md)).

[[measured]]

## Another paddle, predicted before its walls are seen

    python docs/paddle_prediction.py

![Walls of four estimators with intervals](haptics/paddle_walls.png)

![Shapes of the boundaries, and ratios to the difference](haptics/paddle_shapes.png)

We know this about another teaching paddle: its firmware (350 us, 4096 counts per turn of the motor,
ratio 15, four estimators with a low-pass of 50 Hz behind each), motor, friction (1.2 to 1.7 mN m),
and two gains at which its position loop oscillates: 60 N m/rad with a period of 23 ms on the
encoder, 12 with 45 ms on a Hall sensor. We did not know its measured walls when this was computed.

The rest is drawn at random:

| quantity | drawn from |
|---|---|
| inertia | 7.0e-4 kg m2 with 10 % (one sigma); the two gains give 8.1e-4 and 5.9e-4 |
| damper | what the first gain (known to 20 %) requires in addition to friction |
| delay | 0.3 to 2 periods |
| start (a tap) | 2 to 30 mrad |
| radius (handle to axis) | 70 to 120 mm |
| FOAW | 8 to 24 readings, a band of 1 or 2 counts |
| Levant | a bound of 0.3 to 2.5 times the motor's largest acceleration |
| Kalman | constant velocity or acceleration; one sigma: 1/30 to 1 of that acceleration |

The low-pass is of first order. Hand and elasticity are left out. Intervals contain 90 % of the
draws; B is tried up to 0.024 N s/mm:

[[paddle]]

Difference and Kalman filter cannot be distinguished; FOAW gives the softest walls.
[paddle_prediction.json](haptics/paddle_prediction.json) has every wall, also in N/mm, and every
rig.

## Limits

- The linear theory of several rates scans K in steps of 5 %, and misses narrower bands of
  instability. The closed form (`decomposition`), the passive walls and the names of branches accept
  only one rate and no force feedback, and a message reports this.
- The passivity observer counts the energy of the commanded force. A delay, an amplifier's limit or
  a slower position make the acting force differ from it.
- The force sensor has no noise and measures the link's own spring and damper.
- Only delay and damper are compared with a published measurement. The tests compare filters, two
  rates, passivity controller, texture and hands with closed forms.
"""


def phantom(**interface: Any) -> Device:
    """Return the PHANToM of the paper with another interface."""
    return load_device("phantom_1_0").with_interface(**interface)


def middles(device: Device, dampings: Floats, trial: Trial = Trial()) -> Floats:
    """Return K_CR in the time domain at each damping, NaN where none is stable."""
    found = find_brackets([device], [dampings], trial)[0]
    return np.array([math.nan if b.stable is None else b.stable for b in found])


def theory(device: Device, dampings: Floats) -> Floats:
    """Return K_CR by linear theory at each damping, NaN where none is stable."""
    points = boundary(device, dampings.tolist())
    return np.array([math.nan if p.stiffness is None else p.stiffness for p in points])


def save(figure: Figure, name: str) -> None:
    """Write a picture."""
    with rc_context(STYLE):
        saving = partial(figure.savefig, format="png", dpi=110)
        write_with(DOCS / PICTURES / f"{name}.png", saving)
    print(name, file=sys.stderr)


def panels(count: int, width: float = 10.0, height: float = 4.2) -> tuple[Figure, list[Axes]]:
    """Return a figure with panels side by side."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, list(np.atleast_1d(figure.subplots(1, count)))


# Velocity filters


def filters() -> dict[str, Sweep]:
    """Return the Z-width over the cut-off of both filters, and of one with an encoder."""
    devices = {
        "first": phantom(velocity_order=1),
        BEST: phantom(velocity_order=2),
        "second, encoder of 1e-4 rad": phantom(velocity_order=2, encoder_step=1e-4),
    }
    far = Trial(start=0.02)  # 200 of these steps: what grows is seen to
    found = {name: sweep(device, "cutoff", trial=far) for name, device in devices.items()}
    save(sweep_figure(found[BEST]), "filter")
    return found


def said_of_filters(found: dict[str, Sweep]) -> str:
    """Return the page's text on velocity filters."""
    rows: list[str] = []
    for name, result in found.items():
        own = result.without
        assert own is not None
        rows.append(
            f"| {name} | {result.best.value:.3g} Hz | {result.best_by_theory.value:.3g} Hz |"
            f" {result.best.area / own.area:.2f} | {result.best.stiffest:.1f} |"
        )
    bare, very = found[BEST].without, corner(phantom())
    assert bare is not None
    assert very is not None
    top = f"{very.stiffness:.1f}"
    head = "| order of the filter | best cut-off, simulated | by theory |"
    head += " Z-width relative to no filter | K_max |\n"
    return (
        head + "|---|---|---|---|---|\n" + "\n".join(rows)
        + "\n\n"
        + _said(
            "K_max is in N m/rad, at the dampings that were tried. Without a filter it is"
            f" {bare.stiffest:.1f} ({top} at the exact maximum)."
        )
    )  # fmt: skip


# Several rates


class Rates(NamedTuple):
    """An interface of one or two rates, named."""

    name: str
    device: Device


def rates() -> list[Rates]:
    """Return the interfaces to compare: without delay, with one rate and with two."""
    fast = {"delay": 0.0, "period": 1e-4}
    return [
        Rates("1 kHz", phantom(delay=0.0)),
        Rates("10 kHz, position at 1 kHz", phantom(**fast, position_ticks=10)),
        Rates("10 kHz, velocity at 1 kHz", phantom(**fast, velocity_ticks=10)),
        Rates("10 kHz", phantom(**fast)),
    ]


def draw_rates() -> str:
    """Draw their boundaries and return the table of the page."""
    rows: list[str] = []
    with rc_context(STYLE):
        figure, (left, right) = panels(2)
        for i, (name, device) in enumerate(rates()):
            last, top = last_stable_damping(device), corner(device)
            assert last is not None
            assert top is not None
            grid = np.linspace(0.0, 0.999 * last, 60)
            some = grid[::6]
            line, dots = theory(device, grid), middles(device, some)
            left.plot(grid, line, color=COLOURS[i], linestyle=DASHES[i])
            left.plot(some, dots, color=COLOURS[i], linestyle="none", marker=SHAPES[i],
                      markersize=4, label=name)  # fmt: skip
            late = device.with_interface(delay=2e-3)
            late_top = corner(late)
            assert late_top is not None
            rows.append(
                f"| {name} | {line[0]:.4g} | {top.stiffness:.4g} | {last:.3g} |"
                f" {late_top.stiffness:.4g} |"
            )
        left.set_yscale("log")
        left.set_xlabel("virtual damping $B$ [N m s/rad]")
        left.set_ylabel("critical stiffness [N m/rad]")
        left.set_title("two loops of a PHANToM without delay")
        left.legend(loc="lower right")
        delays = np.array([0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0]) * 1e-3
        rigid = Device("rigid", "-", True, make_chain([1e-2], [5e-3], 0.0), Interface())
        for i, period in enumerate((1e-3, 2e-4, 1e-4)):
            found = [
                middles(rigid.with_interface(delay=d, period=period), np.zeros(1))[0]
                for d in delays.tolist()
            ]
            dense = np.linspace(0.0, 4e-3, 200)
            right.plot(1e3 * dense, 5e-3 / (0.5 * period + dense), color=COLOURS[i],
                       linestyle=DASHES[i])  # fmt: skip
            right.plot(1e3 * delays, found, color=COLOURS[i], marker=SHAPES[i], markersize=4,
                       linestyle="none", label=f"{1e-3 / period:g} kHz")  # fmt: skip
        right.set_yscale("log")
        right.set_xlabel("delay $t_d$ [ms]")
        right.set_ylabel("critical stiffness [N m/rad]")
        right.set_title("a rigid device, $B$ = 0: $b / (T/2 + t_d)$")
        right.legend()
    save(figure, "rates")
    head = "| rates | K_CR at B = 0 | K_max | largest B | K_max with 2 ms of delay |\n"
    return head + "|---|---|---|---|---|\n" + "\n".join(rows)


def chatter() -> str:
    """Return how far a damper's command swings in an even motion, at two rates of the velocity."""
    step, speed, damping = 1e-4, 0.0313, 0.02
    rows: list[str] = []
    for ticks in (1, 10):
        face = Interface(period=5e-5, encoder_step=step, velocity_ticks=ticks)
        device = Device("even", "-", True, make_chain([1e3], [0.0], 0.0), face)
        run = simulate(device, region(damping), duration=0.5, start=Start(0.0, speed))
        u = run.trace["command"][100:]
        rows.append(
            f"| {20 / ticks:g} kHz | {1e3 * (u.max() - u.min()):.3g} |"
            f" {1e3 * damping * step / (5e-5 * ticks):.3g} |"
        )
    head = "| velocity at | swing of the command [mN m] | B q / T_v [mN m] |\n|---|---|---|\n"
    return head + "\n".join(rows)


# Passivity controller

GUARD: dict[str, dict[str, Any]] = {
    "plain": {"color": BEFORE, "linestyle": DASHES[1]},
    "guarded": {"color": AFTER, "linestyle": DASHES[0]},
}


def draw_guard() -> str:
    """Draw a wall with and without it, and its gain over the delay; return the table."""
    device = phantom(delay=0.0)
    point, last = critical_stiffness(device, 0.0), last_stable_damping(device)
    assert point.stiffness is not None
    assert last is not None
    rows: list[str] = []
    with rc_context(STYLE):
        figure, (left, middle, right) = panels(3, 12.5)
        for name, law in (
            ("plain", wall(3.0 * point.stiffness, 0.0)),
            ("guarded", guarded(3.0 * point.stiffness, 0.0, SHARE * last)),
        ):
            run = simulate(device, law, duration=0.3, start=Start(1e-3), ledger=True)
            left.plot(run.trace.t, 1e3 * run.trace["position_m1"], label=name, **GUARD[name])
            middle.plot(run.trace.t, -1e6 * run.trace["work_wall"] + _held(point.stiffness),
                        label=name, **GUARD[name])  # fmt: skip
        left.set_ylim(-2.0, 2.0)
        left.set_xlabel("time [s]")
        left.set_ylabel("position [mrad]")
        left.set_title(f"three times $K_\\mathrm{{CR}}$ ({point.stiffness:.3g} N m/rad)")
        middle.set_ylim(-60.0, 40.0)
        middle.axhline(0.0, color="0.5", linewidth=0.8)
        middle.set_xlabel("time [s]")
        middle.set_ylabel("energy that the wall holds [µJ]")
        middle.set_title("energy balance of the wall")
        left.legend()
        delays = np.array([0.0, 0.25, 0.5, 1.0, 2.0, 4.0]) * 1e-3
        gains: list[tuple[float, float]] = []
        for delay in delays.tolist():
            own = device.with_interface(delay=delay)
            most = SHARE * (last_stable_damping(own) or 0.0)
            trials = Trial(), Trial(law=Law("guarded", most_damping=most))
            plain, held = (float(middles(own, np.zeros(1), t)[0]) for t in trials)
            gains.append((plain, held))
            rows.append(f"| {1e3 * delay:g} ms | {plain:.4g} | {held:.4g} | {held / plain:.3g} |")
        for i, (name, look) in enumerate(GUARD.items()):
            right.plot(1e3 * delays, [g[i] for g in gains], marker=SHAPES[i], label=name, **look)
        right.set_yscale("log")
        right.set_xlabel("delay [ms]")
        right.set_ylabel("stiffest stable wall, $B$ = 0 [N m/rad]")
        right.set_title("stiffest wall over the delay")
        right.legend()
    save(figure, "guarded")
    head = "| delay | K, plain | K, guarded | gain |\n|---|---|---|---|\n"
    return head + "\n".join(rows)


def _held(stiffness: float) -> float:
    """Energy [µJ] of the wall of the picture at its start."""
    return 1e6 * 0.5 * 3.0 * stiffness * 1e-6


# Textures and damping


def ladder(modes: int, damping: float, mass: float = 1e-4) -> Device:
    """Return a mass on a damper with the worst lossless hand of so many modes at it.

    The hand is a line of masses and springs with the resonances of a rod that is clamped at its far
    end and that a wave crosses in T/2: all of them stand at half the rate when sampled.
    """
    zeros, poles = (np.arange(modes) + 0.5) ** 2, np.arange(1, modes) ** 2.0
    top, bottom = np.atleast_1d(np.poly(-zeros)), np.atleast_1d(np.poly(-poles))
    masses: list[float] = []
    springs: list[float] = []
    while len(masses) < modes:  # Cauer's continued fraction of its impedance
        masses.append(top[0] / bottom[0])
        top = (top - masses[-1] * np.append(bottom, 0.0))[1:]
        springs.append(top[0] / bottom[0])
        bottom = (bottom - top / springs[-1])[1:]
    k = mass * (2.0 * math.pi / T) ** 2 * np.array(springs)
    chain = make_chain((mass * np.array(masses)).tolist(), [damping] + [0.0] * (modes - 1), 0.0,
                       k[:-1].tolist(), [0.0] * (modes - 1))  # fmt: skip
    device = Device("ladder", "-", True, chain, Interface(delay=0.0))
    return device.with_physics(make_physics("ground_spring", f"m{modes}", stiffness=float(k[-1])))


def draw_textures() -> str:
    """Draw cycles in a grating, and how worst hands come down to the passive walls."""
    device, wavelength, damping, b = phantom(), 1e-2, 0.02, 5e-3
    limit = critical_stiffness(device, damping).stiffness
    assert limit is not None
    factors = np.array([1.02, 1.05, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0])
    growth = judge(device, walls(factors * limit, damping, law=Law("texture", wavelength)),
                   Trial(start=1e-4))  # fmt: skip
    dense = np.linspace(1.001, 2.05, 80)
    number = 2.0 * math.pi / wavelength

    def predicted(f: float) -> float:
        return float(brentq(lambda x: 2.0 * j1(x) / x - 1.0 / f, 1e-4, 3.8)) / number

    line = np.array([predicted(f) for f in dense.tolist()])
    truth = np.array([predicted(f) for f in factors.tolist()])
    with rc_context(STYLE):
        figure, (left, right) = panels(2)
        left.plot(dense, 1e3 * line, color=COLOURS[0], label="$K\\,2 J_1(kA)/(kA) = K_{CR}$")
        left.plot(factors, 1e3 * growth.amplitude, color=COLOURS[1], marker="o", linestyle="none",
                  label="simulated")  # fmt: skip
        left.set_xlabel("steepest slope of the grating over $K_\\mathrm{CR}$")
        left.set_ylabel("amplitude of the oscillation [mrad]")
        left.set_title("amplitude in a grating of 10 mrad")
        left.legend()
        grid = np.linspace(0.0, b, 40)
        right.fill_between(grid, 2.0 * (b - grid) / T, color="0.9", label="passive, $b > KT/2 + B$")
        for i, modes in enumerate((1, 2, 4)):
            own = ladder(modes, b)
            last = last_stable_damping(own) or 0.0
            dampings = np.linspace(0.0, 0.999 * last, 40)
            some = dampings[:-1:6]
            right.plot(dampings, theory(own, dampings), color=COLOURS[i], linestyle=DASHES[i])
            name = f"worst hand of {modes} mode" + ("s" if modes > 1 else "")
            right.plot(some, middles(own, some), color=COLOURS[i], marker=SHAPES[i], markersize=4,
                       linestyle="none", label=name)  # fmt: skip
        right.set_xlabel("virtual damping $B$ [N m s/rad]")
        right.set_ylabel("critical stiffness [N m/rad]")
        right.set_title(f"a device of b = {b:g} N m s/rad, T = 1 ms")
        right.set_ylim(bottom=0.0)
        right.legend()
    save(figure, "textures")
    worst = float(np.abs(growth.amplitude / truth - 1.0).max())
    last = last_stable_damping(ladder(4, b)) or 0.0
    alone = last_stable_damping(
        Device("alone", "-", True, make_chain([1e-3], [b], 0.0), Interface(delay=0.0))
    )
    return _said(
        f"The simulated amplitudes differ from the describing function by at most"
        f" {100.0 * worst:.1f} %. With a worst hand of four modes, the largest damping that is"
        f" stable at K = 0 is {last / b:.3f} b. Without a hand, a device of 1e-3 kg m2 is stable up"
        f" to {alone or 0.0:.2f} N m s/rad, which is {(alone or 0.0) / b:.0f} b."
    )


# Hands


def draw_hands_of() -> str:
    """Draw the spread of boundaries over hands."""
    device = phantom()
    last = last_stable_damping(device) or 0.0
    grid = np.linspace(0.0, 0.999 * last, 40)
    spread = hand_quantiles(device, grid.tolist(), LEVER, HANDS)
    low, median, high = (np.array(values) for values in zip(*spread, strict=True))
    some = grid[4:32:9]
    hands = draw_hands(8, 1)
    devices = [with_hand(device, hand, LEVER) for hand in hands]
    dots = find_brackets(devices, [some] * len(devices))
    with rc_context(STYLE):
        figure, (axes,) = panels(1, 6.4, 4.2)
        axes.fill_between(grid, low, high, color=COLOURS[0], alpha=0.25, linewidth=0.0,
                          label="5 to 95 % of hands")  # fmt: skip
        known = np.where(median > 0.0, median, math.nan)
        axes.plot(grid, known, color=COLOURS[0], label="median of hands")
        axes.plot(grid, theory(device, grid), color=COLOURS[1], linestyle=DASHES[1],
                  label="free device")  # fmt: skip
        for i, own in enumerate(dots):
            axes.plot(some, [b.stable or math.nan for b in own], color="k", marker=".",
                      markersize=5, linestyle="none",
                      label="eight hands, simulated" if i == 0 else None)  # fmt: skip
        axes.set_xlabel("virtual damping $B$ [N m s/rad]")
        axes.set_ylabel("critical stiffness [N m/rad]")
        axes.set_ylim(bottom=0.0)
        axes.set_title("a PHANToM with 2 ms of delay, held by a finger")
        axes.legend()
    save(figure, "hands")
    return _said(
        f"At B = 0 a free device is stable up to {theory(device, np.zeros(1))[0]:.3g} N m/rad."
        f" With {HANDS} fingers at a lever of {1e3 * LEVER:g} mm, 95 % of the devices are stable up"
        f" to {low[0]:.3g} N m/rad, half of them up to {median[0]:.3g}, and 5 % up to"
        f" {high[0]:.3g}."
    )


# Force sensor


def held(gain: float, hand: float = 0.05, delay: float = 0.0) -> Device:
    """Return a device of 0.2 kg and 2 N s/m that holds a hand's mass on a stiff sensor."""
    together = 0.2 * hand / (0.2 + hand)
    spring = together * (2.0 * math.pi * 2500.0) ** 2
    chain = make_chain([0.2, hand], [2.0, 0.0], 0.0, [spring],
                       [1.4 * math.sqrt(spring * together)])  # fmt: skip
    face = Interface(delay=delay, force_sensor="link12", force_gain=gain)
    return Device("held", "-", False, chain, face)


def draw_force() -> str:
    """Draw what a hand feels and what stiffness is left, over the gain of the force feedback."""
    gains = np.linspace(0.0, 3.0, 13)
    force = np.zeros((500, 2))
    force[:, 1] = 0.1
    felt: list[float] = []
    for gain in gains.tolist():
        run = simulate(held(gain), none(), duration=0.5, disturbance=force)
        v, t = run.trace["velocity_m2"], run.trace.t
        b = 2.0 / (1.0 + gain)
        early = (t > 0.02) & (t < 0.1)
        # F = m a + b v: the mass that explains the impulse after the damper's share.
        impulse = 0.1 * t - b * (run.trace["position_m2"] - run.trace["position_m2"][0])
        felt.append(float(np.mean(impulse[early] / v[early])))
    with rc_context(STYLE):
        figure, (left, right) = panels(2)
        dense = np.linspace(0.0, 3.0, 100)
        left.plot(dense, 1e3 * (0.2 / (1.0 + dense) + 0.05), color=COLOURS[0],
                  label="$M / (1 + G) + m_h$")  # fmt: skip
        left.plot(gains, 1e3 * np.array(felt), color=COLOURS[1], marker="o", linestyle="none",
                  label="simulated")  # fmt: skip
        left.set_xlabel("gain G of the force feedback")
        left.set_ylabel("mass that the hand moves [g]")
        left.set_ylim(bottom=0.0)
        left.legend()
        left.set_title("0.2 kg device, 50 g hand")
        worst = 0.0
        for i, delay in enumerate((0.0, 2e-3)):
            t, late = 0.5 * T + delay, T + delay
            inertia = 0.2 + (1.0 + dense) * 0.05
            line = 2.0 / ((1.0 + dense) * (t - dense * 0.05 * late / inertia))
            dots = np.array([middles(held(g, delay=delay), np.zeros(1))[0] for g in gains.tolist()])
            right.plot(dense, line, color=COLOURS[i], linestyle=DASHES[i])
            right.plot(gains, dots, color=COLOURS[i], marker=SHAPES[i], markersize=4,
                       linestyle="none", label=f"delay {1e3 * delay:g} ms")  # fmt: skip
            at = np.interp(gains, dense, line)
            worst = max(worst, float(np.nanmax(np.abs(dots / at - 1.0))))
        right.set_yscale("log")
        right.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        right.yaxis.set_major_formatter("{x:g}")
        right.yaxis.set_minor_locator(NullLocator())
        right.set_xlabel("gain G of the force feedback")
        right.set_ylabel("critical stiffness, $B$ = 0 [N/m]")
        right.set_title("lines: the closed form")
        right.legend()
    save(figure, "force")
    return _said(f"The simulated boundary is within {100.0 * worst:.1f} % of the closed form.")


# Maps


def maps() -> list[tuple[str, FateMap]]:
    """Return a map of each, over B and K or over what it is about."""
    trial = Trial(limit_s=16.0)
    quick = phantom(delay=0.0)
    most = SHARE * (last_stable_damping(quick) or 0.0)
    b, k = Axis("B", 0.0, 0.12), Axis("K", 0.5, 60.0)
    wide = Axis("B", 0.0, 0.4), Axis("K", 1.0, 250.0)
    planes = {
        "spring and damper": Plane(phantom(), b, k, trial=trial),
        "velocity filter of 89 Hz, second order": Plane(
            phantom(velocity_order=2, velocity_cutoff_hz=89.0), Axis("B", 0.0, 0.8), k, trial=trial
        ),
        "over the cut-off, B = 0.06 N m s/rad": Plane(
            phantom(velocity_order=2), Axis("cutoff", 10.0, 400.0, "log"), k, damping=0.06,
            trial=trial,
        ),
        "grating of 10 mrad (K: steepest slope)": Plane(
            phantom(), b, k, trial=replace(trial, law=Law("texture", 1e-2))
        ),
        "no delay": Plane(quick, *wide, trial=trial),
        "no delay, passivity controller": Plane(
            quick, *wide, trial=replace(trial, law=Law("guarded", most_damping=most))
        ),
    }  # fmt: skip
    found: list[tuple[str, FateMap]] = []
    for name, plane in planes.items():
        found.append((name, make_map(plane, COARSE, REFINEMENTS)))
        print(name, found[-1][1].runs, "runs", file=sys.stderr)
    return found


def draw_maps(found: Sequence[tuple[str, FateMap]]) -> str:
    """Draw them and say how much of each rests."""
    with rc_context(STYLE):
        figure = Figure(figsize=(12.0, 7.2), layout="constrained")
        for axes, (name, result) in zip(figure.subplots(2, 3).ravel(), found, strict=True):
            draw_fates(axes, result)
            axes.set_title(name)
        handles = legend([result for _, result in found])
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
    save(figure, "maps")
    share = {name: float(np.mean(m.fates.fate == Fate.RESTS)) for name, m in found}
    before, after = share["no delay"], share["no delay, passivity controller"]
    return _said(
        f"With the passivity controller {100.0 * after:.0f} % of the plane comes to rest, without"
        f" it {100.0 * before:.0f} %. The controller stabilises walls at small B, where the plain"
        " wall has no damping to spare, but destabilises walls at large B. In a grating, a wall"
        " whose K is too large oscillates in the trough; a wall whose B is too large grows without"
        " bound, as without a grating."
    )


def measured() -> str:
    """Compare what the relay method found on the device with simulations of Table I."""
    rows = [r for r in table_2() if r.place > 0.0 and r.frequency < JUMP]
    lines = ["| delay | B | K, measured | K, simulated | off | refitted | off |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    off: dict[str, list[float]] = {"phantom_1_0": [], "phantom_1_0_table2": []}
    for row in sorted(rows, key=lambda r: (r.delay, r.place)):
        printed = "" if row.damping_meant is None else f", read as {row.place:g}"
        cells = [f"{1e3 * row.delay:g} ms", f"{row.damping:g}{printed}", f"{row.stiffness:g}"]
        for name, errors in off.items():
            device = load_device(name).with_interface(delay=row.delay)
            (found,) = middles(device, np.array([row.place]))
            errors.append(found / row.stiffness - 1.0)
            cells += ["none", "-"] if math.isnan(found) else [
                f"{found:.4g}", f"{100.0 * errors[-1]:+.0f} %"
            ]  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    said = [_within(errors) for errors in off.values()]
    text = (
        f"Of {len(rows)} rows, the simulation of Table I is within 10 % of the measurement in"
        f" {said[0]}, the refitted model in {said[1]}. If Table I has no stable wall, or a much"
        " lower one, the delayed damper already excites the second mode. On the device this began"
        " one to three rows later: a boundary is steepest at its corner. Without a damper (B = 0)"
        " Table I gives 2.50, 1.35 and 0.70 at 2, 4 and 8 ms, but 7.21, 1.97 and 1.01 were"
        " measured: there the device's own friction decides, which Table I describes only as a"
        " damper."
    )
    return "\n".join(lines) + "\n\n" + _said(text)


def _within(errors: Sequence[float]) -> str:
    """How many are within 10 %, and the median of all that are a number."""
    known = np.abs([e for e in errors if not math.isnan(e)])
    return f"{int(np.sum(known <= 0.1))} (median {100.0 * float(np.median(known)):.1f} %)"


def _said(text: str) -> str:
    return "\n".join(textwrap.wrap(text, 99, break_long_words=False, break_on_hyphens=False))


def page() -> str:
    """Return the page, drawing its pictures on the way."""
    text = TEXT
    parts = {
        "filters": said_of_filters(filters()),
        "rates": draw_rates(),
        "chatter": chatter(),
        "guard": draw_guard(),
        "textures": draw_textures(),
        "hands": draw_hands_of(),
        "force": draw_force(),
        "maps": draw_maps(maps()),
        "measured": measured(),
        "paddle": paddle_prediction.made(),
    }
    for name, part in parts.items():
        assert f"[[{name}]]" in text, name
        text = text.replace(f"[[{name}]]", part)
    return text


if __name__ == "__main__":
    with writing_as("python docs/make_haptics_page.py", True):
        (DOCS / PICTURES).mkdir(exist_ok=True)
        write_text(DOCS / "haptics.md", page())
