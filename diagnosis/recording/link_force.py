"""Converts the force in a link, measured by a load cell, into the link's deflection.

A load cell between two masses is a spring of known stiffness K, so its reading

    F = K (q_i - q_j)    gives    q_i - q_j = F / K,

gives the deflection of the link, which contains nothing about the position of the device, and much
about the parts on either side of the cell. K is the stiffness of the link in the device file. A
cell is calibrated, so K is assumed to be known well; a wrong K gives a deflection with a wrong
scale.

Limits: a cell without a damper, whose force is only that of its spring.
"""

import re

from zwidth.sim.device import Device
from zwidth.sim.trace import Trace

LINK_FORCE = re.compile(r"force_(link([1-4])([2-5]))$")


def told_by_links(trace: Trace, device: Device, name: str) -> tuple[Trace, tuple[str, ...]]:
    """Return a trace with the deflections from forces in links, and notes on them.

    A force is not converted if the device lacks the link, or beside a measured deflection.
    """
    channels, units = dict(trace.channels), dict(trace.units)
    said: list[str] = []
    springs = device.chain.link_springs
    for channel in trace.channels:
        match = LINK_FORCE.match(channel)
        if match is None or int(match[3]) != int(match[2]) + 1 or int(match[2]) > springs.size:
            continue
        deflection = f"position_{match[1]}"
        if deflection in channels:
            continue
        stiffness = float(springs[int(match[2]) - 1])
        channels[deflection] = trace[channel] / stiffness
        units[deflection] = "rad" if device.rotary else "m"
        unit = "N m/rad" if device.rotary else "N/m"
        said.append(
            f"{channel} of {name} is taken as the deflection of {match[1]}, with the"
            f" {stiffness:.6g} {unit} of the device file"
        )
    if not said:
        return trace, ()
    return Trace(trace.t, channels, units, trace.origin, trace.facts), tuple(said)
