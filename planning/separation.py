"""The distance of an effect from its nearest imitation by another effect and a refit.

The distance, in sigma, from the effect's signature s to all signatures that refit and rival reach
together:

    min over x and the rival's parameters p of |s - s_rival(p) - J x|.

s_rival is not linear in p (periods, gaps, frequencies), so the minimum is sought by damped
Gauss-Newton steps from the best of several starts, one for each shape that the rival may have. It
is a local minimum: the true distance may be smaller, never larger.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.seeking.candidates import Start
from zwidth.diagnosis.seeking.magnitude import strengthened
from zwidth.diagnosis.seeking.modes import mode_starts
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.diagnosis.seeking.waves import wave_starts
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.planning.reference import Reference
from zwidth.sim.device import place_label
from zwidth.sim.physics.effect import Physics, Sought

Floats = NDArray[np.float64]
ROUNDS = 5
STEP = 1e-3  # of a parameter's scale, for finite differences
TRIED = 2  # starts of each rival that are refined
ENOUGH = 0.005  # relative improvement below which the refinement has converged
AIMS = 3  # number of adjustments of a start's strength
MANY = 6  # starts; a rival with more also has shapes between them
RELATED = 0.995  # of the whole distance: largest remaining distance of a related start
SMALLEST, LARGEST = 1e-6, 1e4  # factors by which a start's strength may change at once


def separation(
    reference: Reference,
    physics: Physics,
    rivals: Iterable[Start] | None = None,
    *,
    refine: bool = True,
    enough: float = 0.0,
) -> dict[str, float]:
    """Return the distance in sigma of an effect from each rival, by effect@place, nearest first.

    No distance exceeds that from a device without the effect, since every rival can vanish. rivals:
    starts with their free parameters, several per rival (`seeking.candidates`); by default every
    other effect at every place. refine: whether to use Gauss-Newton steps, which find periods and
    frequencies between the starts; without them only the strength of every start is fitted. enough:
    for a smaller distance an upper limit is returned, without further steps.
    """
    own = place_label(physics)
    grouped: dict[str, list[Start]] = {}
    for start in shapes(reference.starts if rivals is None else rivals):
        if start.label != own:
            grouped.setdefault(start.label, []).append(start)
    signature = reference.signature(physics)
    ways: set[Sought] = set()
    if refine:
        ways = {starts[0].physics.effect.sought for starts in grouped.values()}
    for start in _sought(reference, signature, ways):
        if start.label in grouped:
            grouped[start.label].append(start)

    def nearest(starts: Sequence[Start]) -> float:
        off = reference.off(physics.effect.name, starts[0].physics.effect.name)
        target = off(signature)
        whole = float(np.linalg.norm(target))
        if whole <= enough:
            return whole
        tried = sorted((_aimed(reference, off, target, s) for s in starts), key=lambda t: t.left)
        hopeful = [t for t in tried if len(starts) >= MANY or t.left < RELATED * whole]
        for t in hopeful[:TRIED] if refine else ():
            if min(one.left for one in tried) > enough:
                tried.append(_refined(reference, off, target, t, enough))
        return min(whole, *(t.left for t in tried))

    tasks = [partial(nearest, starts) for starts in grouped.values()]
    found = dict(zip(grouped, in_parallel(tasks, threads()), strict=True))
    return dict(sorted(found.items(), key=lambda pair: pair[1]))


def _sought(reference: Reference, signature: Floats, ways: Collection[Sought]) -> list[Start]:
    """Starts at the periods and resonances that a matched search finds in a signature.

    Both are narrow minima, which descent from a start beside them does not reach (a mode at another
    mass seemed 9.7 sigma away, and was 0.7). ways: the kinds of search to make.
    """
    x = np.zeros(Model(reference.device).linear_count)
    left = -signature
    as_left = Fitted(
        Model(reference.device), x, float(left @ left), left, reference.jacobian,
        reference.base.size,
    )  # fmt: skip
    waves = wave_starts(reference.problem, as_left) if "waves" in ways else []
    modes = mode_starts(reference.problem, as_left) if "resonances" in ways else []
    return [*waves, *modes]


def shapes(starts: Iterable[Start]) -> list[Start]:
    """Return one start of middle strength per shape; starts of a shape differ only in strength."""
    grouped: dict[object, list[Start]] = {}
    for start in starts:
        grouped.setdefault(_shape(start), []).append(start)
    return [group[len(group) // 2] for group in grouped.values()]


def _shape(start: Start) -> object:
    effect, values = start.physics.effect, start.physics.values
    if effect.strength is None or not effect.magnitudes:
        return (start.label, *values.items())
    none = {name: effect.parameter(name).none_of_it() for name in effect.magnitudes}
    strength = abs(values[effect.strength] - none[effect.strength])
    ratios = [f"{(v - none[k]) / strength if k in none else v:.4g}" for k, v in values.items()]
    return (start.label, *ratios)


@dataclass(frozen=True)
class Aimed:
    """A rival at some values, and the remaining distance: |target - signature|."""

    start: Start
    signature: Floats
    left: float


def _aimed(reference: Reference, off: Complement, target: Floats, start: Start) -> Aimed:
    """A start at the strength of least distance, by repeated linear scaling of its signature.

    If the signature has the wrong sign and is larger than the target, a strength at which it is
    smaller than the target is tried.
    """
    whole = float(np.linalg.norm(target))
    best = _at(reference, off, target, start)
    for _ in range(AIMS):
        size = float(np.linalg.norm(best.signature))
        if size == 0.0:
            break
        factor = float(best.signature @ target) / size**2
        if factor <= 0.0 and size > whole:
            factor = 0.3 * whole / size
        if not SMALLEST < factor < LARGEST or abs(factor - 1.0) < 0.1:
            break
        scaled = _scaled(best.start, factor, reference.peak)
        if scaled is None:
            break
        tried = _at(reference, off, target, scaled)
        if tried.left >= best.left:
            break
        best = tried
    return best


def _scaled(start: Start, factor: float, peak: float) -> Start | None:
    physics = strengthened(start.physics, factor, peak)
    names = start.physics.effect.magnitudes
    scales = {k: v * factor if k in names else v for k, v in start.scales.items()}
    return None if physics is None else replace(start, physics=physics, scales=scales)


def _at(reference: Reference, off: Complement, target: Floats, start: Start) -> Aimed:
    signature = off(reference.signature(start.physics))
    return Aimed(start, signature, float(np.linalg.norm(target - signature)))


def _refined(
    reference: Reference, off: Complement, target: Floats, best: Aimed, enough: float
) -> Aimed:
    """Damped Gauss-Newton in the rival's parameters, in units of their scales."""
    damping = 1e-3
    for _ in range(ROUNDS):
        names = [k for k, scale in best.start.scales.items() if scale != 0.0]
        columns = [
            (off(reference.signature(_moved(best.start, {k: STEP}).physics)) - best.signature)
            / STEP
            for k in names
        ]
        slope = np.column_stack(columns)
        gram, gradient = slope.T @ slope, slope.T @ (target - best.signature)
        before = best.left
        for _ in range(3):
            step = _solved(gram, gradient, damping)
            moved = _moved(best.start, dict(zip(names, step.tolist(), strict=True)))
            tried = _at(reference, off, target, moved)
            if tried.left < best.left:
                best, damping = tried, 0.1 * damping
                break
            damping = 30.0 * damping
        if best.left > (1.0 - ENOUGH) * before or best.left <= enough:
            break
    return best


def _solved(gram: Floats, gradient: Floats, damping: float) -> Floats:
    weight = np.diag(np.maximum(np.diag(gram), 1e-300))
    solved = np.linalg.lstsq(gram + damping * weight, gradient, rcond=1e-14)[0]
    return np.asarray(solved, dtype=np.float64)


def _moved(start: Start, steps: Mapping[str, float]) -> Start:
    """The start moved by steps in units of its scales, within the limits of the effect."""
    values = dict(start.physics.values)
    for name, step in steps.items():
        p = start.physics.effect.parameter(name)
        values[name] = min(p.upper, max(p.lower, values[name] + step * start.scales[name]))
    return replace(start, physics=replace(start.physics, values=values))
