"""How a run at a wall ends; only this module decides it.

rests     comes to rest, or decays towards it
dithers   oscillates on, kept up by the steps of encoder or command alone, and too weakly to be felt
felt      the same, and a hand feels it
grows     grows, without bound or until the amplifier's limit holds it, or settles on an oscillation
          that steps alone cannot keep up (that of play, of friction, of the limit)
undecided none of these yet when the time is up

A wall is stable unless it grows. An upper bound on the amplitude separates dither from growth. A
step of the encoder or of the command is an error e of at most half a step, |e| <= D/2, added to the
reading. In a loop that is stable without it, such an error can sustain an oscillation but not let
it grow. Its largest amplitude, in first harmonics (describing function), is

    y = -T_c e,  T_c = L / (1 + L),   |e|_1 <= (4/pi) D/2,   so   A <= (2/pi) D max_w |T_c(w)|

the last because no signal within +-D/2 has a larger first harmonic than the square wave, whatever
its phase. The usual gain N(A) of a quantiser (`stability/describing.py`) approaches 1 faster, as
(D/A)^1.5; but it assumes samples at all phases of the cycle, and a cycle of a whole number of ticks
has only a few phases. So the bound is for the worst case, |N - 1| <= (2/pi) D/A. With S = 1 / (1 +
L) = det(z - open) / det(z - closed) it is 1 - S at the angles of the poles.

In addition, up to `FEW` steps are dither on any wall: there |N - 1| <= 0.02, the quantiser is a
gain of one within 2 % and a delay within 0.02 rad, and a larger oscillation has another cause. This
covers well damped walls, whose higher harmonics the first harmonic neglects, and walls that
friction stabilises beyond the linear boundary. For a velocity in steps, the amplitude of the speed,
2 pi f A, is compared with `FEW` of its steps alone.

Because of steps, an oscillation may be irregular: it has no constant amplitude, and no lasting
trend. At the end of the longest run it counts as lasting, even if it seems to grow, as long as it
is below the start or a few steps. For steps of command and velocity this requires that the linear
loop is not known to be unstable; if it is, an apparent rise is undecided. A remaining decrease is
undecided, too: the run rests or dithers.

Limits: half the range of m1's position is compared, even if the encoder is on another mass; the
linear loop contains no friction, play or other physics; for a loop of several rates, or with an
estimator of velocity that is not linear, only `FEW` counts. Gelb & Vander Velde, Multiple-Input
Describing Functions, 1968, has the gains.
"""

import enum
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.device import Device
from zwidth.sim.growth import DECAYS, GROWS, LIMIT_CYCLE, UNDECIDED, Growth
from zwidth.sim.loop import MOST_TICKS, open_loop
from zwidth.sim.perception import Perception

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]
WITHIN = 0.02  # distance from 1 of the quantiser's gain, from FEW steps on
FEW = 2.0 / (math.pi * WITHIN)  # steps, 32
LARGEST = 1e6  # steps: larger amplitudes need no bound
DRIFTS = 5.0  # steps up to which a trend does not count
RISES = 2.0  # standard errors of a growth rate from which an unstable loop may be growing
AT_THE_LIMIT, MOST_OF_IT = 0.999, 0.9  # shares of the command's limit: peak, half range
REST_OF_START, REST_OF_STEP = 1e-3, 0.02


class Fate(enum.IntEnum):
    """What a run does in the end."""

    RESTS = 0
    DITHERS = 1
    FELT = 2
    GROWS = 3
    UNDECIDED = 4

    @property
    def word(self) -> str:
        """The word that tables and files use."""
        return self.name.lower()


class Dither(NamedTuple):
    """Oscillations that steps sustain at walls (n,).

    steps: amplitude, in steps, up to which an oscillation is the quantiser's own; holds, grows:
    whether the loop without steps is known to be stable, or unstable.
    """

    steps: Floats
    holds: Flags
    grows: Flags

    @classmethod
    def unknown(cls, walls: int, steps: float = FEW) -> "Dither":
        """Return the dither of walls whose linear loop is not known."""
        return cls(np.full(walls, steps), np.zeros(walls, dtype=bool), np.zeros(walls, dtype=bool))


class Conditions(NamedTuple):
    """The properties of walls and devices that decide the fates of runs (runs,).

    devices, which: those of the runs; stiffness [N m/rad | N/m], damping [N m s/rad | N s/m]: of
    their walls; start: amplitudes at t = 0; rest: amplitudes up to which an oscillation counts as
    rest; dither: what steps sustain there, None for `dither_of`.
    """

    devices: Sequence[Device]
    which: Indices
    stiffness: Floats
    damping: Floats
    start: Floats
    rest: Floats
    one_sided: bool = False
    dither: Dither | None = None

    def of_interface(self, field: str) -> Floats:
        """Return a number of the interface, one per run."""
        values = [float(getattr(device.interface, field)) for device in self.devices]
        return np.array(values)[self.which]

    def dither_of(self, asked: Flags) -> Dither:
        """Return the amplitude that steps sustain for the selected runs, `FEW` for the others."""
        if self.dither is not None:
            return self.dither
        found = Dither.unknown(self.which.size)
        for i, device in enumerate(self.devices):
            some = np.flatnonzero(asked & (self.which == i))
            if some.size:
                own = dither_of(device, self.stiffness[some], self.damping[some])
                for all_runs, of_some in zip(found, own, strict=True):
                    all_runs[some] = of_some
        return found


def rest_amplitude(device: Device, start: float) -> float:
    """Return the amplitude below which a run counts as at rest: 1e-3 of its start, 0.02 steps."""
    step = device.interface.encoder_step
    rest = REST_OF_START * abs(start)
    return min(rest, REST_OF_STEP * step) if step > 0.0 else rest


def fates_of(
    growth: Growth, conditions: Conditions, limit_s: float, perception: Perception
) -> NDArray[np.int8]:
    """Return the `Fate` of each run (runs,).

    limit_s [s]: the longest time a run may continue. The command of a one-sided wall reaches the
    limit on one side only.
    """
    encoder_step = conditions.of_interface("encoder_step")
    command_step = conditions.of_interface("command_step")
    velocity_step = np.where(
        conditions.damping == 0.0, 0.0, conditions.of_interface("velocity_step")
    )  # an undamped wall does not use the velocity
    limit = conditions.of_interface("command_limit")
    swing = (0.5 if conditions.one_sided else 1.0) * limit
    stepped = (encoder_step > 0.0) | (command_step > 0.0) | (velocity_step > 0.0)
    verdict = growth.verdict
    with np.errstate(invalid="ignore"):
        resting = growth.amplitude <= conditions.rest
        falling = growth.rate * limit_s < -1.0
    restless = stepped & (verdict == DECAYS) & ~resting
    drifting = drifts(growth, conditions.start, encoder_step)
    doubtful = drifts(growth, 0.0, 0.0, command_step, velocity_step) & ~drifting
    rising = (verdict == UNDECIDED) & (growth.rate > RISES * growth.error)
    rising &= growth.amplitude > np.maximum(conditions.start, DRIFTS * encoder_step)
    irregular = (verdict == UNDECIDED) | drifting | doubtful
    irregular |= restless & ~falling
    lasting = (verdict == LIMIT_CYCLE) | (stepped & irregular)
    few = FEW if conditions.dither is None else conditions.dither.steps
    small = lasting & _small(growth, few, encoder_step, command_step, velocity_step)
    asked = conditions.dither_of((lasting & ~small) | doubtful | rising)
    small |= lasting & _small(growth, asked.steps, encoder_step, command_step, velocity_step)
    dither = small & ~((doubtful | rising) & asked.grows)
    felt = perception.feels(growth, conditions.devices[0].rotary)
    fate = np.full(verdict.size, Fate.UNDECIDED, dtype=np.int8)
    fate[(verdict == GROWS) | (verdict == LIMIT_CYCLE)] = Fate.GROWS
    fate[(verdict == DECAYS) & ~restless] = Fate.RESTS
    fate[dither & ~felt] = Fate.DITHERS
    fate[dither & felt] = Fate.FELT
    fate[(verdict == LIMIT_CYCLE) & resting] = Fate.RESTS
    fate[held_growth(growth, limit, swing, limit_s)] = Fate.GROWS
    return fate


def _small(
    growth: Growth, steps: Floats | float, encoder_step: Floats, command_step: Floats,
    velocity_step: Floats,
) -> Flags:  # fmt: skip
    """Whether the amplitude, the command's, or the speed's is within what steps alone keep up."""
    with np.errstate(invalid="ignore"):
        slow = (velocity_step > 0.0) & (_speed(growth) <= np.minimum(steps, FEW) * velocity_step)
        small = growth.amplitude <= steps * encoder_step
        return slow | small | ((command_step > 0.0) & (growth.force <= steps * command_step))


def dither_of(device: Device, stiffness: Floats, damping: Floats) -> Dither:
    """Return what steps sustain; stiffness [N m/rad | N/m], damping [N m s/rad | N s/m], each (n,).

    0 steps for a device without any, `FEW` if the loop is not stable without them.
    """
    face = device.interface
    if not any((face.encoder_step, face.command_step, face.velocity_step)):
        return Dither.unknown(stiffness.size, 0.0)
    found = Dither.unknown(stiffness.size)
    if face.multirate or face.delay_ticks[0] > MOST_TICKS or face.estimator.linear is None:
        return found
    loop = open_loop(device)
    zeros = np.linalg.eigvals(loop.transition).astype(np.complex128)
    closed = np.array(
        [loop.closed(k, b) for k, b in zip(stiffness.tolist(), damping.tolist(), strict=True)]
    )
    for i, poles in enumerate(np.linalg.eigvals(closed).astype(np.complex128)):
        found.holds[i] = np.abs(poles).max() < 1.0
        if found.holds[i]:
            found.steps[i] = max(FEW, min(2.0 / math.pi * _peak(zeros, poles), LARGEST))
    return Dither(found.steps, found.holds, ~found.holds)


def _peak(zeros: NDArray[np.complex128], poles: NDArray[np.complex128]) -> float:
    """Largest |T_c| on the unit circle, taken at the angles of the poles."""
    on_circle = np.exp(1j * np.angle(poles))[:, None]
    with np.errstate(all="ignore"):
        sensitivity = np.prod((on_circle - zeros) / (on_circle - poles), axis=1)
    return float(np.nanmax(np.abs(1.0 - sensitivity)))


def held_growth(growth: Growth, limit: Floats, swing: Floats, limit_s: float) -> Flags:
    """Whether the command reaches its limit at the end: growth that the limit stops.

    swing: half the range of such a command. With an encoder's steps it may reach the limit on one
    side and miss it by a step on the other. Such a cycle may seem to decrease a little while it
    settles.
    """
    with np.errstate(invalid="ignore"):
        falling = (growth.verdict == DECAYS) & (growth.rate * limit_s < -1.0)
        swings = (growth.peak >= AT_THE_LIMIT * limit) & (growth.force >= MOST_OF_IT * swing)
        return swings & ~falling


def drifts(
    growth: Growth, start: Floats | float, encoder_step: Floats | float,
    command_step: Floats | float = 0.0, velocity_step: Floats | float = 0.0,
) -> Flags:  # fmt: skip
    """Whether an apparent growth is below the start or a few steps: irregular, without a trend."""
    with np.errstate(invalid="ignore"):
        low = growth.amplitude < np.maximum(np.abs(start), DRIFTS * np.asarray(encoder_step))
        low |= growth.force < DRIFTS * np.asarray(command_step)
        low |= _speed(growth) < DRIFTS * np.asarray(velocity_step)
    return (growth.verdict == GROWS) & low & np.isfinite(growth.rate)


def _speed(growth: Growth) -> Floats:
    """Amplitude of m1's speed."""
    return 2.0 * math.pi * growth.frequency * growth.amplitude


def settles(rate: Floats, limit_s: float) -> Flags:
    """Whether a growing run has become an oscillation: no trend at the end of the longest run."""
    with np.errstate(invalid="ignore"):
        return np.abs(rate) * limit_s < 1.0
