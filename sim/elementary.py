"""exp, log, sin, cos, tanh and atan, computed by + - * / alone, for one number or for lanes.

A library's functions differ between systems and take one number at a time. These have the same
bits everywhere, alone and in lanes. Each reduces its argument exactly or nearly so and sums a
polynomial; the constants are those of FreeBSD's msun (Sun Microsystems 1993) and, of tanh and atan,
of Cephes (Moshier 1989). Errors, in units of the last place (`tests/test_elementary.py`): exp, log
below 1.5; sin, cos below 1.5 for |x| < 1e6, beyond which the reduction loses digits; tanh below 3,
atan below 2.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from zwidth.sim.jit import part
from zwidth.sim.lane_type import exponent, floor, least, select, signed, two_to

LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
PER_LN2 = 1.44269504088896338700
HALF_PI = (1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
PER_HALF_PI = 6.36619772367581382433e-01
HALF_PI_AT, ATAN_REST = 1.57079632679489661923, 6.123233995736765886130e-17
MOST, LEAST = 709.78, -708.39  # exponents beyond which exp is no normal number


@part
def exp(x):
    """Return e^x; 0 below -708.39, infinite above 709.78.

    x = n ln 2 + r with |r| <= ln 2 / 2, and e^r = 1 + (r c / (2 - c) + r), c = r - r^2 P(r^2).
    """
    inside = select(x > MOST, 0.0, select(x < LEAST, 0.0, x))
    n = floor(inside * PER_LN2 + 0.5)
    high = inside - n * LN2_HIGH
    low = n * LN2_LOW
    r = high - low
    t = r * r
    c = r - t * (
        1.66666666666666019037e-01
        + t
        * (
            -2.77777777770155933842e-03
            + t
            * (
                6.61375632143793436117e-05
                + t * (-1.65339022054652515390e-06 + t * 4.13813679705723846039e-08)
            )
        )
    )
    y = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    # 2^n in two factors: n may be 1024, just below the largest number
    half = floor(0.5 * n)
    y = (y * two_to(half)) * two_to(n - half)
    return select(x > MOST, 1e308 * 10.0, select(x < LEAST, 0.0, y))


@part
def log(x):
    """Return ln x of a normal x > 0.

    x = 2^k (1 + f) with 1 + f between sqrt(1/2) and sqrt(2), s = f / (2 + f), and
    ln(1 + f) = f - (f^2 / 2 - s (f^2 / 2 + R(s^2))).
    """
    k = exponent(x)
    m = x * two_to(-k)
    above = m > 1.4142135623730951
    k = select(above, k + 1.0, k)
    f = select(above, 0.5 * m, m) - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = w * (
        3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01)
    )
    even = z * (
        6.666666666666735130e-01
        + w
        * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half = 0.5 * f * f
    return k * LN2_HIGH - ((half - (s * (half + (odd + even)) + k * LN2_LOW)) - f)


@part
def power(x, y):
    """Return x^y of x >= 0 and y > 0; its relative error grows with |y ln x|."""
    some = x > 0.0
    return select(some, exp(y * log(select(some, x, 1.0))), 0.0)


@part
def _sine(r):
    """Sin on |r| <= pi / 4."""
    z = r * r
    tail = 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z
        * (
            2.75573137070700676789e-06
            + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
        )
    )
    return r + z * r * (-1.66666666666666324348e-01 + z * tail)


@part
def _cosine(r):
    """Cos on |r| <= pi / 4; 1 - z / 2 is rounded, and what that lost is added."""
    z = r * r
    tail = z * (
        4.16666666666666019037e-02
        + z
        * (
            -1.38888888888741095749e-03
            + z
            * (
                2.48015872894767294178e-05
                + z
                * (
                    -2.75573143513906633035e-07
                    + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
                )
            )
        )
    )
    half = 0.5 * z
    rounded = 1.0 - half
    return rounded + (((1.0 - rounded) - half) + z * tail)


@part
def _turned(x, quarters):
    """Sin of x plus so many quarter turns: x = n pi / 2 + r, and the quadrant says which series."""
    n = floor(x * PER_HALF_PI + 0.5)
    r = ((x - n * HALF_PI[0]) - n * HALF_PI[1]) - n * HALF_PI[2]
    quadrant = n + quarters
    quadrant = quadrant - 4.0 * floor(0.25 * quadrant)
    s = _sine(r)
    c = _cosine(r)
    odd = (quadrant == 1.0) | (quadrant == 3.0)
    value = select(odd, c, s)
    return select(quadrant >= 2.0, -value, value)


@part
def sin(x):
    """Return the sine of x [rad]."""
    return _turned(x, 0.0)


@part
def cos(x):
    """Return the cosine of x [rad]."""
    return _turned(x, 1.0)


@part
def tanh(x):
    """Return the hyperbolic tangent: a rational function below 0.625, else 1 - 2 / (e^2x + 1)."""
    a = abs(x)
    z = x * x
    numerator = (
        -9.64399179425052238628e-01 * z + -9.92877231001918586564e01
    ) * z + -1.61468768441708447952e03
    denominator = (
        (z + 1.12811678491632931402e02) * z + 2.23548839060100448583e03
    ) * z + 4.84406305325125486048e03
    small = x + x * z * (numerator / denominator)
    large = signed(1.0 - 2.0 / (exp(2.0 * least(a, 30.0)) + 1.0), x)
    return select(a < 0.625, small, large)


@part
def atan(x):
    """Return the angle whose tangent is x.

    |x| is brought below 0.66 by atan x = pi / 2 - atan(1 / x) above tan(3 pi / 8), and by
    atan x = pi / 4 + atan((x - 1) / (x + 1)) between; the rest is a quotient of polynomials.
    """
    size = abs(x)
    far = size > 2.414213562373095
    middle = size > 0.66
    top = select(far, -1.0, select(middle, size - 1.0, size))
    y = top / select(far, size, select(middle, size + 1.0, 1.0))
    turned = select(far, HALF_PI_AT, select(middle, 0.5 * HALF_PI_AT, 0.0))
    more = select(far, ATAN_REST, select(middle, 0.5 * ATAN_REST, 0.0))
    z = y * y
    above = z * (
        (
            (
                (-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z
                - 7.500855792314704667340e1
            )
            * z
            - 1.228866684490136173410e2
        )
        * z
        - 6.485021904942025371773e1
    )
    below = (
        (((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z
         + 4.328810604912902668951e2) * z
        + 4.853903996359136964868e2
    ) * z + 1.945506571482613964425e2  # fmt: skip
    return signed(turned + (y * above / below + y + more), x)
