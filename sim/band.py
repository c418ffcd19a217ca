"""How large the errors of a device's free runs are while the device still describes its machine."""

import math
from dataclasses import dataclass

from zwidth.shown import Valued


@dataclass(frozen=True)
class OutputBand(Valued):
    """Free runs of one output over windows, on data that were not fitted.

    name: of the output, "position_m1"; error, noise, motion [unit of the output]: rms error of free
    runs, rms error one step ahead, and rms of the measurement about the mean of each window.
    scatter: standard deviation of the mean squares of the windows, over their mean.

    Raises ValueError with a sentence that names the field, the value and what is allowed.
    """

    name: str
    error: float
    noise: float
    motion: float
    scatter: float

    def __post_init__(self) -> None:
        for field in ("error", "noise", "motion", "scatter"):
            value = getattr(self, field)
            if not 0.0 <= value < math.inf:
                raise ValueError(
                    f"band.output.{field} of {self.name} is {value}; it must be a finite number of"
                    " 0 or more"
                )


@dataclass(frozen=True)
class Band(Valued):
    """Errors that a diagnosis measured, with which `zwidth check` compares later runs.

    window [s]: length of a free run; windows: their number; ratio: of the observer in whose state
    each starts (`diagnosis.noise.predictor.Observer`). corrected: kinds of the faults that were
    corrected in the recordings, which need not be reported for later ones. simulator: the simulator
    whose errors these are, with its version ("MuJoCo 4.0.0"); "" for the device itself.

    Raises ValueError with a sentence that names the field, the value and what is allowed.
    """

    window: float
    windows: int
    ratio: float
    outputs: tuple[OutputBand, ...]
    corrected: tuple[str, ...] = ()
    simulator: str = ""

    def __post_init__(self) -> None:
        for field, value in (("window_s", self.window), ("observer_ratio", self.ratio)):
            if not 0.0 < value < math.inf:
                raise ValueError(f"band.{field} is {value}; it must be a finite number above 0")
        if not 2 <= self.windows < math.inf or self.windows % 1:
            raise ValueError(
                f"band.windows is {self.windows}; it must be a whole number of 2 or more"
            )
        if not self.outputs:
            raise ValueError("band has no [[band.output]]; give one, or leave [band] out")
