"""A fleet of simulated devices with known faults, each recorded several times.

A joint of one mass with a return spring, viscous and dry friction, recorded for some seconds at
100 Hz under a random force. Its load (a known value) adds to the inertia, its dry friction differs
from device to device, all else is shared. Some recordings have one of five kinds of fault, and the
dry friction of one device drifts from a date on. All of it follows from a seed.
"""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import tomli_w
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.files.whole import write_text
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_to_text
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]
PERIOD, RMS, HELD = 0.01, 0.4, 5  # s; N m; samples that a force is held
INERTIA, DAMPING, SPRING, DRY = 0.01, 0.02, 0.5, 0.05
PER_LOAD = 2e-3  # kg m2 per kg
DISTURBANCE, SENSOR_NOISE = 2e-3, 2e-4
OWN_FRICTION = 0.1  # of the dry friction, by which devices differ (standard deviation)
DRIFTS_TO = 1.8  # times the dry friction at the last date
SIZES = {
    "other_unit": 180.0 / np.pi,  # degrees for radians
    "slipped_clamp": 0.35,  # rad
    "stale_sensor": 4.0,  # times that a reading is passed on
    "other_spring": 2.0,  # times the return spring
}
KINDS = ("inverted_sign", "other_unit", "slipped_clamp", "stale_sensor", "other_spring")
BEGIN = date(2026, 1, 5)
WEEK = 7


@dataclass(frozen=True)
class Truth:
    """The truth: kind of fault by recording; the drifting device, and when its drift began."""

    faults: Mapping[str, str]
    drifting: str
    since: date


def nominal() -> Device:
    """Return the device as its user knows it: rough linear parameters."""
    chain = make_chain(np.array([0.011]), np.array([0.03]), 0.45, np.zeros(0), np.zeros(0))
    return Device("joint", "a joint of a fleet", True, chain, Interface(period=PERIOD))


def make_fleet(
    folder: Path, devices: int, runs: int, faults: int, seed: int = 0, seconds: float = 6.0
) -> Truth:
    """Write a fleet of recordings with its table fleet.csv and device.toml, and return the truth.

    faults: how many devices have a fault, of the kinds in turn: in one of their recordings, or
    (another spring) from the first to the last. Raises ValueError if there are too few devices.
    """
    if devices < faults + 2:
        raise ValueError(
            f"devices is {devices}; it must be at least two more than faults ({faults})"
        )
    random = np.random.default_rng(seed)
    names = [f"d{d:03}" for d in range(devices)]
    order = random.permutation(devices)
    faulty = {int(d): KINDS[k % len(KINDS)] for k, d in enumerate(order[:faults])}
    drifting = int(order[faults])
    begins = runs // 3
    dry = DRY * (1.0 + OWN_FRICTION * random.standard_normal(devices))
    table = io.StringIO()
    table.write("recording,device,date,load [kg]\n")
    known: dict[str, str] = {}
    for d, name in enumerate(names):
        at = int(random.integers(runs))
        for run in range(runs):
            stem = f"{name}/r{run:02}"
            fault = faulty.get(d, "")
            if fault != "other_spring" and run != at:
                fault = ""
            if fault:
                known[stem] = fault
            grown = max(0, run - begins) / max(1, runs - 1 - begins) if d == drifting else 0.0
            level = float(dry[d]) * (1.0 + (DRIFTS_TO - 1.0) * grown)
            load = float(random.uniform(0.0, 2.0))
            record(folder / stem, random, level, load, fault, seconds)
            table.write(f"{stem}.toml,{name},{_day(run)},{load:.4f}\n")
    write_text(folder / "fleet.csv", table.getvalue(), own=True)
    write_text(folder / "device.toml", device_to_text(nominal()), own=True)
    return Truth(known, names[drifting], _day(begins))


def _day(run: int) -> date:
    return BEGIN + timedelta(days=WEEK * run)


def record(
    stem: Path,
    random: np.random.Generator,
    level: float,
    load: float,
    fault: str = "",
    seconds: float = 6.0,
    size: float | None = None,
) -> None:
    """Write a recording STEM.csv with its STEM.toml; size: of the fault, None for the usual one.

    level: dry friction [N m]; load [kg]. The size is a factor of the angle (other_unit), of the
    spring (other_spring), radians (slipped_clamp), or samples (stale_sensor).
    """
    size = SIZES.get(fault, 0.0) if size is None else size
    ticks = round(seconds / PERIOD)
    held = random.standard_normal(ticks // HELD + 1)
    command = RMS * np.repeat(held, HELD)[:ticks]
    spring = SPRING * (size if fault == "other_spring" else 1.0)
    masses = np.array([INERTIA + PER_LOAD * load])
    chain = make_chain(masses, np.array([DAMPING]), spring, np.zeros(0), np.zeros(0))
    friction = make_physics("coulomb_friction", "m1", level=level)
    device = Device("truth", "", True, chain, Interface(period=PERIOD)).with_physics(friction)
    pushed = DISTURBANCE * random.standard_normal(ticks)
    ran = simulate(device, recorded(command), duration=seconds, disturbance=pushed, substeps=20)
    position = ran.trace["position_m1"] + SENSOR_NOISE * random.standard_normal(ticks)
    position = _faulty(position, fault, random, size)
    text = io.StringIO()
    text.write("torque,angle\n")
    np.savetxt(text, np.column_stack([command, position]), "%.10g", ",")
    write_text(stem.with_suffix(".csv"), text.getvalue(), own=True)
    top = {
        "file": f"{stem.name}.csv", "rotary": True, "period_s": PERIOD,
        "input": {"signal": "torque"},
        "output": [{"signal": "angle", "quantity": "position", "at": "m1"}],
    }  # fmt: skip
    write_text(stem.with_suffix(".toml"), tomli_w.dumps(top), own=True)


def _faulty(position: Floats, fault: str, random: np.random.Generator, size: float) -> Floats:
    at = int(random.uniform(0.3, 0.7) * position.size)
    if fault == "inverted_sign":
        return -position
    if fault == "other_unit":
        return size * position
    if fault == "slipped_clamp":
        return position + size * (np.arange(position.size) >= at)
    if fault == "stale_sensor":  # a reading is passed on several times
        times = round(size)
        return np.repeat(position[::times], times)[: position.size]
    return position
