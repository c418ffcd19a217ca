"""The interface between controller and mechanism: clock, encoder, amplifier."""

import math
from dataclasses import dataclass, fields
from typing import Literal

from zwidth.shown import Valued
from zwidth.sim.estimators import ESTIMATORS, MOST_WINDOW, Estimator, Settings
from zwidth.sim.nearest import nearest

LINKS = ("link12", "link23", "link34", "link45")
MOST_RATIO = 1000  # largest ratio of the rates of two loops


@dataclass(frozen=True)
class Interface(Valued):
    """The sampled side of a device.

    period T [s]; delay [s], any real >= 0, from the encoder reading to the moment the command takes
    effect; encoder_step [rad | m], 0 for none; command_step and command_limit [N m | N], 0 and inf
    for none; velocity_cutoff_hz of the low-pass on the backward difference, inf for none;
    encoder_rounding "nearest" (ties away from zero) or "floor". command_gain: factor on the
    command, applied after rounding and before limits and lag, so that limits are limits of the
    force. position_origin [rad | m]: the recorded position at which the chain is at zero and a
    spring to ground is relaxed. command_hold: how a *recorded* command continues between its
    samples, "zero_order" or "smooth" (a band-limited signal); a law's command is always held.

    Several rates: the encoder is read and a command computed every period. velocity_order of that
    low-pass, 1 or 2 (Butterworth). velocity_ticks: periods from one velocity estimate to the next;
    each is over this number of periods, and held in between. position_ticks: periods from one new
    position for the law to the next, as in an outer loop that is slower than the device's own.

    velocity_estimator: how the velocity is computed from the readings, before that low-pass; a name
    of `sim/estimators`. velocity_window, velocity_band [rad | m], velocity_noise [rad | m] and
    velocity_acceleration [rad/s2 | m/s2]: its settings, 0 for those that it does not have.
    velocity_step [rad/s | m/s]: resolution of the velocity that the law gets (a register); 0 for
    none.

    force_sensor: the link whose force is measured ("link12"), "" for none; force_gain G of its
    feedback (`sim/force_sensor.py`).

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
    velocity_order: int = 1
    velocity_ticks: int = 1
    position_ticks: int = 1
    force_sensor: str = ""
    force_gain: float = 0.0
    velocity_estimator: str = "difference"
    velocity_window: int = 0
    velocity_band: float = 0.0
    velocity_noise: float = 0.0
    velocity_acceleration: float = 0.0
    velocity_step: float = 0.0

    def __post_init__(self) -> None:
        for field, allowed, holds in (
            ("period", "> 0 and finite [s]", 0.0 < self.period < math.inf),
            ("delay", ">= 0 and finite [s]", 0.0 <= self.delay < math.inf),
            ("encoder_step", ">= 0 and finite", 0.0 <= self.encoder_step < math.inf),
            ("command_step", ">= 0 and finite", 0.0 <= self.command_step < math.inf),
            ("velocity_step", ">= 0 and finite", 0.0 <= self.velocity_step < math.inf),
            ("command_limit", "> 0, or inf for none", self.command_limit > 0.0),
            ("velocity_cutoff_hz", "> 0, or inf for none", self.velocity_cutoff_hz > 0.0),
            (
                "encoder_rounding",
                "'nearest' or 'floor'",
                self.encoder_rounding in ("nearest", "floor"),
            ),
            ("command_gain", "> 0 and finite", 0.0 < self.command_gain < math.inf),
            ("position_origin", "a finite number", math.isfinite(self.position_origin)),
            (
                "command_hold",
                "'zero_order' or 'smooth'",
                self.command_hold in ("zero_order", "smooth"),
            ),
            ("force_gain", ">= 0 and finite", 0.0 <= self.force_gain < math.inf),
            ("force_gain", "0 without force_sensor", self.force_sensor or self.force_gain == 0.0),
            ("force_sensor", "a link, such as link12, or empty", self.force_sensor in ("", *LINKS)),
            ("velocity_order", "1 or 2", self.velocity_order in (1, 2)),
            *(
                (
                    name,
                    f"a whole number from 1 to {MOST_RATIO}",
                    _whole(getattr(self, name)) and 1 <= getattr(self, name) <= MOST_RATIO,
                )
                for name in ("velocity_ticks", "position_ticks")
            ),
        ):
            if not holds:
                value = getattr(self, field)
                raise ValueError(f"interface.{field} is {value}; it must be {allowed}")
        self._check_estimator()

    def _check_estimator(self) -> None:
        """Raise ValueError for an unknown estimator, or one that is not set to what it takes."""
        if self.velocity_estimator not in ESTIMATORS:
            raise ValueError(
                f"interface.velocity_estimator is {self.velocity_estimator!r};"
                f" {nearest(self.velocity_estimator, list(ESTIMATORS))}"
            )
        taken = self.estimator.settings
        for setting in ("window", "band", "noise", "acceleration"):
            field, value = f"velocity_{setting}", getattr(self, f"velocity_{setting}")
            allowed = "> 0 and finite"
            if setting not in taken:
                allowed, holds = "0", value == 0.0
            elif setting == "window":
                allowed = f"a whole number from 2 to {MOST_WINDOW}"
                holds = _whole(value) and 2 <= value <= MOST_WINDOW
            elif setting in self.estimator.may_be_zero:
                allowed, holds = ">= 0 and finite", 0.0 <= value < math.inf
            else:
                holds = 0.0 < value < math.inf
            if not holds:
                raise ValueError(
                    f"interface.{field} is {value}; with velocity_estimator"
                    f" {self.velocity_estimator!r} it must be {allowed}"
                )

    @property
    def estimator(self) -> Estimator:
        """The estimator of velocity."""
        return ESTIMATORS[self.velocity_estimator]

    @property
    def estimator_settings(self) -> Settings:
        """The settings of the estimator."""
        return Settings(
            self.velocity_period, int(self.velocity_window), self.velocity_band,
            self.velocity_noise, self.velocity_acceleration,
        )  # fmt: skip

    @property
    def delay_ticks(self) -> tuple[int, float]:
        """Return (whole periods d, remaining time [s]) with delay = d T + remainder, 0 <= r < T.

        A remainder within 1e-9 T of a whole period is rounding of decimal input, not a delay.
        """
        whole = math.floor(self.delay / self.period + 1e-9)
        remainder = self.delay - whole * self.period
        return whole, remainder if remainder > 1e-9 * self.period else 0.0

    @property
    def multirate(self) -> bool:
        """Whether position or velocity is renewed less often than once per period."""
        return self.velocity_ticks > 1 or self.position_ticks > 1

    @property
    def velocity_period(self) -> float:
        """Time from one velocity estimate to the next [s]."""
        return self.velocity_ticks * self.period

    @property
    def second_order(self) -> bool:
        """Whether the velocity filter has two states."""
        return self.velocity_order == 2 and math.isfinite(self.velocity_cutoff_hz)

    @property
    def velocity_filter(self) -> tuple[float, float, float, float]:
        """The weights (a, b, c, d) of the velocity filter.

        With e the estimate (by default the backward difference) minus the last v, and r the slope
        of v times its period T,

            v_k = v_{k-1} + a e + b r_{k-1},    r_k = c e + d r_{k-1}.

        First order: a = 1 - exp(-w T), w = 2 pi f, the rest 0. Second order: Butterworth,
        v'' = w^2 (u - v) - sqrt(2) w v', exact for a difference u that is held.
        """
        period = self.velocity_period
        if not self.second_order:
            decay = math.exp(-2.0 * math.pi * self.velocity_cutoff_hz * period)
            return 1.0 - decay, 0.0, 0.0, 0.0
        w = 2.0 * math.pi * self.velocity_cutoff_hz * period
        s = w / math.sqrt(2.0)
        decay, cosine, sine = math.exp(-s), math.cos(s), math.sin(s)
        b = decay * sine / s
        return 1.0 - decay * (cosine + sine), b, w * w * b, decay * (cosine - sine)

    @property
    def velocity_smoothing(self) -> float:
        """Weight a of the velocity filter, 1 without one: see `velocity_filter`."""
        return self.velocity_filter[0]

    @property
    def linear(self) -> bool:
        """Whether nothing in the interface is nonlinear."""
        steps = self.encoder_step, self.command_step, self.velocity_step
        return (
            not any(steps) and math.isinf(self.command_limit) and self.estimator.linear is not None
        )


def _whole(value: float) -> bool:
    return float(value).is_integer()


DIFFERENCE_ALONE = {
    "velocity_estimator": "difference", "velocity_window": 0, "velocity_band": 0.0,
    "velocity_noise": 0.0, "velocity_acceleration": 0.0,
}  # fmt: skip
"""The fields of an interface whose estimator is the backward difference."""


INTERFACE_FIELDS = tuple(field.name for field in fields(Interface))
