"""A device exported as C beside the simulation."""

import numpy as np
import pytest
from physics_examples import EVERYWHERE, EXAMPLES

from zwidth.controllers.excitation import multisine
from zwidth.export.compiled import compiler, run_c
from zwidth.export.model import Exported, free_run
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import EFFECTS, make_physics

needs_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler (cc, gcc)")
COMMANDS = multisine(0.1, 1.0, 50.0, 0.25, 0.001)
FIRST = sorted({name: (name, place) for name, place in reversed(EVERYWHERE)}.values())


def with_effect(name: str, place: str) -> Device:
    """Return the PHANToM with an example of an effect, and the servo that it may need."""
    device = load_device("phantom_1_0").with_physics(make_physics(name, place, **EXAMPLES[name]))
    if EFFECTS[name].needs == "position_servo":
        return device.with_physics(
            make_physics("position_servo", "m1", **EXAMPLES["position_servo"])
        )
    return device


def assert_same_bits(device: Device, made: Exported) -> None:
    theirs = run_c(made.text(), "dev", COMMANDS)
    np.testing.assert_array_equal(theirs, free_run(device, COMMANDS, seed=3))
