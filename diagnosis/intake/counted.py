"""Velocities that are differences of encoder counts: converted back to the position.

    v_k = a v_(k-1) + (1 - a) c_k s / T, where c_k are whole numbers, s is the encoder's step, and a
    = 0 means unfiltered.

Used as a velocity with white noise, such a channel has little information: its error is that of a
differenced position, so its information about slow motion is lost. But (v_k - a v_(k-1)) T / (1 -
a) s is whole in every sample, which does not happen by chance. So s and a are found to all digits,
and the sum of c_k is the encoder's reading, exact except for its start.

The step is that of the device file or of the values themselves. The filter's a is the ratio v_k /
v_(k-1) while the encoder stands still, or, if the step is known, the a for which all c_k are whole.
A velocity that a drive measures by its own clock, or rounds to steps of a velocity, is not a
difference of a position. So a step that is not in the device file must have errors that alternate
from sample to sample, like differences of a position.

Limits: such a position has an unknown origin in every recording. For two masses the difference of
the origins is a constant stretch of their link, which two constant forces would also cause; it
becomes a parameter (`open_zeros`). Filters of higher order, and means, are not converted back.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from zwidth.diagnosis.intake.gate import encoder_step_seen, merged
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.settings import INTAKE
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
FEW = 400  # samples from which a filter is found
FILTERS = 1.0 - np.geomspace(1e-3, 0.99, 700)  # dense enough to separate whole numbers
STANDS = 0.03  # share of the samples that must show the filter of a still encoder
ALIKE = 1e-6  # relative difference of equal ratios
WRITTEN = 1e-3  # of the range: most by which values of the same count differ
MOST = 1e5  # counts per sample: more leave no digit for a whole number
SMOOTHED = (9, 3)  # samples and order of the smoothing that gives the motion
FAST = 50.0  # counts per sample, above which motion hides whether errors alternate
STILL = 0.5  # share of samples without a count, above which the motion is too slow
FEWEST = 3.0  # counts by which any sample may stand out
ALONE = 10.0  # rms errors, beyond which a sample is a fault


@dataclass(frozen=True)
class Counted:
    """A position counted in steps, and the filter of the velocity from which it was found.

    known: whether the device file's step confirms the counts. turned, size: sums of products of
    neighbouring errors, and of squared errors.
    """

    position: Floats
    step: float
    feedback: float
    known: bool
    turned: float
    size: float

    def cutoff_hz(self, period: float) -> float:
        """Return the cut-off frequency of the filter, infinite for none."""
        if self.feedback == 0.0:
            return float("inf")
        return float(-np.log(self.feedback) / (2.0 * np.pi * period))


def as_counted(device: Device, experiments: Sequence[Experiment]) -> list[Experiment]:
    """Return recordings with the counted positions in place of velocities computed from them.

    Notes list the converted channels. A velocity must be convertible in all recordings. Several
    recordings are only converted if nothing in the device depends on position, since each would
    have its own origin.
    """
    if not experiments or (len(experiments) > 1 and _placed(device)):
        return list(experiments)
    first = experiments[0].outputs
    found: dict[Output, list[Counted]] = {}
    for o in first:
        if o.quantity != "velocity" or Output("position", o.mass) in first:
            continue
        if not all(e.outputs == first for e in experiments):
            continue
        each = [_counted(device, e, o) for e in experiments]
        kept = [c for c in each if c is not None]
        if len(kept) == len(each) and _alike([c.step for c in kept]) and _turning(kept):
            found[o] = kept
    return [_with(e, {o: each[i] for o, each in found.items()}) for i, e in enumerate(experiments)]


def open_zeros(device: Device, experiments: Sequence[Experiment]) -> Device:
    """Return the device with free zeros of sensors if positions were counted.

    The initial stretch of a link is assumed to be about as large as later.
    """
    apart = [device.uncertainty.zeros]
    for e in experiments:
        at = [k for k, o in enumerate(e.outputs) if o.tells_position]
        if any(e.outputs[k] in e.differenced for k in at[1:]):
            apart += list(np.std(e.measured[:, at[1:]] - e.measured[:, at[:1]], axis=0))
    zeros = float(max(apart))
    return replace(device, uncertainty=replace(device.uncertainty, zeros=zeros))


def _with(e: Experiment, counted: dict[Output, Counted]) -> Experiment:
    if not counted:
        return e
    measured = e.measured.copy()
    notes: list[str] = []
    outputs = list(e.outputs)
    differenced = dict(e.differenced)
    for o, c in counted.items():
        place = outputs.index(o)
        measured[:, place] = c.position
        outputs[place] = Output("position", o.mass)
        differenced[outputs[place]] = c.feedback
        filtered = f", low-passed at {c.cutoff_hz(e.period):.3g} Hz" if c.feedback else ""
        notes.append(
            f"{o.name} of {e.name} is what an encoder of {c.step:.4g} counts from sample to sample"
            f"{filtered}: it is taken as the position that was counted"
        )
    swing = float(np.std(measured[:, 0]))
    return replace(
        e, measured=measured, outputs=tuple(outputs), swing=swing, notes=(*e.notes, *notes),
        differenced=differenced,
    )  # fmt: skip


def _placed(device: Device) -> bool:
    """Whether the motion of a device depends on its position as a whole."""
    forces = (p for p in device.physics if p.effect.hook in ("force", "sensor"))
    return device.chain.ground_spring != 0.0 or any(forces)


def _alike(steps: Sequence[float]) -> bool:
    return max(steps) < 1.001 * min(steps)


def _counted(device: Device, e: Experiment, output: Output) -> Counted | None:
    v = e.measured[:, e.outputs.index(output)]
    stated = device.interface.encoder_step / e.period
    feedback = _where_it_stands(v)
    tries = [(stated, 0.0)] if stated > 0.0 else []
    seen = encoder_step_seen(v)
    if seen is not None:
        tries.append((seen, 0.0))
    if feedback is not None:
        seen = encoder_step_seen(merged(_unfiltered(v, feedback), WRITTEN))
        tries += [(s, feedback) for s in (stated, seen) if s is not None and s > 0.0]
    elif stated > 0.0 and (found := _filter_of(v, stated)) is not None:
        tries.append((stated, found))
    for unit, a in tries:
        counts = _unfiltered(v, a)[1:] / unit
        whole = np.round(counts)
        # A wrong count would be a permanent step of the position.
        if (
            np.abs(whole).max() > MOST
            or np.abs(counts - whole).max() > INTAKE.whole
            or _spiked(whole)
        ):
            continue
        # A tachometer with noise above its rounding has few samples without a count.
        tells = np.abs(whole).max() > FAST or float(np.mean(whole == 0.0)) > STILL
        vouched = stated > 0.0 and _alike([unit, stated]) and tells
        if np.gcd.reduce(whole.astype(np.int64)) == 1:
            step = unit * e.period
            reading = np.concatenate([[0.0], np.cumsum(whole)])  # the origin is unknown
            error = whole - savgol_filter(whole, *SMOOTHED)
            turned, size = float(error[1:] @ error[:-1]), float(error @ error)
            return Counted(step * reading, step, a, vouched, turned, size)
        if a == 0.0:  # already whole, so a filter by halves would fit too
            return None
    return None


def _unfiltered(v: Floats, feedback: float) -> Floats:
    before = np.concatenate([v[:1], v[:-1]])
    return (v - feedback * before) / (1.0 - feedback)


def _where_it_stands(v: Floats) -> float | None:
    """The ratio that neighbouring samples have repeatedly, None for none."""
    large = np.abs(v[:-1]) > 1e-3 * np.abs(v).max()
    ratios = np.sort(v[1:][large] / v[:-1][large])
    ratios = ratios[(ratios > 1.0 - FILTERS.max()) & (ratios < FILTERS.max())]
    count = max(10, round(STANDS * v.size))
    if ratios.size <= count:
        return None
    widths = ratios[count:] - ratios[:-count]
    best = int(np.argmin(widths))
    if widths[best] > ALIKE * ratios[best]:
        return None
    return float(np.median(ratios[best : best + count + 1]))


def _filter_of(v: Floats, unit: float) -> float | None:
    """The filter coefficient for which velocities are whole counts, None for none."""
    few = v[: FEW + 1] if v.size <= FEW + 1 else v[(v.size - FEW) // 2 :][: FEW + 1]
    counts = (few[1:] - np.outer(FILTERS, few[:-1])) / ((1.0 - FILTERS[:, None]) * unit)
    off = np.mean(np.abs(counts - np.round(counts)), axis=1)
    a = float(FILTERS[int(np.argmin(off))])
    for _ in range(5):
        now, before = few[1:], few[:-1]
        whole = unit * np.round((now - a * before) / ((1.0 - a) * unit))
        size = float(np.sum((before - whole) ** 2))
        if not size > 0.0:
            return None
        a = float(np.sum((now - whole) * (before - whole))) / size
        if not 0.0 < a < 1.0:
            return None
    return a


def _spiked(counts: Floats) -> bool:
    """Whether a sample differs from its neighbours more than a motion can."""
    error = np.abs(counts - savgol_filter(counts, *SMOOTHED))
    return float(error.max()) > max(FEWEST, ALONE * float(np.sqrt(np.mean(error**2))))


def _turning(each: Sequence[Counted]) -> bool:
    """Whether errors of all recordings alternate as in a differenced position."""
    told = [c for c in each if not c.known]
    size = sum(c.size for c in told)
    return not told or (size > 0.0 and sum(c.turned for c in told) / size < INTAKE.turning)
