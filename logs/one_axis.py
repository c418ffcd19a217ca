"""Brings the streams of a recording, each with its own clock, onto one time axis."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from zwidth.logs.drive_state import STATES
from zwidth.logs.recording_file import Entry
from zwidth.logs.resampling import axis, forward_only, held, interpolated
from zwidth.logs.source import Floats, RecordingError
from zwidth.logs.timing import Timing, examine


@dataclass(frozen=True)
class Stream:
    """The channels that share their stamps. t (samples,) [s]."""

    t: Floats
    timing: Timing
    entries: tuple[Entry, ...]
    counted: bool

    @property
    def name(self) -> str:
        """The channels, in words."""
        return ", ".join(entry.channel for entry in self.entries)


def group(entries: Sequence[Entry], t: dict[str, Floats]) -> list[Stream]:
    """Group channels with equal stamps, in the order of the TOML."""
    groups: list[list[Entry]] = []
    for entry in entries:
        for group in groups:
            if np.array_equal(t[group[0].channel], t[entry.channel]):
                group.append(entry)
                break
        else:
            groups.append([entry])
    return [
        Stream(t[g[0].channel], examine(t[g[0].channel]), tuple(g), g[0].clock.period is not None)
        for g in groups
    ]


def one_axis(
    resample: float | None, streams: list[Stream], values: dict[str, Floats]
) -> tuple[Floats, dict[str, Floats], dict[str, Any]]:
    """Return one time axis, the channels on it, and a description of the conversion."""
    if resample is None:
        if len(streams) > 1:
            raise _apart(streams)
        return streams[0].t, values, {}
    period = resample or max(stream.timing.period for stream in streams)
    if period == 0.0:
        raise RecordingError("resample = true finds no period in the stamps; give it in seconds")
    later = {stream.name: forward_only(stream.t) for stream in streams}
    try:
        starts = [float(stream.t[later[stream.name]][0]) for stream in streams]
        stops = [float(stream.t[later[stream.name]][-1]) for stream in streams]
        t = axis(starts, stops, period)
    except ValueError as error:
        raise RecordingError(str(error)) from None
    resampled: dict[str, Floats] = {}
    for stream in streams:
        keep = later[stream.name]
        own_t = stream.t[keep]
        for entry in stream.entries:
            own = values[entry.channel][keep]
            state = entry.quantity in ("command", *STATES)
            resampled[entry.channel] = (
                held(t, own_t, own, period) if state else interpolated(t, own_t, own)
            )
    return t, resampled, _resampling(period, streams, later, t.size)


def _resampling(
    period: float, streams: list[Stream], later: dict[str, Any], samples: int
) -> dict[str, Any]:
    first = streams[0].timing.start
    return {
        "period_s": period,
        "samples": samples,
        "command": "held, its mean over each tick where the axis is coarser",
        "outputs": "linear interpolation",
        "streams": {
            stream.name: {
                "samples": stream.timing.samples,
                "period_s": stream.timing.period,
                "offset_s": stream.timing.start - first,
                "left_out": int((~later[stream.name]).sum()),
            }
            for stream in streams
        },
    }


def _apart(streams: list[Stream]) -> RecordingError:
    """A sentence on the difference between the first two streams."""
    one, other = streams[:2]
    period = max(stream.timing.period for stream in streams)
    described = " and ".join(
        f"{s.name} {s.timing.samples} samples at {s.timing.rate:.6g} Hz" for s in (one, other)
    )
    offset = other.timing.start - one.timing.start
    return RecordingError(
        f"one trace has one time axis, and there are {described}, starting {offset:.6g} s apart;"
        f" add resample = true (period {period:.6g} s) or resample = PERIOD"
    )
