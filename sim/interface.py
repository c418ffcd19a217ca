"""What stands between controller and mechanism: clock, encoder, amplifier."""

import math
from dataclasses import dataclass, fields
from typing import Literal


@dataclass(frozen=True)
class Interface:
    """The sampled side of a device.

    period T [s]; delay [s], any real >= 0, from the encoder reading to the moment the command takes
    effect; encoder_step [rad | m], 0 for none; command_step and command_limit [N m | N], 0 and inf
    for none; velocity_cutoff_hz of the first-order low-pass on the backward difference, inf for
    none; encoder_rounding "nearest" (ties away from zero) or "floor". command_gain: what a command
    counts by, after its step and before all else of the amplifier (limits are of the force).
    position_origin [rad | m]: what is read, and written down as positions, where the chain is at
    zero and a spring to ground at rest. command_hold: what a *recorded* command is between its
    samples, "zero_order" or "smooth" (a band-limited signal); a law's command is held in any case.

    Raises ValueError with a sentence that names the field, the value and what is allowed.
    """

    period: float = 0.001
    delay: float = 0.0
    encoder_step: float = 0.0
    command_step: float = 0.0
    command_limit: float = math.inf
    velocity_cutoff_hz: float = math.inf
    encoder_rounding: Literal["nearest", "floor"] = "nearest"
    command_gain: float = 1.0
    position_origin: float = 0.0
    command_hold: Literal["zero_order", "smooth"] = "zero_order"

    def __post_init__(self) -> None:
        for field, allowed, holds in (
            ("period", "> 0 and finite [s]", 0.0 < self.period < math.inf),
            ("delay", ">= 0 and finite [s]", 0.0 <= self.delay < math.inf),
            ("encoder_step", ">= 0 and finite", 0.0 <= self.encoder_step < math.inf),
            ("command_step", ">= 0 and finite", 0.0 <= self.command_step < math.inf),
            ("command_limit", "> 0, inf for none", self.command_limit > 0.0),
            ("velocity_cutoff_hz", "> 0, inf for none", self.velocity_cutoff_hz > 0.0),
            (
                "encoder_rounding",
                "'nearest' or 'floor'",
                self.encoder_rounding in ("nearest", "floor"),
            ),
            ("command_gain", "> 0 and finite", 0.0 < self.command_gain < math.inf),
            ("position_origin", "any finite number", math.isfinite(self.position_origin)),
            (
                "command_hold",
                "'zero_order' or 'smooth'",
                self.command_hold in ("zero_order", "smooth"),
            ),
        ):
            if not holds:
                value = getattr(self, field)
                raise ValueError(f"interface.{field} is {value}; allowed is {allowed}")

    @property
    def delay_ticks(self) -> tuple[int, float]:
        """Return (whole periods d, remaining time [s]) with delay = d T + remainder, 0 <= r < T.

        A remainder within 1e-9 T of a whole period is rounding of decimal input, not a delay.
        """
        whole = math.floor(self.delay / self.period + 1e-9)
        remainder = self.delay - whole * self.period
        return whole, remainder if remainder > 1e-9 * self.period else 0.0

    @property
    def velocity_smoothing(self) -> float:
        """Weight a of v_k = v_{k-1} + a (difference - v_{k-1}): 1 - exp(-2 pi f T)."""
        return 1.0 - math.exp(-2.0 * math.pi * self.velocity_cutoff_hz * self.period)

    @property
    def linear(self) -> bool:
        """True where nothing in the interface is nonlinear."""
        return (
            self.encoder_step == 0.0 and self.command_step == 0.0 and math.isinf(self.command_limit)
        )


INTERFACE_FIELDS = tuple(field.name for field in fields(Interface))
