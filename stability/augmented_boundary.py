"""The stability boundary of a device before and after a diagnosis added physics to it.

The nominal device is computed by linear theory and in the time domain, the augmented one in the
time domain only, since eigenvalues cannot describe friction, play and steps. With these the
boundary depends on the displacement at the start of a run, so the result contains it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.scenarios.scenario import usual_substeps
from zwidth.sim.device import Device
from zwidth.sim.readable import plain
from zwidth.stability.bisection import Bracket, Search, find_brackets
from zwidth.stability.judging import Trial
from zwidth.stability.linear import boundary, corner, last_stable_damping

Floats = NDArray[np.float64]
POINTS, FURTHEST = 8, 0.95  # number of dampings; the largest, over the last B with a stable K
DENSE = 61  # points of the linear curve
ROTARY_START, LINEAR_START = 1e-3, 1e-4  # [rad], [m]
SECONDS, LIMIT_S = 3.0, 6.0
SUBSTEPS = 4
TOLERANCE, RATIO = 0.02, 2.0
SAME = 0.03  # relative difference of K_CR that counts as unchanged: the brackets' widths


@dataclass(frozen=True)
class AugmentedBoundary:
    """K_CR over B of the nominal and of the augmented device.

    curve: (B, K) of the nominal device by linear theory, densely; nominal, augmented: time-domain
    brackets at the same dampings. start: the displacement that each run begins with.
    """

    curve: tuple[tuple[float, float], ...]
    nominal: tuple[Bracket, ...]
    augmented: tuple[Bracket, ...]
    start: float
    rotary: bool
    delay: float
    sentence: str

    def as_json(self) -> dict[str, object]:
        """Return start, sentence and, at each damping, [stable, unstable] K of both devices."""
        return {
            "start": self.start,
            "points": [
                {
                    "damping": one.damping,
                    "nominal": [one.stable, one.unstable],
                    "augmented": [other.stable, other.unstable],
                }
                for one, other in zip(self.nominal, self.augmented, strict=True)
            ],
            "sentence": self.sentence,
        }


def augmented_boundary(
    nominal: Device,
    augmented: Device,
    found: str = "the physics found",
    *,
    dampings: Sequence[float] | None = None,
    start: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> AugmentedBoundary | None:
    """Return the boundaries of a device as in its file and as a diagnosis augmented it.

    found: the added physics in words, for the sentence. dampings: by default eight, from zero to 95
    % of the last B at which the nominal device has a stable wall, and the B of its stiffest wall.
    start: displacement at the start of each run, by default 1e-3 rad or 1e-4 m. Returns None if
    dampings is None and the nominal device has no stable wall.
    """
    linear = nominal.bare().with_interface(encoder_step=0.0, command_step=0.0, command_limit=np.inf)
    last, tip = last_stable_damping(linear) or 0.0, corner(linear)
    if dampings is None and not last > 0.0:
        return None
    top = [] if tip is None else [tip.damping]
    usual = np.union1d(np.linspace(0.0, FURTHEST * last, POINTS), top)
    grid = usual if dampings is None else np.array(dampings, dtype=np.float64)
    begin = start or (ROTARY_START if nominal.rotary else LINEAR_START)
    period = nominal.interface.period
    window = max(0.25, 16.0 * period)  # a run has at least six windows
    seconds = max(SECONDS, 8.0 * window)
    substeps = max(usual_substeps(one, SUBSTEPS) for one in (nominal, augmented))
    trial = Trial(begin, seconds, max(LIMIT_S, seconds), window, substeps=substeps)
    search = Search(TOLERANCE, ratio=RATIO)
    one, other = find_brackets([nominal, augmented], [grid, grid], trial, search, progress)
    dense = np.union1d(np.linspace(0.0, max(last, float(grid.max())), DENSE), top)
    curve = tuple(
        (p.damping, p.stiffness) for p in boundary(linear, dense) if p.stiffness is not None
    )
    sentence = _sentence(found, one, other, begin, nominal.rotary)
    return AugmentedBoundary(
        curve, tuple(one), tuple(other), begin, nominal.rotary, nominal.interface.delay, sentence
    )


def _sentence(
    found: str, before: Sequence[Bracket], after: Sequence[Bracket], start: float, rotary: bool
) -> str:
    """A sentence on the change of K_CR at the first damping and of the stiffest wall."""
    unit, length = ("N m/rad", "rad") if rotary else ("N/m", "m")
    first = f"K_CR at B = {before[0].damping:g}"
    at_first = _change(first, critical(before[0]), critical(after[0]), unit)
    tops = [max((critical(b) or 0.0 for b in side), default=0.0) for side in (before, after)]
    top = _change("the stiffest wall tried", tops[0], tops[1], unit)
    return f"with {found}, {at_first}, and {top} (from a displacement of {start:g} {length})"


def critical(bracket: Bracket) -> float | None:
    """Return the middle of a bracket; None without a stable K, infinite without an unstable one."""
    if bracket.stable is None:
        return None
    return np.inf if bracket.unstable is None else 0.5 * (bracket.stable + bracket.unstable)


def _change(what: str, before: float | None, after: float | None, unit: str) -> str:
    if before and not after:
        return f"{what} ({plain(before, 3)} {unit} before) is gone: every K tried is unstable"
    if not before or not after:
        return (
            f"{what} is {plain(after, 3)} {unit} (no stable K before)"
            if after
            else f"{what} does not exist, as before: no K tried is stable"
        )
    if abs(after / before - 1.0) < SAME or before == after:
        return f"{what} stays at {plain(before, 3)} {unit}"
    verb = "rises" if after > before else "falls"
    return f"{what} {verb} from {plain(before, 3)} to {plain(after, 3)} {unit}"
