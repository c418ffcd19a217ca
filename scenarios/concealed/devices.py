"""Devices to conceal physics in: the PHANToM of Table I, and chains of one to five masses."""

from dataclasses import replace

import numpy as np

from zwidth.sim.chain import Chain, make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.interface import Interface

PHANTOM_SHARE, SPRUNG_SHARE, LINEAR_SHARE, ENCODER_SHARE = 0.3, 0.3, 0.35, 0.25
MASSES = (0.2, 0.3, 0.35, 0.1, 0.05)  # shares of chains of one to five masses
LEVER = 0.05  # m: a linear device is a rotary one seen at the end of a lever
DELAYS = (0.001, 0.001, 0.002, 0.0015)
OFF = 0.1  # how far a device file is from its device, at most, in every number


def draw_device(random: np.random.Generator, encoder: bool = True) -> Device:
    """Return a device without physics; `encoder`: whether it may have an encoder step."""
    if random.random() < PHANTOM_SHARE:
        chain, rotary = load_device("phantom_1_0").chain, True
    else:
        chain, rotary = draw_chain(random), random.random() >= LINEAR_SHARE
    length = 1.0 if rotary else LEVER
    if not rotary:
        per = 1.0 / length**2
        masses, dampers, spring, springs, links = chain
        chain = make_chain(per * masses, per * dampers, per * spring, per * springs, per * links)
    step = 0.0
    if random.random() < ENCODER_SHARE and encoder:
        step = float(10.0 ** random.uniform(-6.0, -4.5)) * length
    interface = Interface(delay=float(random.choice(DELAYS)), encoder_step=step)
    return Device("device", "", rotary, chain, interface)


def draw_chain(random: np.random.Generator) -> Chain:
    """Return a passive chain like that of a haptic device: links of 12 to 200 Hz, light dampers."""
    n = int(random.choice(5, p=MASSES)) + 1
    total = float(np.exp(random.uniform(np.log(3e-4), np.log(5e-3))))
    masses = total * random.dirichlet(np.full(n, 4.0))
    hertz = np.exp(random.uniform(np.log(12.0), np.log(200.0), n - 1))
    reduced = masses[:-1] * masses[1:] / (masses[:-1] + masses[1:])
    springs = reduced * (2.0 * np.pi * hertz) ** 2
    links = 2.0 * random.uniform(0.02, 0.15, n - 1) * np.sqrt(springs * reduced)
    dampers = total * random.uniform(1.0, 8.0) * random.dirichlet(np.full(n, 2.0))
    spring = 0.0
    if random.random() < SPRUNG_SHARE:
        spring = total * (2.0 * np.pi * random.uniform(1.0, 6.0)) ** 2
    return make_chain(masses, dampers, spring, springs, links)


def mistaken(random: np.random.Generator, device: Device) -> Device:
    """Return the device with every number of its chain up to 10 % off, and without physics."""
    chain = device.chain

    def off(values: object) -> np.ndarray:
        exact = np.asarray(values, dtype=np.float64)
        return exact * (1.0 + random.uniform(-OFF, OFF, exact.shape))

    return replace(
        device,
        chain=make_chain(
            off(chain.masses),
            off(chain.ground_dampers),
            float(off(chain.ground_spring)),
            off(chain.link_springs),
            off(chain.link_dampers),
        ),
        physics=(),
        modal=None,
    )
