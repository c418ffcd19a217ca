# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
"""A tick of the kernel for one external command: the source that is translated into C."""

from zwidth.sim.jit import part
from zwidth.sim.kernel import amplify, arrives, fed_back, placed, read_position, substep
from zwidth.sim.lane_type import select


@part
def reading(eq, x):
    """The present reading of the encoder."""
    return read_position(eq, x[eq.read])


@part
def sent(eq, tick, x, command, before):
    """The command sent to the amplifier at this tick."""
    told = amplify(eq, fed_back(eq, x, command), before, False)
    return select(arrives(eq, tick), told, before)


@part
def moved(eq, tick, segment, held, external, memory, scratch):
    """Move through a segment of the tick under a held command."""
    step = 0
    for _ in range(eq.substeps[segment]):
        substep(eq, tick, segment, step, held, 1.0, external, memory, scratch)
        placed(eq, memory.x, scratch.own)
        step += 1  # noqa: SIM113, a loop in C has no name for it
