"""The result of an identification: a device, and the fit that it comes from."""

from dataclasses import dataclass

from zwidth.identification.fit import Fit
from zwidth.shown import Shown
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.modal import to_chain


@dataclass(frozen=True, repr=False)
class Identified(Shown):
    """A device fitted to a recording; `device` is like any other, and `save_device` writes it.

    fit: intervals and covariance of its parameters, the measured response and the model's.
    """

    device: Device
    fit: Fit


def identified(fit: Fit, name: str, unit: str, source: str, channel: str) -> Identified:
    """Return the device of a fit. unit: of the measured position, given by its channel.

    Raises ValueError if that is not a position in rad or m.
    """
    if unit not in ("rad", "m"):
        raise ValueError(f"channel {channel!r} is in {unit!r}; a position in rad or m is needed")
    device = Device(
        name,
        source,
        unit == "rad",
        to_chain(fit.model),
        Interface(period=fit.response.windows.period, delay=max(0.0, fit.delay)),
        modal=fit.model,
    )
    return Identified(device, fit)
