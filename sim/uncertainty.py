"""How well the numbers of a device file are known, which limits their change in a fit."""

from dataclasses import dataclass, fields

from zwidth.shown import Valued

# A fit moves by at most three of them: at 2 this is a factor of 400, which means no knowledge.
MOST = 2.0
MOST_OF_A_DAMPER = 100.0
FARTHEST_ZERO = 1e3  # m or rad
LEAST = 1e-6  # practically exact; zero would leave a fit without a scale


@dataclass(frozen=True)
class Uncertainty(Valued):
    """Standard deviations (one sigma) of the values in a device file; all but `zeros` are relative.

    command_scale: of the scale of the command, 0 if it is known exactly; motion alone cannot
    distinguish it from scaling all masses, springs, dampers and forces. masses; springs, including
    the one to ground; dampers, which are known worst: they are rarely measured, and change with
    temperature and wear. zeros [rad | m]: of the difference between the readings of the sensors of
    m2, m3, ... and of m1 while no link is deflected; 0 if there is none.

    Raises ValueError with a sentence that names the field, the value and what is allowed.
    """

    command_scale: float = 0.0
    masses: float = 0.3
    springs: float = 0.3
    dampers: float = 0.5
    zeros: float = 0.0

    def __post_init__(self) -> None:
        for field, least, most in (
            ("command_scale", 0.0, MOST),
            ("masses", LEAST, MOST),
            ("springs", LEAST, MOST),
            ("dampers", LEAST, MOST_OF_A_DAMPER),
            ("zeros", 0.0, FARTHEST_ZERO),
        ):
            value = getattr(self, field)
            if not least <= value <= most:  # also refuses NaN
                what = "m or rad" if field == "zeros" else "relative to the value"
                raise ValueError(
                    f"uncertainty.{field} is {value}; this standard deviation ({what}) must be from"
                    f" {least:g} to {most:g}"
                )


UNCERTAINTY_FIELDS = tuple(field.name for field in fields(Uncertainty))
