"""The option for the estimator of a device's velocity."""

import math
from typing import Any

import click

from zwidth.console import Console
from zwidth.sim.device import Device
from zwidth.sim.estimators import ESTIMATORS
from zwidth.sim.interface import DIFFERENCE_ALONE
from zwidth.sim.nearest import nearest
from zwidth.stability.linear import has_theory

USUAL_WINDOW = 16
ROUNDING = math.sqrt(12.0)  # a step over the standard deviation of its rounding


def estimator_option(command: Any) -> Any:
    """Add --estimator to a command; `with_estimator` reads it."""
    return click.option(
        "--estimator", metavar="NAME[:KEY=X,...]", default=None,
        help="How the velocity is computed from the readings. Default: the device's. One of"
        f" {', '.join(ESTIMATORS)}. KEY: window, band, noise, acceleration; what is left out is"
        " computed from the encoder's step and the largest force.",
    )(command)  # fmt: skip


def with_estimator(device: Device, asked: str | None) -> Device:
    """Return a device with the estimator "NAME:KEY=X,..", unchanged for None.

    Defaults: a window of `USUAL_WINDOW` samples, a band of one encoder step, the noise of its
    rounding, and as acceleration (of levant and kalman) the largest force over all masses. Raises
    ValueError for an unknown name or key, a value that is not allowed, or a default that the device
    does not determine.
    """
    if asked is None:
        return device
    name, _, rest = asked.partition(":")
    if name not in ESTIMATORS:
        raise ValueError(f"--estimator is {name!r}; {nearest(name, ESTIMATORS)}")
    given = _numbers(name, rest)
    settings = {key: given.get(key, _usual(device, name, key)) for key in ESTIMATORS[name].settings}
    for key, value in settings.items():
        if value is None:
            why = {
                "acceleration": "cannot be computed from the device's largest force",
                "noise": "is computed from the encoder step, which the device does not have",
                "band": "is computed from the encoder step, which the device does not have",
            }[key]
            raise ValueError(f"--estimator {name} needs {key}, which {why}: give {name}:{key}=X")
    return device.with_interface(
        **DIFFERENCE_ALONE
        | {"velocity_estimator": name}
        | {f"velocity_{key}": value for key, value in settings.items()}
    )


def say_without_theory(console: Console, device: Device) -> None:
    """Say why there is no linear theory, if it does not apply to the device."""
    if not has_theory(device):
        console.note(
            f"there is no linear theory for {device.interface.velocity_estimator}, whose gain"
            " depends on the motion: the columns of linear theory stay empty, and ranges are chosen"
            " as for the estimator 'difference'"
        )


def _numbers(name: str, text: str) -> dict[str, float]:
    """Read "KEY=X,KEY=X"; raises ValueError (key or value, what is allowed)."""
    taken = ESTIMATORS[name].settings
    found: dict[str, float] = {}
    for part in filter(None, text.split(",")):
        key, _, value = part.partition("=")
        if key not in taken:
            allowed = f"it takes {', '.join(taken)}" if taken else "it takes no settings"
            raise ValueError(f"--estimator {name} has no {key!r}; {allowed}")
        try:
            found[key] = int(value) if key == "window" else float(value)
        except ValueError:
            kind = "a whole number" if key == "window" else "a number"
            raise ValueError(f"--estimator {name}: {key} is {value!r}; give {kind}") from None
    return found


def _usual(device: Device, name: str, key: str) -> float | None:
    face = device.interface
    match key:
        case "window":
            return USUAL_WINDOW
        case "band":
            return face.encoder_step or None
        case "noise":
            return face.encoder_step / ROUNDING or None
        case _:
            if name == "kalman_acceleration" or math.isinf(face.command_limit):
                return None
            return face.command_limit / float(device.chain.masses.sum())
