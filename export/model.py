"""An export: its text, what it does not contain, and how large an error that causes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.excitation import multisine
from zwidth.controllers.recorded import recorded
from zwidth.sim.device import Device, place_label
from zwidth.sim.equations import enough_substeps
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]
SUBSTEPS = 4  # per tick, if forces or friction act within it
SECONDS = 2.0


@dataclass(frozen=True)
class Exported:
    """A device in another format.

    body: the file without the comment at its head; about: the beginning of that comment; lost: a
    sentence for each part of the device that the format lacks; held: the device that the file does
    describe; opening, closing: of a comment.
    """

    body: str
    about: tuple[str, ...]
    lost: tuple[str, ...]
    held: Device
    opening: str = "<!--"
    closing: str = "-->"

    def text(self, cost: str = "") -> str:
        """Return the file's text; cost: a sentence on how well it matches the device."""
        lines = [*self.about, "", "Not held here:"]
        lines += [f"  - {line}" for line in self.lost or ("nothing",)]
        if cost:
            lines += ["", cost]
        # a comment must not contain its own end
        said = "\n".join(lines).replace("--", "- -").replace("*/", "* /")
        return f"{self.opening}\n{said}\n{self.closing}\n{self.body}"

    def content(self, cost: str = "") -> bytes:
        """Return the bytes of the file."""
        return self.text(cost).encode()


def label_of(physics: Physics) -> str:
    """Return the label of an effect: "backlash@link12"."""
    return place_label(physics)


def substeps_for(device: Device) -> int:
    """Return the number of substeps per tick of a device's export."""
    within = any(p.effect.hook in ("force", "friction") for p in device.physics)
    return enough_substeps(device, SUBSTEPS if within else 1)


def free_run(device: Device, commands: Floats, seed: int = 0) -> Floats:
    """Return the encoder's readings at each tick of a run under commands (ticks,)."""
    run = simulate(
        device, recorded(commands), duration=commands.size * device.interface.period,
        substeps=substeps_for(device), seed=seed,
    )  # fmt: skip
    return run.trace["encoder"]


def loss(ours: Floats, theirs: Floats) -> float:
    """Return the rms difference over the rms motion about its mean; inf if theirs is not finite.

    Without any motion of ours the result is 0 if they are equal, else inf.
    """
    if ours.shape != theirs.shape or not np.all(np.isfinite(theirs)):
        return float("inf")
    error = float(np.sqrt(np.mean((theirs - ours) ** 2)))
    motion = float(np.std(ours))
    if motion == 0.0:
        return 0.0 if error == 0.0 else float("inf")
    return error / motion


def amplitude(device: Device) -> float:
    """Return an rms command that moves a device: above its dry friction, within its limits.

    It is three times the dry friction, else the force that moves the device by about one unit in
    the time. Raises nothing.
    """
    held = 0.0
    for p in device.physics:
        if p.effect.hook == "friction":
            levels = [v for q, v in zip(p.effect.parameters, p.vector(), strict=True)
                      if q.unit == "N m" and np.isfinite(v)]  # fmt: skip
            held += max(levels, default=0.0)
    mass = float(device.chain.masses.sum())
    free = mass * (2.0 * np.pi) ** 2 * 0.5
    wanted = max(3.0 * held, free)
    limit = device.interface.command_limit
    return float(min(wanted, 0.5 * limit)) if np.isfinite(limit) else float(wanted)


def command_for(device: Device, seconds: float = SECONDS) -> Floats:
    """Return the command (ticks,) with which an export is compared: a multisine."""
    period = device.interface.period
    top = min(20.0, 0.2 / period)
    return multisine(
        amplitude(device) / device.interface.command_gain, duration=seconds, period=period,
        from_hz=0.5, to_hz=top, seed=1,
    )  # fmt: skip
