"""Numbers in the browser's tooltips, written as in `sim.readable`."""

from bokeh.models import CustomJSHover

from zwidth.sim.readable import PREFIXES

UNBOUNDED = "grows without bound"
LETTERS = {power: letter for power, letter in PREFIXES.items() if power <= 0}
CODE = """
const size = Math.abs(value)
if (!Number.isFinite(size)) return "%(unbounded)s"
if (size == 0) return "0 %(unit)s"
const letters = %(letters)s
const power = Math.min(Math.max(3 * Math.floor(Math.log10(size) / 3 + 1e-9), %(least)d), 0)
const shown = value / 10 ** power
const digits = Math.abs(shown) < 1e6 ? Number(shown.toPrecision(3)) : shown.toExponential(2)
return digits + " " + letters[power] + "%(unit)s"
"""


def sized(unit: str) -> CustomJSHover:
    """Return a formatter that writes a number with its prefix: 2.1e-3, "rad" -> "2.1 mrad".

    NaN there belongs to a run that grew until it could not be measured.
    """
    letters = {str(power): letter for power, letter in LETTERS.items()}
    values = {"unbounded": UNBOUNDED, "unit": unit, "letters": letters, "least": min(LETTERS)}
    return CustomJSHover(code=CODE % values)
