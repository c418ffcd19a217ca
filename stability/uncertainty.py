"""A 95 % band on K_CR from the covariance of the identified parameters.

Parameters are drawn from the normal distribution of their logarithms (of the delay itself where it
was fitted), K_CR is computed for each draw, and the band is the middle 95 % of the results. No
linearisation is used, so the band is also right near a corner, where K_CR has no derivative. A draw
without a stable K counts as 0. Limitation: with n draws, the ends of the band are uncertain by
about 1/sqrt(n).
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.device import Device
from zwidth.sim.modal import ModalModel, Mode
from zwidth.stability.hand import Range
from zwidth.stability.linear import boundary
from zwidth.stability.sensitivity import parameter_names

Floats = NDArray[np.float64]
DRAWS = 200
LEVELS = (0.025, 0.975)


def stiffness_band(
    device: Device,
    names: Sequence[str],
    covariance: Floats,
    dampings: Iterable[float],
    draws: int = DRAWS,
    seed: int = 0,
) -> list[Range]:
    """Return the band of K_CR at each B.

    names (p,): m, b, omega_1, ... and perhaps delay; covariance (p, p) of their logarithms, of the
    delay [s] itself. Raises ValueError for names that the device does not have, or a matrix that is
    not a covariance.
    """
    model = device.modal
    if model is None:
        raise ValueError(f"{device.name} has no modal form; give a device file with [modal]")
    expected = parameter_names(model)
    if [name for name in names if name != "delay"] != expected:
        raise ValueError(
            f"the covariance is of {', '.join(names)}; the device has {', '.join(expected)}: give"
            " the device file that was written with it"
        )
    rng = np.random.default_rng(seed)
    deviations = rng.standard_normal((draws, len(names))) @ _root(covariance, len(names)).T
    grid = list(dampings)
    values = np.array([*(model.inertia, model.damping), *(x for mode in model.modes for x in mode)])
    found = np.array(
        [
            [p.stiffness or 0.0 for p in boundary(_drawn(device, values, names, row), grid)]
            for row in deviations
        ]
    )
    low, high = np.quantile(found, LEVELS, axis=0)
    return [Range(float(a), float(b)) for a, b in zip(low, high, strict=True)]


def _root(covariance: Floats, size: int) -> Floats:
    """Return a matrix r with r r^T = covariance, also where the covariance is singular."""
    if covariance.shape != (size, size) or not np.all(np.isfinite(covariance)):
        raise ValueError(
            f"the covariance has shape {covariance.shape}; {size} names need finite numbers in"
            f" {size} rows and columns"
        )
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    if values.min() < -1e-9 * values.max():
        raise ValueError(
            "the covariance is not positive; give the file as `zwidth identify` wrote it"
        )
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _drawn(device: Device, values: Floats, names: Sequence[str], row: Floats) -> Device:
    shift = {name: float(x) for name, x in zip(names, row, strict=True)}
    late = shift.pop("delay", 0.0)
    m, b, *rest = (values * np.exp(np.array(list(shift.values())))).tolist()
    modes = tuple(Mode(*rest[i : i + 4]) for i in range(0, len(rest), 4))
    drawn = device.with_modal(ModalModel(m, b, modes))
    return drawn.with_interface(delay=max(0.0, device.interface.delay + late))
