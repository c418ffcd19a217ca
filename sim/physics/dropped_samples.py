"""The commands of some ticks are not delivered; the one before is held.

Tick k is dropped where hash(seed, k) < rate: a counter-based generator, so a tick's fate depends on
nothing but the run's seed and k, and a run that is resumed anywhere continues identically. The hash
is a double pass of MurmurHash3's 32-bit finaliser (Appleby), keyed anew between the passes, in
products below 2^64, which no integer type rounds or wraps; it repeats after 2^32 ticks (49 days at
1 kHz).
"""

from collections.abc import Iterator

import numpy as np

from zwidth.sim.jit import part
from zwidth.sim.lane_type import first_lane, negated
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place


def _starts(_: Sizes, __: Place) -> Iterator[Scaled]:
    yield {"rate": 1e-3}, {}


def _sweep(_: Sizes, __: Place) -> Iterator[Scaled]:
    for rate in up_to(0.1):  # of more, a loop would not be called one
        yield {"rate": rate}, {}


def _natural(_: Sizes, __: Place) -> float:
    return 1.0


def _drawn(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    return {"rate": 1e-3}


def _at_share(_: np.random.Generator, __: Sizes, ___: Place, share: float) -> Values:
    return {"rate": 0.2 * share}


dropped_samples = Effect(
    name="dropped_samples",
    summary="some commands are lost at random",
    formula="force of a tick = that of the tick before, with probability rate",
    places=("clock",),
    parameters=(
        Parameter(
            "rate",
            "p_d",
            "",
            0.0,
            1.0,
            0.0,
            role="strength",
            meaning="share of the commands that are lost",
        ),
    ),
    hook="clock",
    code=1,
    mistaken_for=("loop_delay",),
    reference="counter-based: Salmon et al., Proc. SC11, 2011",
    borrows=("seed",),
    prior=0.01,  # a network or a desktop system in the loop, and seldom there
    creased=True,
    sought="lattice",
    in_recording=True,
    starts=_starts,
    sweep=_sweep,
    natural=_natural,
    drawn=_drawn,
    odds=0.4,
    at_share=_at_share,
)

_WORD = np.uint64(0xFFFFFFFF)
_FIRST = np.uint64(0x85EBCA6B)
_SECOND = np.uint64(0xC2B2AE35)
_KEY = np.uint64(0x9E3779B9)
_13, _16 = np.uint64(13), np.uint64(16)


@part
def scrambled(word):
    """Return a bijection of 32-bit words whose every output bit depends on every input bit."""
    word = ((word ^ (word >> _16)) * _FIRST) & _WORD
    word = ((word ^ (word >> _13)) * _SECOND) & _WORD
    return word ^ (word >> _16)


@part
def uniform(seed_low, seed_high, tick):
    """Return a number in [0, 1) for a tick of a run; the seed as two words of 32 bits."""
    first = scrambled(np.uint64(seed_low) ^ _KEY)
    second = scrambled(first ^ np.uint64(seed_high))
    third = scrambled(second ^ (np.uint64(tick) & _WORD))
    return scrambled((third + first) & _WORD) * 2.3283064365386963e-10


@part
def is_delivered(tick, p):
    """Whether the command of this tick is delivered; p: rate, the two words of the seed."""
    return negated(uniform(first_lane(p[1]), first_lane(p[2]), tick) < p[0])
