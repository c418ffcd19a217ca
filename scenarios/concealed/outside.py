"""Physics that no effect of the library describes, for recordings that nothing known explains."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

OUTSIDE: Mapping[str, tuple[str, tuple[str, ...]]] = MappingProxyType(
    {
        "swaying_stiffness": ("a link's stiffness swings with time", ("share", "frequency_hz")),
        "swinging_inertia": ("m1's inertia depends on its position", ("share", "period")),
        "cubic_drag": ("drag that grows with the cube of speed", ("coefficient",)),
        "warming_dampers": ("dampers that change as the device warms", ("share", "time_constant")),
        "hum": ("a force periodic in time", ("amplitude", "frequency_hz", "phase")),
        "hard_stop": ("a stop that the motion runs into", ("position", "stiffness", "damping")),
        "detent": ("narrow magnetic notches in position", ("amplitude", "period", "sharpness")),
        "sagging_drive": ("a drive that weakens by what it gave", ("loss", "time_constant")),
    }
)
"""Name -> (what it is, its parameters, SI)."""

MAGNITUDE = MappingProxyType(
    {
        "swaying_stiffness": "share",
        "swinging_inertia": "share",
        "cubic_drag": "coefficient",
        "warming_dampers": "share",
        "hum": "amplitude",
        "detent": "amplitude",
        "sagging_drive": "loss",
    }
)
"""The parameter that the effect's strength grows with; the others have none."""


@dataclass(frozen=True)
class Outside:
    """One such effect with its parameters; raises ValueError for a name or parameter unknown."""

    name: str
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        if self.name not in OUTSIDE:
            raise ValueError(f"there is no effect {self.name!r}; there are {', '.join(OUTSIDE)}")
        needed = OUTSIDE[self.name][1]
        if tuple(self.values) != needed:
            raise ValueError(
                f"{self.name} has the parameters {', '.join(self.values)}; it needs, in this order,"
                f" {', '.join(needed)}"
            )
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))
