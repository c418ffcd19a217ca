"""A signal over time: simulated and recorded ones are the same type."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Shown

Floats = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class Trace(Shown):
    """Sampled channels on one time axis.

    t: times [s], shape (samples,). channels: name -> array of shape (samples,), SI units. units:
    name -> unit ("rad", "rad/s", "N m", "J", "s", "" for none). A name is ``quantity_place``
    without a unit, e.g. ``position_m1``, ``velocity_m1``, ``encoder``, ``velocity_estimate``,
    ``command``, ``applied``, ``contact``, ``stored_energy``. facts: the origin of the trace
    (device, scenario, conversions, warnings).

    Raises ValueError if a channel's length or unit is missing or differs from ``t``.
    """

    t: Floats
    channels: Mapping[str, Floats]
    units: Mapping[str, str]
    origin: Literal["simulated", "recorded"]
    facts: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for name, values in self.channels.items():
            if values.shape != self.t.shape:
                raise ValueError(
                    f"channel {name!r} has shape {values.shape}, but the time axis has"
                    f" {self.t.shape}: give every channel one value for each time"
                )
            if name not in self.units:
                raise ValueError(f"channel {name!r} has no unit: add it to units ('' for none)")

    def __getitem__(self, name: str) -> Floats:
        try:
            return self.channels[name]
        except KeyError:
            raise KeyError(f"no channel {name!r}; there are {', '.join(self.channels)}") from None

    def __len__(self) -> int:
        return self.t.shape[0]

    def between(self, start: float, stop: float) -> "Trace":
        """Return the samples with start <= t < stop [s]."""
        keep = (self.t >= start) & (self.t < stop)
        return self.with_channels({k: v[keep] for k, v in self.channels.items()}, self.t[keep])

    def with_channels(self, channels: Mapping[str, Floats], t: Floats | None = None) -> "Trace":
        """Return the same recording with other samples, keeping units, origin and facts."""
        axis = self.t if t is None else t
        return Trace(axis, dict(channels), self.units, self.origin, self.facts)
