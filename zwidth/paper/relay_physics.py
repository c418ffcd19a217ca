"""The relay beside bisection under the same physics: friction, encoder step, limited amplifier.

The true boundary of a nonlinear device depends on how large its oscillation is, so bisection starts
with the amplitude of the relay's own cycle (m1 displaced by it, all at rest). As everywhere, a wall
is stable unless its oscillation grows; with an encoder step a second bracket says up to which K it
also comes to rest within a step. The steps are small relative to the relay's cycle: from a start of
a few steps growth could not be distinguished from dither.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from zwidth.figures.relay import Sweep, relay_sweeps_figure
from zwidth.identification.relay import RelayResult, RelayTest, relay_run
from zwidth.paper.content import Picture, Table, number
from zwidth.paper.theory import phantom
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.stability.bisection import Bracket, Search, find_brackets
from zwidth.stability.judging import Trial
from zwidth.stability.linear import critical_stiffness

DELAY, DAMPING = 0.008, 0.08
FRICTION = (0.0, 0.001, 0.002, 0.005, 0.01, 0.015, 0.02)
ENCODER = (1e-6, 3e-6, 1e-5, 3e-5, 1e-4)
LIMIT = (0.055, 0.06, 0.07, 0.08, 0.1, 0.12, 0.15)
SUBSTEPS = 4  # with friction
SEARCH = Search(tolerance=2e-3, lowest=0.5, highest=200.0)
LIMIT_S = 32.0
OWN = "zwidth paper --section relay"


@dataclass(frozen=True)
class Changed:
    """A device with one changed quantity: the relay's reading, and the true bracket.

    still: bracket of the walls that come to rest within an encoder step; None without one.
    """

    kind: str
    value: float
    relay: RelayResult
    bracket: Bracket
    still: Bracket | None = None

    @property
    def true(self) -> float:
        """Middle of the bracket, NaN where there is none."""
        return _middle(self.bracket)

    @property
    def rests(self) -> float:
        """Middle of the bracket of walls that come to rest, NaN where there is none."""
        return np.nan if self.still is None else _middle(self.still)


def physics_parts() -> tuple[Picture, str, Table]:
    """Return the figure, its interpretation, and its numbers."""
    device = phantom(DELAY)
    kinds: tuple[tuple[str, str, tuple[float, ...], Callable[[float], Device]], ...] = (
        ("Coulomb friction at m1", "N m", FRICTION, lambda v: _rubbing(device, v)),
        ("encoder step", "rad", ENCODER, lambda v: device.with_interface(encoder_step=v)),
        ("command limit", "N m", LIMIT, lambda v: device.with_interface(command_limit=v)),
    )
    found = {
        kind: [changed(kind, value, change(value)) for value in values]
        for kind, _, values, change in kinds
    }
    linear = critical_stiffness(device, DAMPING).stiffness or np.nan
    sweeps = [
        Sweep(
            f"{kind} [{unit}]",
            np.array([c.value for c in found[kind]]),
            np.array([np.nan if c.relay.stiffness is None else c.relay.stiffness
                      for c in found[kind]]),
            np.array([c.true for c in found[kind]]),
            np.array([c.rests for c in found[kind]]),
            kind == "encoder step",
        )
        for kind, unit, _, _ in kinds
    ]  # fmt: skip
    friction, encoder, limit = found.values()
    return (
        Picture(
            "relay_physics", relay_sweeps_figure(sweeps, linear),
            "What the relay reads at 8 ms and B = 0.08 (rings) and the boundary by bisection under"
            " the same physics, from a start as large as the relay's cycle (line), beside the"
            " linear boundary (dashed). Dotted: up to there walls come to rest within a step.", OWN,
        ),
        "The error of the relay against the boundary under the same physics depends on the physics."
        f" Friction raises both, and the relay is {_range(friction)} off, about as without"
        " friction, which brakes the wall's oscillation just as the relay's. (That is the boundary"
        " for this amplitude; from smaller starts stiffer walls hold.) An encoder step moves"
        f" neither, and the relay is {_range(encoder)} off, as without it. But walls above"
        f" {min(c.rests for c in encoder):.1f} oscillate on by more than one step, which a relay,"
        " whose cycle spans many, does not see."
        " A limit does not move the true boundary at all, but it cuts the"
        f" damper's share of the relay's command, and the relay is {_range(limit)} off.",
        Table(
            "Relay and bisection under the same physics at 8 ms and B = 0.08; off: the relay over"
            " the middle of the bracket. K at rest: up to there walls come to rest within a step.",
            ["what is changed", "value", "relay K", "relay f [Hz]", "amplitude [mrad]",
             "K stable", "K not", "how", "off", "K at rest"],
            [_row(c) for changes in found.values() for c in changes], OWN, (0, 7),
        ),
    )  # fmt: skip


def _rubbing(device: Device, level: float) -> Device:
    if level == 0.0:
        return device
    return device.with_physics(make_physics("coulomb_friction", "m1", level=level))


def changed(kind: str, value: float, device: Device) -> Changed:
    """Run the relay on a changed device, and bisection from its amplitude."""
    substeps = SUBSTEPS if device.physics else 1
    result = relay_run(device, DAMPING, test=replace(RelayTest(), substeps=substeps))
    trial = Trial(result.amplitude or Trial().start, limit_s=LIMIT_S, substeps=substeps)
    still = None
    if step := device.interface.encoder_step:
        still = _bracket(device, replace(trial, threshold=step))
    return Changed(kind, value, result, _bracket(device, trial), still)


def _bracket(device: Device, trial: Trial) -> Bracket:
    ((bracket,),) = find_brackets([device], [np.array([DAMPING])], trial, SEARCH)
    return bracket


def _middle(bracket: Bracket) -> float:
    low, high = bracket.stable, bracket.unstable
    return np.nan if low is None or high is None else 0.5 * (low + high)


def _off(one: Changed) -> float:
    """Relay over the true boundary, less 1, in per cent; NaN where one is missing."""
    reading = one.relay.stiffness
    return np.nan if reading is None else 100.0 * (reading / one.true - 1.0)


def _range(changes: list[Changed]) -> str:
    off = [_off(change) for change in changes]
    return f"{np.nanmin(off):+.0f} to {np.nanmax(off):+.0f} %"


def _row(one: Changed) -> list[str]:
    result, bracket = one.relay, one.bracket
    verdict = bracket.unstable_verdict
    return [
        one.kind, f"{one.value:g}",
        result.verdict if result.stiffness is None else number(result.stiffness),
        "" if result.frequency_hz is None else f"{result.frequency_hz:.2f}",
        "" if result.amplitude is None else f"{1e3 * result.amplitude:.2f}",
        number(bracket.stable), number(bracket.unstable),
        "" if verdict is None else verdict.name.lower().replace("_", " "),
        f"{_off(one):+.1f} %", "" if one.still is None else number(one.still.stable),
    ]  # fmt: skip
