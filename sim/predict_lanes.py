"""A group of members along one recording: innovations, and what whitening leaves of them.

The recording goes through in pieces, so that nothing of the size of members x ticks is kept unless
asked for. A piece of innovations is whitened by each member's own filters,

    w_k = sum over j of W_j e_(k-j),

and of w only the count and the sum of w w' are kept, from which every cost follows.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

import numpy as np

from zwidth.sim.group import lane_equations, lane_memory, lane_scratch
from zwidth.sim.jit import jit, part
from zwidth.sim.lane_type import as_lanes
from zwidth.sim.predict import Reading, Saved, predicted

PIECE = 512  # ticks: the innovations of eight members then stay in the nearest cache


@part
def whiten(innovations, first, count, filters, white):
    """Fill white (o,) rows from innovations (earlier + ticks, o); filters (o, o, order + 1)."""
    outputs, taps = filters.shape[0], filters.shape[2]
    for k in range(count):
        for a in range(outputs):
            total = 0.0
            for b in range(outputs):
                for j in range(taps):
                    total += filters[a, b, j] * innovations[first + k - j, b]
            white[k, a] = total


@part
def run_pieces(
    eq, fine, outputs, commands, measured, reading, gain, external, memory, scratch, fine_scratch,
    saved, filters, skipped, innovations, white, moments, kept,
):  # fmt: skip
    """Predict a recording; fill moments (o, o), the sum of w w' after the skipped ticks.

    innovations (order + PIECE, o) and white (PIECE, o) are working space; kept (ticks, o) takes all
    innovations, or is (0, o).
    """
    ticks, o = commands.size, outputs.state.size
    earlier = filters.shape[2] - 1
    for k in range(earlier):
        for a in range(o):
            innovations[k, a] = 0.0
    for first in range(0, ticks, PIECE):
        last = min(first + PIECE, ticks)
        count = last - first
        some = Reading(
            reading.gain, reading.origin, reading.jitter,
            reading.arriving[first:last] if reading.arriving.size > 0 else reading.arriving,
        )  # fmt: skip
        for k in range(count):
            for a in range(o):
                innovations[earlier + k, a] = np.inf
        predicted(
            eq, fine, outputs, commands[first:last], measured[first:last], some, gain,
            external[first:last] if external.shape[0] > 0 else external, memory, scratch,
            fine_scratch, saved, innovations[earlier:],
        )  # fmt: skip
        if kept.shape[0] > 0:
            for k in range(count):
                for a in range(o):
                    kept[first + k, a] = innovations[earlier + k, a]
        whiten(innovations, earlier, count, filters, white)
        for k in range(max(0, skipped - first), count):
            for a in range(o):
                for b in range(o):
                    moments[a, b] += white[k, a] * white[k, b]
        for k in range(earlier):
            for a in range(o):
                innovations[k, a] = innovations[count + k, a]


@jit
def predict_lanes(
    eq, fine, outputs, commands, measured, reading, gain, external, memory, scratch, fine_scratch,
    saved, filters, skipped, innovations, white, moments, kept,
):  # fmt: skip
    """Run `run_pieces` for a group; every array of numbers has a last axis of lanes.

    Those that are not: commands, measured, external and what is arriving, of the recording.
    """
    run_pieces(
        lane_equations(eq), lane_equations(fine), outputs, commands, measured,
        Reading(
            as_lanes(reading.gain), as_lanes(reading.origin), as_lanes(reading.jitter),
            reading.arriving,
        ),
        as_lanes(gain), external, lane_memory(memory), lane_scratch(scratch),
        lane_scratch(fine_scratch),
        Saved(
            as_lanes(saved.x), as_lanes(saved.internal), as_lanes(saved.coarse_x),
            as_lanes(saved.coarse_internal),
        ),
        as_lanes(filters), skipped, as_lanes(innovations), as_lanes(white), as_lanes(moments),
        as_lanes(kept),
    )  # fmt: skip


@jit
def predict_alone(
    eq, fine, outputs, commands, measured, reading, gain, external, memory, scratch, fine_scratch,
    saved, filters, skipped, innovations, white, moments, kept,
):  # fmt: skip
    """Run `run_pieces` for one device."""
    run_pieces(
        eq, fine, outputs, commands, measured, reading, gain, external, memory, scratch,
        fine_scratch, saved, filters, skipped, innovations, white, moments, kept,
    )  # fmt: skip
