"""The nearest passive chain: if a fit has negative dampers, the closest chain without them.

It minimises the rms over a logarithmic grid of frequencies of the relative complex error |G_passive
/ G - 1|, so that a resonance and its flanks, an octave at 2 Hz and one at 200 Hz have equal weight.
Masses and springs stay positive by their logarithm, dampers by the bound 0, at which bounded least
squares (dogleg in a box) can end. Limit: the best of a few starts, not proven global.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from zwidth.shown import fields_html
from zwidth.sim.chain import Chain, Floats, make_chain, negative_dampers
from zwidth.sim.ladder import dynamic_stiffness, frequency_response, from_vector, to_vector

BAND_HZ = (1.0, 300.0)
POINTS = 240
SPREADS = (0.0, 0.01, 0.1, 1.0)


class PassiveFit(NamedTuple):
    """A chain with all dampers >= 0 and its distance: rms relative error of G over the band."""

    chain: Chain
    distance: float

    _repr_html_ = fields_html


def nearest_passive(chain: Chain, band_hz: tuple[float, float] = BAND_HZ) -> PassiveFit:
    """Return the nearest passive chain with the same number of masses and ground spring.

    If the chain is passive, it is returned at distance 0. The search starts from negative dampers
    raised to zero, and to three fractions of the mean damper. Deterministic; about 0.1 s for three
    masses.
    """
    if not negative_dampers(chain):
        return PassiveFit(chain, 0.0)
    frequency = np.geomspace(*band_hz, POINTS)
    fits = [_fit(chain, frequency, spread) for spread in SPREADS]
    return min(fits, key=lambda fit: fit.distance)


def distance(chain: Chain, other: Chain, frequency: Floats) -> float:
    """Return the rms of |G_other / G - 1| over the frequencies [Hz]."""
    return float(np.sqrt(np.sum(_error(chain, other, frequency) ** 2)))


def _fit(chain: Chain, frequency: Floats, spread: float) -> PassiveFit:
    damper = _dampers(chain)
    size = np.abs(to_vector(chain))
    typical = size[damper].mean()
    size[damper] = np.maximum(size[damper], 0.1 * typical)

    def model(z: Floats) -> Chain:
        return from_vector(size * np.where(damper, z, np.exp(z)), chain.ground_spring)

    raised = np.maximum(to_vector(chain), spread * typical) / size

    def error(z: Floats) -> Floats:
        return _error(chain, model(z), frequency)

    solution = least_squares(
        error,
        np.where(damper, raised, 0.0),
        bounds=(np.where(damper, 0.0, -5.0), np.where(damper, np.inf, 5.0)),
        method="dogbox",
        xtol=1e-12,
        ftol=1e-12,
    )
    found = make_chain(*model(solution.x))
    return PassiveFit(found, distance(chain, found, frequency))


def _dampers(chain: Chain) -> NDArray[np.bool_]:
    """Return which entries of the chain's vector are dampers."""
    n = chain.masses.size
    return np.repeat([False, True, False, True], [n, n, n - 1, n - 1])


def _error(chain: Chain, other: Chain, frequency: Floats) -> Floats:
    """Real and imaginary parts of G_other/G - 1, over the root of their number of points."""
    s = 2j * np.pi * frequency
    error = frequency_response(other, frequency) * dynamic_stiffness(chain, s) - 1.0
    return np.concatenate([error.real, error.imag]) / np.sqrt(frequency.size)
