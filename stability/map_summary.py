"""A map in numbers: shares of the fates, sizes of oscillations, borders between fates."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.fate import Fate
from zwidth.stability.fate_map import FateMap
from zwidth.stability.linear import has_theory
from zwidth.stability.plane import Floats
from zwidth.stability.plane_theory import cycle_at_the_limit

WITNESSES = 12  # points at which a cycle is compared with its describing function


def summary(result: FateMap) -> dict[str, Any]:
    """Return the summary of a map for JSON; None: no value.

    fates: for each fate its share of the plane and, over the points that were run and did not
    escape, [median, maximum] of the amplitude [rad | m], of the amplitude in encoder steps, and of
    the force [N m | N]. The comparison with linear theory is None if that does not apply to the
    device. perceptible [N m | N], perceptible_position [rad | m] (None: the skin's): the thresholds
    above which an oscillation is felt. transitions: for each x the y up to which all runs come to
    rest, and the y from which one grows.
    """
    plane, fate = result.plane, result.fates.fate
    rests, grows = result.transitions()
    imperceptible = (fate == Fate.RESTS) | (fate == Fate.DITHERS)
    return {
        "device": plane.device.name,
        "axes": [plane.x.quantity, plane.y.quantity],
        "runs": result.runs,
        "lattice": result.run.size,
        "perceptible": plane.trial.perception.force,
        "perceptible_position": plane.trial.perception.position,
        "fates": {f.word: _of_fate(result, f) for f in Fate},
        **_beside_theory(result, fate != Fate.RESTS, ~imperceptible),
        "transitions": [
            {"x": float(x), "rests_up_to": _known(r), "grows_from": _known(g)}
            for x, r, g in zip(result.x, rests, grows, strict=True)
        ],
        "describing_function": _witnesses(result),
    }


def _beside_theory(
    result: FateMap, moving: NDArray[np.bool_], felt: NDArray[np.bool_]
) -> dict[str, float | None]:
    """Shares of the linearly stable part that move or are felt, and of the unstable at rest."""
    names = ("stable_but_not_resting", "stable_but_perceptible", "unstable_but_resting")
    if not has_theory(result.plane.device):
        return dict.fromkeys(names)
    stable = result.linear < 0.0
    shares = _share(moving, stable), _share(felt, stable), _share(~moving, ~stable)
    return dict(zip(names, shares, strict=True))


def _share(what: np.ndarray, where: np.ndarray) -> float:
    return float(what[where].mean()) if where.any() else 0.0


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _of_fate(result: FateMap, fate: Fate) -> dict[str, Any]:
    there = (result.fates.fate == fate) & result.run & (result.fates.rate < np.inf)
    steps = np.broadcast_to(_on_lattice(result, "encoder_step"), there.shape)[there]
    amplitude = result.fates.amplitude[there]
    with np.errstate(divide="ignore", invalid="ignore"):
        in_steps = amplitude / steps
    return {
        "share": float(np.mean(result.fates.fate == fate)),
        "amplitude": _median_and_most(amplitude),
        "encoder_steps": _median_and_most(in_steps[steps > 0.0]),
        "force": _median_and_most(result.fates.force[there]),
    }


def _on_lattice(result: FateMap, quantity: str) -> Floats:
    """Values of a quantity over the lattice, in a shape that broadcasts to (y, x)."""
    if result.plane.x.quantity == quantity:
        return result.x[None, :]
    if result.plane.y.quantity == quantity:
        return result.y[:, None]
    return np.array(result.plane.at({})[quantity])  # pyright: ignore[reportArgumentType]


def _median_and_most(values: Floats) -> list[float] | None:
    finite = values[np.isfinite(values)]
    return [float(np.median(finite)), float(finite.max())] if finite.size else None


def _witnesses(result: FateMap) -> dict[str, Any] | None:
    """Median relative errors of describing functions over some cycles at the command limit."""
    held = (result.fates.fate == Fate.GROWS) & result.run & (result.fates.frequency > 0.0)
    j, i = np.nonzero(held & np.isfinite(result.fates.amplitude))
    some = np.unique(np.linspace(0, j.size - 1, WITNESSES).astype(int)) if j.size else []
    errors: list[tuple[float, float]] = []
    for k in some:
        found = cycle_at_the_limit(result.plane, float(result.x[i[k]]), float(result.y[j[k]]))
        if found is not None:
            frequency = result.fates.frequency[j[k], i[k]] / found.frequency_hz - 1.0
            amplitude = result.fates.amplitude[j[k], i[k]] / found.amplitude - 1.0
            errors.append((abs(float(frequency)), abs(float(amplitude))))
    if not errors:
        return None
    of_frequency, of_amplitude = np.median(np.array(errors), axis=0)
    return {
        "nonlinearity": "saturation",
        "points": len(errors),
        "frequency_error": float(of_frequency),
        "amplitude_error": float(of_amplitude),
    }
