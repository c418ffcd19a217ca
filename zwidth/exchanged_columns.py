"""Corrects a guess that exchanged the columns of command and motion.

A header may name its columns in the wrong order. The numbers are checked with one mass fitted
according to the names, m a + b v = u (`diagnosis.intake.swapped` needs no better model). If they
contradict the names, the two signals are exchanged in the description, and each entry keeps its
unit.
"""

import tomllib
import warnings
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import tomli_w
from scipy.signal import savgol_filter

from zwidth.diagnosis.compiled import compiled
from zwidth.diagnosis.intake.swapped import EXCHANGED, in_place
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import stretches
from zwidth.logs.assumed import Assumed
from zwidth.logs.recording import read_source
from zwidth.logs.recording_file import description_of
from zwidth.logs.source import Source
from zwidth.logs.stretches import longest_stretch
from zwidth.logs.timing import examine
from zwidth.logs.units import GOAL
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.trace import Trace

MOTION = "position_m1"
SMOOTHED = 9  # samples over which speed and acceleration are computed
LEAST = 0.1  # least mass, over the rms force divided by the rms acceleration
SLOWEST = 1e-6  # least damper, over the mass divided by a sample period


def in_their_places(guess: Assumed, source: Source) -> Assumed:
    """Return a guess, with command and position exchanged if the numbers show it."""
    said = tomllib.loads(guess.text)
    outputs = said["output"]
    if "input" not in said or len(outputs) != 1 or outputs[0]["quantity"] != "position":
        return guess
    with suppress(ValueError, NoObserver), warnings.catch_warnings():  # else the names are kept
        warnings.simplefilter("ignore", RuntimeWarning)  # of numpy, if a fit diverges
        if not _moves_the_other_way(guess.text, source):
            return guess
        command, position = said["input"]["signal"], outputs[0]["signal"]
        doubt = (
            f"{command} moves like a mass and {position} jumps like a command: the two columns are"
            " exchanged against their names, each in the unit of its place"
        )
        text = _exchanged(guess.text, command, position)
        roles = [
            (role, _renamed(what, command, position)) if role in ("command", "position") else
            (role, what)
            for role, what in guess.roles
        ]  # fmt: skip
        return replace(guess, text=text, roles=roles, doubts=[doubt, *guess.doubts])
    return guess


def _moves_the_other_way(text: str, source: Source) -> bool:
    trace = read_source(description_of(text.encode(), Path("guess.recording.toml")), source)
    if trace.units.get("command") in GOAL or MOTION not in trace.channels:
        return False
    device = _one_mass(trace)
    parts = stretches(trace, device)
    compiled()  # before the first simulation for a file of another tool
    longest = max(parts, key=lambda e: e.ticks)
    return any(fault.kind == EXCHANGED for fault in in_place(device, longest)[1])


def _one_mass(trace: Trace) -> Device:
    """Return the mass and the damper of a recording by least squares.

    Raises ValueError if it is too short.
    """
    used, _ = longest_stretch(trace, ("command", MOTION), "the recording")
    period = examine(used.t).period
    if len(used) < 3 * SMOOTHED or period <= 0.0:
        raise ValueError("the recording is too short")
    speed, acceleration = (
        np.asarray(savgol_filter(used[MOTION], SMOOTHED, 3, deriv=d, delta=period)) for d in (1, 2)
    )
    rows = np.column_stack([acceleration, speed, np.ones_like(speed)])
    mass, damper, _ = np.linalg.lstsq(rows, used["command"], rcond=None)[0].tolist()
    rough = float(np.std(used["command"])) / (float(np.std(acceleration)) or 1.0)
    mass = mass if mass > LEAST * rough else rough
    chain = make_chain([mass], [max(damper, SLOWEST * mass / period)])
    interface = Interface(period=float(f"{period:.9g}"))
    return Device("one mass", "", trace.units[MOTION] == "rad", chain, interface)


def _exchanged(text: str, one: str, other: str) -> str:
    lines = {_line(one): _line(other), _line(other): _line(one)}
    found: list[str] = []
    for line in text.split("\n"):
        old = next((key for key in lines if line == key or line.startswith(f"{key} #")), None)
        found.append(line if old is None else lines[old] + line[len(old) :])
    return "\n".join(found)


def _line(signal: str) -> str:
    return tomli_w.dumps({"signal": signal}).strip()


def _renamed(what: str, one: str, other: str) -> str:
    for old, new in ((one, other), (other, one)):
        if what.startswith(f"{old} ["):
            return new + what[len(old) :]
    return what
