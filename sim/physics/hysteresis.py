"""A hysteretic spring after Bouc and Wen.

With z the force over its ultimate value (level),

    f = -level z,    dz/dq = (stiffness / level) (1 - |z|^shape (1 + sign(z dq)) / 2).

stiffness: slope at z = 0 and wherever it unloads; shape: how sharply it yields (1 gently, infinity
elastic and ideally plastic). beta = gamma of the general law, so that it unloads straight: with
that it dissipates on every path (Ikhouane & Rodellar, Systems with Hysteresis, Wiley 2007).

z depends on the path alone. With x the way in units of level / stiffness: unloading, z moves by x,
exact. Loading, in y = artanh z,

    dy/dx = r(z) = (1 - z^shape) / (1 - z^2),    r between 1/2 and shape / 2 or 1,

a rate that nowhere is stiff: the midpoint rule in y is second order, exact for shape = 2, and keeps
z < 1 for any step. tanh(y + d) = (z + t) / (1 + z t), t = tanh d, saves the artanh. As a force it
is held over the substep at the mean of both ends: second order, stable for
h < 2 sqrt(m / stiffness).
"""

from zwidth.sim.elementary import power, tanh
from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, greatest, least, select, signed
from zwidth.sim.physics.effect import Effect, Parameter
from zwidth.sim.physics.path import out_and_back

hysteresis = Effect(
    name="hysteresis",
    summary="a spring that yields and dissipates, Bouc-Wen",
    places=("ground", "link12"),
    parameters=(
        Parameter("stiffness", "k_h", "N m/rad", 0.0, 1e12, None),
        Parameter("level", "f_h", "N m", 0.0, 1e6, 0.0),
        Parameter("shape", "n", "", 1.0, 100.0, None),
    ),
    hook="force",
    code=5,
    reference="Y.-K. Wen, J. Eng. Mechanics Div. ASCE 102(2), 1976; R. Bouc, 1967",
)


@part
def bouc_wen_force(z, p):
    """Force at z."""
    return -p[1] * z


@part
def yielding_rate(z, shape):
    """Return dy/dx at 0 <= z <= 1."""
    below = 1.0 - z * z
    inside = below > 0.0
    rate = (1.0 - power(z, shape)) / select(inside, below, 1.0)
    return select(inside, rate, 0.5 * shape)


@part
def farther(z, d):
    """Return tanh(artanh z + d)."""
    t = tanh(d)
    return (z + t) / (1.0 + z * t)


@part
def bouc_wen_along(z, way, p):
    """Return z after a way in one direction."""
    side = signed(1.0, way)
    x = abs(way) * p[0] / select(p[1] == 0.0, 1.0, p[1])
    unloading = greatest(0.0, least(x, -side * z))
    x -= unloading
    bent = side * z + unloading
    loaded = greatest(0.0, bent)  # what follows is of no account where all of the way unloads
    middle = farther(loaded, 0.5 * x * yielding_rate(loaded, p[2]))
    end = farther(loaded, x * yielding_rate(middle, p[2]))
    return side * select(x > 0.0, end, bent)


@part
def next_yield(z, q0, q1, v0, v1, h, p):
    """Return z after a substep."""
    out, back = out_and_back(q0, q1, v0, v1, h)
    after = select(out != 0.0, bouc_wen_along(z, out, p), z)
    if any_lane(back != 0.0):
        after = select(back != 0.0, bouc_wen_along(after, back, p), after)
    return select(p[1] == 0.0, z, after)
