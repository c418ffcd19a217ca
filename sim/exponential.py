"""Exact motion of x' = A x + B u under held inputs: x(t + h) = E x(t) + F u, for one run or lanes.

E = exp(A h) and F = h phi(A h) B with phi(X) = 1 + X/2! + X^2/3! + ..., so that E = 1 + X phi(X).

    phi(X / 2^s) by its series to the 19th power, |X / 2^s| <= 1, then s times
    phi(2 X) = (E + 1) phi(X) / 2,    exp(2 X) = E^2

(Higham, Functions of Matrices, SIAM 2008, chapter 10). Velocities are measured in units of
position a substep and the amplifier's force in what moves by one, in powers of two, which costs no
digits and keeps |X| near omega h, where the units of the device would make it omega^2 h. A row of
zeros in A (a locked mass) stays what it is, exactly: that mass does not move.

Computed by + - * / alone, so every processor gives the same bits, and a lane gives those of a
single run.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from zwidth.sim.jit import jit, part
from zwidth.sim.lane_type import any_lane, exponent, greatest, select, two_to

SPACES = 7  # matrices of working space
POWER, SQUARE, CUBE, FOURTH, PHI, EXP, SPARE = range(SPACES)
SERIES = (  # 1 / (k + 1)!, k = 0..19
    1.0, 1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0, 1.0 / 5040.0, 1.0 / 40320.0,
    1.0 / 362880.0, 1.0 / 3628800.0, 1.0 / 39916800.0, 1.0 / 479001600.0, 1.0 / 6227020800.0,
    1.0 / 87178291200.0, 1.0 / 1307674368000.0, 1.0 / 20922789888000.0, 1.0 / 355687428096000.0,
    1.0 / 6402373705728000.0, 1.0 / 121645100408832000.0, 1.0 / 2432902008176640000.0,
)  # fmt: skip
MOST_SQUARINGS = 60


@part
def multiply(a, b, size, out):
    """Set out = a b."""
    for i in range(size):
        for j in range(size):
            total = a[i, 0] * b[0, j]
            for k in range(1, size):
                total += a[i, k] * b[k, j]
            out[i, j] = total


@part
def units(a, h, dof, size, scale):
    """Fill scale (size,): what a unit of each state is, in powers of two."""
    speed = two_to(-exponent(h))
    for i in range(size):
        scale[i] = 1.0
    for i in range(dof):
        scale[dof + i] = speed
    if size > 2 * dof:
        push = a[dof, 2 * dof]  # 1 / m1, or nothing where m1 is locked
        per = select(push > 0.0, h * push, 1.0)
        scale[2 * dof] = select(push > 0.0, two_to(exponent(speed / per)), 1.0)


@part
def held_motion(a, b, h, dof, size, scale, work, out):
    """Fill out (size.., size + inputs) with [E, F] for the duration h > 0.

    a (size, size), b (size, inputs); scale (size,) and work (7, size, size) are working space.
    """
    x, square, cube, fourth = work[POWER], work[SQUARE], work[CUBE], work[FOURTH]
    phi, e, spare = work[PHI], work[EXP], work[SPARE]
    units(a, h, dof, size, scale)
    norm = 0.0
    for i in range(size):
        row = 0.0
        for j in range(size):
            x[i, j] = a[i, j] * h * (scale[j] / scale[i])
            row += abs(x[i, j])
        norm = greatest(norm, row)
    squarings = 0.0
    shrink = 1.0
    for _ in range(MOST_SQUARINGS):
        more = norm * shrink > 1.0
        if not any_lane(more):
            break
        squarings += select(more, 1.0, 0.0)
        shrink = select(more, 0.5 * shrink, shrink)
    for i in range(size):
        for j in range(size):
            x[i, j] *= shrink
    multiply(x, x, size, square)
    multiply(square, x, size, cube)
    multiply(square, square, size, fourth)
    for block in range(4, -1, -1):  # Horner in X^4 (Paterson and Stockmeyer, 1973)
        k = 4 * block
        if block < 4:
            multiply(phi, fourth, size, spare)
        for i in range(size):
            for j in range(size):
                total = SERIES[k + 1] * x[i, j] + SERIES[k + 2] * square[i, j]
                total += SERIES[k + 3] * cube[i, j]
                if i == j:
                    total += SERIES[k]
                if block < 4:
                    total += spare[i, j]
                phi[i, j] = total
    multiply(x, phi, size, e)
    for i in range(size):
        e[i, i] += 1.0
    done = 0.0
    for _ in range(MOST_SQUARINGS):
        more = done < squarings
        if not any_lane(more):
            break
        for i in range(size):
            e[i, i] += 1.0
        multiply(e, phi, size, spare)
        for i in range(size):
            e[i, i] -= 1.0
            for j in range(size):
                phi[i, j] = select(more, 0.5 * spare[i, j], phi[i, j])
        multiply(e, e, size, spare)
        for i in range(size):
            for j in range(size):
                e[i, j] = select(more, spare[i, j], e[i, j])
        done += 1.0
    multiply(phi, x, size, e)  # anew, which is free of what the squarings have rounded
    for i in range(size):
        for j in range(size):
            moved = e[i, j] / shrink
            out[i, j] = (moved + 1.0 if i == j else moved) * (scale[i] / scale[j])
        for u in range(b.shape[1]):
            total = 0.0
            for j in range(size):
                total += phi[i, j] * (scale[i] / scale[j]) * b[j, u]
            out[i, size + u] = h * total


@jit
def held_motion_alone(a, b, h, dof, scale, work, out):
    """`held_motion` of one device."""
    held_motion(a, b, h, dof, a.shape[0], scale, work, out)


@jit
def held_motion_each(a, b, h, dof, scale, work, out):
    """`held_motion` of many devices, one after the other; the first axis counts them."""
    for m in range(a.shape[0]):
        held_motion(a[m], b[m], h, dof, a.shape[1], scale, work, out[m])
