"""Options for the law of the walls of a command."""

from collections.abc import Callable, Sequence
from typing import Any, get_args

import click

from zwidth.options import Quantity
from zwidth.sim.device import Device
from zwidth.sim.law import Kind, Law
from zwidth.sim.readable import plain
from zwidth.stability.linear import last_stable_damping, stand_in

OF: dict[str, tuple[str, ...]] = {
    "wavelength": ("texture",), "share": ("texture",), "width": ("region",),
    "most_damping": ("guarded",),
}  # fmt: skip
USUAL_SHARE = 0.1  # of the last stable damping: default limit of a passivity controller


def law_options(command: Any) -> Any:
    """Add --law and the options of the laws to a command; `law_of` reads them."""
    options: list[Callable[[Any], Any]] = [
        click.option("--law", type=click.Choice(get_args(Kind)), default="wall", show_default=True,
                     help="Control law of the wall: spring and damper, a texture (a sinusoidal"
                     " force), a region of stiffness and damping, or spring and damper with a"
                     " passivity controller."),
        click.option("--wavelength", type=Quantity("rad | m", above=True),
                     help="Wavelength of the texture, whose steepest slope is K."),
        click.option("--share", type=Quantity("of K"), default=None,
                     help="Part of the texture's slope that is sinusoidal, the rest a spring."
                     " Default: 1."),
        click.option("--width", type=Quantity("rad | m", above=True),
                     help="Width of the region, which begins at 0. Default: unlimited."),
        click.option("--most-damping", type=Quantity("N m s/rad | N s/m"),
                     help="Largest damping that the passivity controller adds. Default: a tenth of"
                     " the largest B that is stable without a spring."),
    ]  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return command


def law_of(devices: Sequence[Device], options: dict[str, Any]) -> Law:
    """Return the requested law; raises ValueError for an option that it does not have.

    devices: those that will use it; defaults suit all of them.
    """
    kind = options["law"]
    for name, kinds in OF.items():
        if options[name] is not None and kind not in kinds:
            raise ValueError(
                f"--{name.replace('_', '-')} has no use with --law {kind}; leave it out, or choose"
                f" --law {kinds[0]}"
            )
    given = {name: options[name] for name in OF if options[name] is not None}
    if kind == "texture" and "wavelength" not in given:
        raise ValueError("--law texture needs --wavelength, from crest to crest")
    if kind == "guarded" and "most_damping" not in given:
        least = min(last_stable_damping(stand_in(device)) or 0.0 for device in devices)
        given["most_damping"] = USUAL_SHARE * least
    return Law(kind, **given)


def said_of(law: Law, rotary: bool) -> str:
    """Return a law in words, for a title; nothing for a plain wall."""
    length, damping = ("rad", "N m s/rad") if rotary else ("m", "N s/m")
    match law.kind:
        case "texture":
            part = "" if law.share == 1.0 else f", {plain(law.share)} of the slope"
            return f"texture of {plain(law.wavelength)} {length}{part}"
        case "region":
            return "region" + (f" of {plain(law.width)} {length}" if law.width > 0.0 else "")
        case "guarded":
            return f"passivity controller up to {plain(law.most_damping)} {damping}"
        case _:
            return ""
