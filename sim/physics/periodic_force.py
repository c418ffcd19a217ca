"""A force of any shape that repeats with position, as four harmonics of its period.

    f = sum over k = 1..4 of a_k cos(k phi) + b_k sin(k phi),    phi = 2 pi q / period,

in a link over the position of its first mass, as `force_ripple`.

This is not an effect of the library, which has the first harmonic alone. The diagnosis uses it to
test whether a named `force_ripple` has several harmonics (`forces/probes.py`), as a magnet's detent
or the cogging of slots and poles has.
"""

import math

from zwidth.sim.elementary import cos, sin
from zwidth.sim.jit import part
from zwidth.sim.physics.effect import Effect, Parameter
from zwidth.sim.place import LINKS, MASSES

HARMONICS = 4

periodic_force = Effect(
    name="periodic_force",
    summary="a force of any shape that repeats with position",
    places=(*MASSES, *LINKS),
    parameters=(
        Parameter("period", "lambda_p", "rad", 1e-9, 1e6, None),
        *(
            Parameter(f"{wave}{k}", f"{wave[0]}_{k}", "N m", -1e6, 1e6, 0.0)
            for k in range(1, HARMONICS + 1)
            for wave in ("cosine", "sine")
        ),
    ),
    hook="force",
    code=11,
    over_first=True,
    reference="Holtz & Springob, IEEE T. Industrial Electronics 43(2), 1996",
)


@part
def periodic(q, p):
    """Force at position q: the harmonics by turning the first one on."""
    phi = 2.0 * math.pi * q / p[0]
    c, s = cos(phi), sin(phi)
    ck, sk, f = 1.0, 0.0, 0.0
    for k in range(HARMONICS):
        ck, sk = ck * c - sk * s, sk * c + ck * s
        f += p[1 + 2 * k] * ck + p[2 + 2 * k] * sk
    return f
