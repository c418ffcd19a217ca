"""A drive as its data sheet has it, brought to what a device already knows.

A winding of resistance R and inductance L, a motor constant k_t, a back-EMF k_e and a gear of ratio
g between motor and m1, on the supply U:

    L di/dt = u - R i - g k_e w,    force at m1 = g k_t i,    |u| <= U,

with w the speed of m1. Once the current has settled, i = (u - g k_e w) / R, so that a voltage is

    a gain g k_t / R,    a damper g^2 k_t k_e / R at m1,    a limit g k_t U / R of the force

that the command asks for (the damper acts beyond it: the limit falls with speed), and a lag L / R.
A current loop is the gain g k_t, a lag 1 / (2 pi f) of its bandwidth f and a limit g k_t I, without
a damper. A duty is a voltage of duty times U.

A servo closes a loop on the position of m1 over a voltage: u = k_p (goal - q) - k_d w, |u| <= U.
Its command is the goal, in the unit of the position, and it is

    a stiffness g k_t k_p / R and a damping g k_t k_d / R within the limit g k_t U / R,

with the damper of the back-EMF beyond it, which is the servo's here (`position_servo`). A position
drive is the same with stiffness, damping and limit given as forces: a current loop's, or a spring
whose other end is moved.

Limits: the lag is put on the command alone; with L the back-EMF lags as well, which changes the
damper by w L / R at the frequency w.
"""

import math
from dataclasses import dataclass
from typing import Literal

from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

Kind = Literal["voltage", "current", "duty", "servo", "position"]
KINDS: tuple[Kind, ...] = ("voltage", "current", "duty", "servo", "position")
NEEDED = {
    "voltage": ("motor_constant", "resistance_ohm"),
    "current": ("motor_constant",),
    "duty": ("motor_constant", "resistance_ohm", "supply_v"),
    "servo": ("motor_constant", "resistance_ohm", "supply_v", "proportional"),
    "position": ("stiffness",),
}
POSSIBLE = {
    "voltage": ("back_emf", "gear", "inductance_h", "supply_v"),
    "current": ("gear", "bandwidth_hz", "limit_a"),
    "duty": ("back_emf", "gear", "inductance_h"),
    "servo": ("back_emf", "gear", "derivative"),
    "position": ("damping", "limit"),
}


@dataclass(frozen=True)
class Drive:
    """What a command is and how it becomes a force at m1.

    motor_constant k_t [N m/A | N/A], resistance_ohm R, back_emf k_e [V s/rad | V s/m], by default
    k_t (which it is in SI), gear g, turns of the motor (or its travel) over those of m1,
    inductance_h L, supply_v U, bandwidth_hz f of a current loop, limit_a I of its current. Of a
    servo's loop proportional k_p [V/rad | V/m] and derivative k_d [V s/rad | V s/m]; of a position
    drive stiffness, damping and limit in force a position, a speed and as such.

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
    stiffness: float = math.nan
    damping: float = 0.0
    limit: float = math.inf

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"drive.kind is {self.kind!r}; allowed is {', '.join(KINDS)}")
        for name in NEEDED[self.kind]:
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"drive.{name} is {value:g}; allowed is a finite number above 0")
        for name in ("gear", "supply_v", "bandwidth_hz", "limit_a", "limit"):
            if not (value := getattr(self, name)) > 0.0:
                raise ValueError(f"drive.{name} is {value:g}; allowed is a number above 0")
        for name in ("inductance_h", "derivative", "damping"):
            if not 0.0 <= (value := getattr(self, name)) < math.inf:
                raise ValueError(f"drive.{name} is {value:g}; allowed is >= 0 and finite")
        if self.back_emf < 0.0 or math.isinf(self.back_emf):
            raise ValueError(f"drive.back_emf is {self.back_emf:g}; allowed is >= 0 and finite")

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
        """What the back-EMF is to m1."""
        if self.kind in ("current", "position"):
            return 0.0
        back = self.motor_constant if math.isnan(self.back_emf) else self.back_emf
        return self.gear**2 * self.motor_constant * back / self.resistance_ohm

    @property
    def most(self) -> float:
        """Largest force that a command asks for."""
        if self.kind == "position":
            return self.limit
        if self.kind == "servo":
            return self.gain * self.supply_v / self.proportional
        return self.gain * {"voltage": self.supply_v, "current": self.limit_a}.get(self.kind, 1.0)

    @property
    def loop(self) -> tuple[Physics, ...]:
        """The loop on the position of m1, of the kinds that have one."""
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
        if math.isinf(self.most):
            return (servo,)
        return servo, make_physics("servo_limit", "m1", limit=self.most)

    @property
    def lag(self) -> float:
        """Time constant [s] of the force."""
        if self.loop:
            return 0.0
        if self.kind == "current":
            return 1.0 / (2.0 * math.pi * self.bandwidth_hz)
        return self.inductance_h / self.resistance_ohm

    def on(self, device: Device) -> Device:
        """Return a device with this drive; a limit of its own stays where it is lower."""
        driven = device.with_interface(command_gain=device.interface.command_gain * self.gain)
        if self.loop:
            return driven.with_physics(*self.loop)
        dampers = device.chain.ground_dampers.copy()
        dampers[0] += self.damper
        driven = driven.with_chain(device.chain._replace(ground_dampers=dampers)).with_interface(
            command_limit=min(device.interface.command_limit, self.most)
        )
        if self.lag > 0.0:
            driven = driven.with_physics(
                make_physics("actuator_lag", "command", time_constant=self.lag)
            )
        return driven
