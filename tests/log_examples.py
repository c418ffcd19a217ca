"""Small runs to write into logs, and what must be true of whatever comes back."""

from pathlib import Path

import numpy as np

from zwidth.logs.events import Event
from zwidth.logs.mcap_reader import Log
from zwidth.logs.mcap_writer import LogWriter
from zwidth.sim.trace import Floats, Trace

EPOCH = 1_763_000_000_123_456_789
UNITS = {"position_m1": "rad", "velocity_m1": "rad/s", "command": "N m", "contact": ""}
METADATA = {"version": "0.1.0", "K": "14.98", "B": "0.03"}
ATTACHMENTS = {"device.toml": b'name = "one mass"\n', "propagators.npy": bytes(range(256))}
FACTS = {"device": "one mass", "substeps": 4}
EVENTS = (Event(0.0105, "contact", "m1", 0.25), Event(0.0325, "saturated", "command", -1.0))


def example(samples: int, seed: int = 0) -> Trace:
    """Return a run of full mantissas, with a channel that is often zero."""
    rng = np.random.default_rng(seed)
    channels = {name: rng.normal(size=samples) for name in UNITS}
    channels["contact"] = (rng.random(samples) < 0.5).astype(np.float64)
    return Trace(np.arange(samples, dtype=np.float64) * 0.001, channels, UNITS, "simulated", FACTS)


def write_blocks(path: Path, trace: Trace, block: int) -> None:
    """Write a run as the engine does: block after block, then what became known at its end."""
    with LogWriter(
        path, UNITS, metadata=METADATA, attachments=ATTACHMENTS, epoch_ns=EPOCH, facts=FACTS
    ) as log:
        for first in range(0, len(trace), block):
            part = slice(first, first + block)
            log.append(trace.t[part], {n: v[part] for n, v in trace.channels.items()})
        log.events(EVENTS)
        log.note({"verdict": "decays"})


def bits(values: Floats) -> list[int]:
    """Return doubles as integers, so that NaN equals NaN and 0.0 differs from -0.0."""
    return np.ascontiguousarray(values).view(np.int64).tolist()


def assert_same(found: Trace, expected: Trace) -> None:
    """Fail unless times, channels (in order), units and origin are equal bit for bit."""
    assert list(found.channels) == list(expected.channels)
    assert dict(found.units) == {name: expected.units[name] for name in expected.channels}
    assert found.origin == expected.origin
    assert bits(found.t) == bits(expected.t)
    for name, values in expected.channels.items():
        assert bits(found[name]) == bits(values), name


def assert_only_true(log: Log, expected: Trace) -> None:
    """Fail if the log holds one sample, event, note or attachment that was never written."""
    rows = np.searchsorted(expected.t, log.tick.t)
    kept = {name: values[rows] for name, values in expected.channels.items()}
    assert_same(log.tick, expected.with_channels(kept, expected.t[rows]))
    assert set(log.events) <= set(EVENTS)
    assert log.metadata.items() <= (METADATA | {"verdict": "decays"}).items()
    assert log.attachments.items() <= ATTACHMENTS.items()
    facts = {key: value for key, value in log.tick.facts.items() if key != "warnings"}
    assert facts.items() <= FACTS.items()
