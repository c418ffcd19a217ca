"""What a planned recording would show, and the commands to record."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from zwidth.api.given import AnyDevice, device_of
from zwidth.api.notebook import counted, telling
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.planning import excitations
from zwidth.planning import plan as planned
from zwidth.planning.asked import check_length, usual_noise
from zwidth.planning.excitations import Scale, scale_for
from zwidth.planning.plan import Plan, better_excitations, most_steps
from zwidth.planning.rehearsal import Noise, rehearse
from zwidth.sim.device import Device

STANDARD = "standard_session"


def excitation(
    device: AnyDevice,
    name: str = STANDARD,
    *,
    seconds: float = 20.0,
    level: float | None = None,
    travel: float | None = None,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Return a command [N m | N] for a recording, one value per sample, shape (ticks,).

    device: a Device, the name of a shipped one, or a device file. name: standard_session,
    small_multisine, large_multisine, two_level_multisine, slow_triangle, random_steps, white_noise
    or chirp. seconds: its length. level: the largest command, by default 90 % of the device's
    limit. travel: the largest travel of m1 [rad | m], by default 1 rad or 0.1 m. seed: of random
    numbers. `recorded` makes a controller of the command.

    Raises ValueError with a sentence for an unknown name, or a time that is too short.
    """
    known = device_of(device)
    scale = scale_for(known, level=level, travel=travel)
    return excitations.excitation(name, known, seconds, scale, seed)


def plan(
    device: AnyDevice,
    excitation: str | NDArray[np.float64] = STANDARD,
    *,
    seconds: float = 20.0,
    noise: float | None = None,
    process_noise: float | None = None,
    level: float | None = None,
    travel: float | None = None,
    seed: int = 0,
    advance: Callable[[str], object] | None = None,
) -> Plan:
    """Predict which effects a recording would show, before you make it.

    The result is, for every effect, the smallest magnitude that the recording would show at five
    sigma after a refit of the known parameters; the pairs of effects that it could not tell apart;
    and the excitations that would.

    device: a Device, the name of a shipped one, or a device file. excitation: a name as in
    `excitation`, or a command of your own (ticks,). seconds: its length. noise: rms of a measured
    position [rad | m], by default the rounding to an encoder step. process_noise: random force at
    m1 [N m | N], by default 0.2 % of the largest command. level, travel, seed: see `excitation`.
    advance: called with the name of each step; without it, a notebook shows the share done.

    Raises ValueError with a sentence, also if the device has no encoder step and noise is None.
    """
    known = device_of(device)
    if not isinstance(excitation, str):
        seconds = len(excitation) * known.interface.period
    check_length(known, seconds)
    scale = scale_for(known, level=level, travel=travel)
    seen = usual_noise(known, scale, noise, process_noise)
    name, command = _command(known, excitation, seconds, scale, seed)
    with telling(None, "planning the recording") as tell:
        advance = advance or counted(tell, most_steps(known))
        rehearsed = rehearse(known, command, seen, seed=seed, name=name)
        try:
            return _planned(known, rehearsed, seen, scale, seed, advance)
        except NoObserver as error:
            raise ValueError(f"{known.name} cannot be observed: {error}") from error


def _planned(
    device: Device, rehearsed: Experiment, seen: Noise, scale: Scale, seed: int,
    advance: Callable[[str], object],
) -> Plan:  # fmt: skip
    found, _ = planned.plan(device, rehearsed, seen, advance)
    return better_excitations(device, found, seen, scale, seed, advance)


def _command(
    device: Device,
    asked: str | NDArray[np.float64],
    seconds: float,
    scale: Scale,
    seed: int,
) -> tuple[str, NDArray[np.float64]]:
    if isinstance(asked, str):
        return asked, excitations.excitation(asked, device, seconds, scale, seed)
    return "own command", np.ascontiguousarray(asked, dtype=np.float64)
