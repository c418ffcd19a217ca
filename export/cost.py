"""How much of a device's motion an export loses: the same command through both."""

from typing import NamedTuple

from zwidth.export.compiled import compiler, run_c
from zwidth.export.model import Exported, command_for, free_run, loss
from zwidth.sim.device import Device


class Cost(NamedTuple):
    """share: rms error over rms motion, None where nothing could be run; said: a sentence."""

    share: float | None
    said: str


def cost_of(
    exported: Exported, device: Device, to: str, name: str, seconds: float, seed: int
) -> Cost:
    """Run a device and its export under the same multisine and compare what is measured.

    Raises ValueError where the compiler refuses a C file.
    """
    commands = command_for(device, seconds)
    ours = free_run(device, commands, seed)
    if to == "c" and compiler() is None:
        return Cost(None, "Not measured: there is no C compiler here; install one, or set CC.")
    theirs = run_c(exported.text(), name, commands)
    return _said(loss(ours, theirs), "compiled and run", seconds)


def _said(share: float, how: str, seconds: float) -> Cost:
    return Cost(
        share,
        f"Measured, {how} beside zwidth under the same multisine of {seconds:g} s: rms error"
        f" {100.0 * share:.3g} % of the rms motion.",
    )
