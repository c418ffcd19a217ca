"""The joint uncertainty of an answer's parameters, for the device file.

The other free values of a fit (origins, the skew and jitter of the clock, differences between
recordings) are integrated out. Parameters covary: if the scale of the command is free, masses and
forces scatter with it. A parameter without influence is left out.
"""

from dataclasses import replace

import numpy as np

from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.fitting.uncertainty import covariance
from zwidth.diagnosis.model.parameters import Parameter, nominal_of
from zwidth.sim.device import Device, home, place_label
from zwidth.sim.named import numbers_of_device
from zwidth.sim.posterior import Posterior

DIGITS = 6


def with_posterior(device: Device, final: Fitted) -> Device:
    """Return the device of a fit with the joint posterior of its parameters, or without one."""
    known = numbers_of_device(device)
    spread = covariance(final)
    ways: dict[str, np.ndarray] = {}
    for i, p in enumerate(final.model.parameters):
        if not np.isfinite(spread[i, i]) or (name := _name(final, p)) not in known:
            continue
        way = ways.setdefault(name, np.zeros(final.x.size))
        way[i] += p.slope(nominal_of(final.model, p), float(final.x[i]))
    names = list(ways)
    slopes = np.array([ways[name] for name in names]).reshape(len(names), final.x.size)
    used = np.any(slopes != 0.0, axis=0)
    cov = slopes[:, used] @ spread[np.ix_(used, used)] @ slopes[:, used].T
    sd = np.sqrt(np.diag(cov))
    kept = np.flatnonzero(np.isfinite(sd) & (sd > 0.0))
    if not kept.size:
        return replace(device, posterior=None)
    told = np.round(cov[np.ix_(kept, kept)] / np.outer(sd[kept], sd[kept]), DIGITS)
    told = 0.5 * (told + told.T)
    np.fill_diagonal(told, 1.0)
    posterior = Posterior(
        tuple(names[k] for k in kept), tuple(sd[kept].tolist()), tuple(map(tuple, told.tolist()))
    )
    return replace(device, posterior=posterior)


def _name(final: Fitted, p: Parameter) -> str:
    """The name of a parameter in the device, "" for a parameter of the recording."""
    if p.kind == "gain":
        return "interface.command_gain"
    if p.kind != "effect":
        return p.name if p.kind in ("mass", "damper", "spring", "link", "k0") else ""
    physics = final.model.effects[p.index]
    if physics.effect.in_interface is not None:
        return f"interface.{physics.effect.in_interface}"
    return "k0" if home(physics) is not None else f"{place_label(physics)}.{p.key}"
