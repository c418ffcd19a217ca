"""A drive, described by its data sheet, in terms of what a device already contains.

A winding of resistance R and inductance L, a motor constant k_t, a back-EMF k_e and a gear of ratio
g between motor and m1, with the supply U:

    L di/dt = u - R i - g k_e w,    force at m1 = g k_t i,    |u| <= U,

with w the speed of m1. Once the current has settled, i = (u - g k_e w) / R, so that a voltage is

    a gain g k_t / R,    a damper g^2 k_t k_e / R at m1,    a limit g k_t U / R of the force

demanded by the command (the damper acts as well, so the limit falls with speed), and a lag L / R. A
current loop is the gain g k_t, a lag 1 / (2 pi f) of its bandwidth f and a limit g k_t I, without a
damper; if a supply is given, its force is also limited to g k_t U / R - g^2 k_t k_e w / R, which
falls with speed (`falling_limit`). A duty is a voltage of duty times U.

A servo closes a loop on the position of m1 over a voltage: u = k_p (goal - q) - k_d w, |u| <= U.
Its command is the goal, in the unit of the position, and it is

    a stiffness g k_t k_p / R and a damping g k_t k_d / R within the limit g k_t U / R,

and the damper of the back-EMF beyond this limit, which is part of the effect here
(`position_servo`). An integral gain k_i adds k_i times the integral of the error to u, limited to
some voltage (`servo_integral`), and the speed at which the goal is followed may be limited
(`goal_rate_limit`). A position drive is the same with stiffness, damping and limit given as forces:
of a current loop, or of a spring whose other end is moved.

Limits: only the command lags; with L the back-EMF lags as well, which changes the damper by w L / R
at the frequency w.

A drive that is switched off, according to a recording, gives no force. If its winding is shorted
then, the back-EMF still brakes; if it is open, it does not (`open_winding`).
"""

import math
from dataclasses import dataclass
from typing import Literal

from zwidth.sim.device import Device
from zwidth.sim.nearest import nearest
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

Kind = Literal["voltage", "current", "duty", "servo", "position"]
WhenOff = Literal["shorted", "open"]
WAYS: tuple[WhenOff, ...] = ("shorted", "open")
KINDS: tuple[Kind, ...] = ("voltage", "current", "duty", "servo", "position")
NEEDED = {
    "voltage": ("motor_constant", "resistance_ohm"),
    "current": ("motor_constant",),
    "duty": ("motor_constant", "resistance_ohm", "supply_v"),
    "servo": ("motor_constant", "resistance_ohm", "supply_v", "proportional"),
    "position": ("stiffness",),
}
POSSIBLE = {
    "voltage": ("back_emf", "gear", "inductance_h", "supply_v", "when_off"),
    "current": ("gear", "bandwidth_hz", "limit_a", "supply_v", "resistance_ohm", "back_emf"),
    "duty": ("back_emf", "gear", "inductance_h", "when_off"),
    "servo": (
        "back_emf",
        "gear",
        "derivative",
        "integral",
        "integral_limit_v",
        "goal_rate",
        "when_off",
    ),
    "position": ("damping", "limit"),
}


@dataclass(frozen=True)
class Drive:
    """The kind of a command, and how it becomes a force at m1.

    motor_constant k_t [N m/A | N/A], resistance_ohm R, back_emf k_e [V s/rad | V s/m], by default
    k_t (which it is in SI), gear g, turns of the motor (or its travel) over those of m1,
    inductance_h L, supply_v U, bandwidth_hz f of a current loop, limit_a I of its current. Of a
    servo's loop proportional k_p [V/rad | V/m], derivative k_d [V s/rad | V s/m], integral k_i
    [V/(rad s) | V/(m s)] within integral_limit_v [V], and goal_rate [rad/s | m/s], the speed at
    which the goal is followed at most. when_off: state of the winding while the drive is off. Of a
    position drive: stiffness (force per position), damping (force per speed), limit (a force).

    Raises ValueError for a number that is not allowed.
    """

    kind: Kind
    motor_constant: float = math.nan
    resistance_ohm: float = math.nan
    back_emf: float = math.nan
    gear: float = 1.0
    inductance_h: float = 0.0
    supply_v: float = math.inf
    bandwidth_hz: float = math.inf
    limit_a: float = math.inf
    proportional: float = math.nan
    derivative: float = 0.0
    integral: float = 0.0
    integral_limit_v: float = math.inf
    goal_rate: float = math.inf
    when_off: WhenOff = "shorted"
    stiffness: float = math.nan
    damping: float = 0.0
    limit: float = math.inf

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"drive.kind is {self.kind!r}; it must be one of {', '.join(KINDS)}")
        for name in NEEDED[self.kind]:
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"drive.{name} is {value:g}; it must be a finite number above 0")
        for name in (
            "gear", "supply_v", "bandwidth_hz", "limit_a", "limit", "integral_limit_v", "goal_rate",
        ):  # fmt: skip
            if not (value := getattr(self, name)) > 0.0:
                raise ValueError(f"drive.{name} is {value:g}; it must be a number above 0")
        for name in ("inductance_h", "derivative", "damping", "integral"):
            if not 0.0 <= (value := getattr(self, name)) < math.inf:
                raise ValueError(f"drive.{name} is {value:g}; it must be >= 0 and finite")
        if self.back_emf < 0.0 or math.isinf(self.back_emf):
            raise ValueError(f"drive.back_emf is {self.back_emf:g}; it must be >= 0 and finite")
        if self.when_off not in WAYS:
            raise ValueError(f"drive.when_off is {self.when_off!r}; {nearest(self.when_off, WAYS)}")
        if self.kind == "current" and math.isfinite(self.supply_v) != (self.resistance_ohm > 0.0):
            raise ValueError(
                "drive.supply_v and drive.resistance_ohm together determine how the limit of a"
                " current falls with speed; give both, or neither"
            )

    @property
    def gain(self) -> float:
        """Force at m1 per unit of the command, at rest."""
        if self.kind == "position":
            return self.stiffness
        own = self.gear * self.motor_constant
        if self.kind == "current":
            return own
        volts = {"duty": self.supply_v, "servo": self.proportional}.get(self.kind, 1.0)
        return own * volts / self.resistance_ohm

    @property
    def damper(self) -> float:
        """The damper at m1 by which the back-EMF acts."""
        return 0.0 if self.kind in ("current", "position") else self._back

    @property
    def _back(self) -> float:
        back = self.motor_constant if math.isnan(self.back_emf) else self.back_emf
        return self.gear**2 * self.motor_constant * back / self.resistance_ohm

    @property
    def most(self) -> float:
        """Largest force that a command can demand."""
        if self.kind == "position":
            return self.limit
        if self.kind == "servo":
            return self.gain * self.supply_v / self.proportional
        return self.gain * {"voltage": self.supply_v, "current": self.limit_a}.get(self.kind, 1.0)

    @property
    def loop(self) -> tuple[Physics, ...]:
        """The loop on the position of m1, for kinds that have one."""
        if self.kind not in ("servo", "position"):
            return ()
        inside = (
            self.damping
            if self.kind == "position"
            else (self.gain * self.derivative / self.proportional)
        )
        servo = make_physics(
            "position_servo", "m1", stiffness=self.gain, damping=inside, back_emf=self.damper
        )
        found = [servo]
        if math.isfinite(self.most):
            found.append(make_physics("servo_limit", "m1", limit=self.most))
        if self.integral > 0.0:
            volts = min(self.integral_limit_v, self.supply_v)
            rate, most = self.integral / self.proportional, self.gain * volts / self.proportional
            found.append(make_physics("servo_integral", "m1", rate=rate, limit=most))
        if math.isfinite(self.goal_rate):
            found.append(make_physics("goal_rate_limit", "command", rate=self.goal_rate))
        return tuple(found)

    @property
    def when_switched(self) -> tuple[Physics, ...]:
        """The damping that a drive loses while it is off."""
        lost = self.when_off == "open" and self.damper > 0.0
        return (make_physics("open_winding", "m1", damping=self.damper),) if lost else ()

    @property
    def lag(self) -> float:
        """Time constant [s] of the force."""
        if self.loop:
            return 0.0
        if self.kind == "current":
            return 1.0 / (2.0 * math.pi * self.bandwidth_hz)
        return self.inductance_h / self.resistance_ohm

    def on(self, device: Device) -> Device:
        """Return a device with this drive; a lower command limit of the device itself is kept."""
        driven = device.with_interface(command_gain=device.interface.command_gain * self.gain)
        if self.loop:
            return driven.with_physics(*self.loop, *self.when_switched)
        dampers = device.chain.ground_dampers.copy()
        dampers[0] += self.damper
        driven = driven.with_chain(device.chain._replace(ground_dampers=dampers)).with_interface(
            command_limit=min(device.interface.command_limit, self.most)
        )
        driven = driven.with_physics(*self.when_switched)
        if self.kind == "current" and math.isfinite(self.supply_v):
            most = self.gain * self.supply_v / self.resistance_ohm
            driven = driven.with_physics(
                make_physics("falling_limit", "m1", limit=most, slope=self._back)
            )
        if self.lag > 0.0:
            driven = driven.with_physics(
                make_physics("actuator_lag", "command", time_constant=self.lag)
            )
        return driven
