"""`zwidth devices`: the devices that come with zwidth, and a description of each."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from zwidth.console import Column, Console
from zwidth.files.whole import write_text
from zwidth.options import force_option, json_option
from zwidth.sim.chain import MAX_MASSES
from zwidth.sim.device import Device, place_label, warnings_of
from zwidth.sim.device_file import (
    USUAL,
    commented_text,
    load_device,
    shipped_devices,
    template_text,
)
from zwidth.sim.modal import ModalModel, from_chain
from zwidth.sim.passive import nearest_passive
from zwidth.views.device import in_points, said_of_estimator

TURN = 2.0 * math.pi


@click.command("devices")
@click.argument("device", metavar="[DEVICE]", required=False)
@click.option(
    "--passive",
    is_flag=True,
    help="Take the nearest device without negative dampers instead.",
)
@click.option(
    "--out",
    "--save",
    "save",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Write the device as a file, to edit or to use in other commands.",
)
@click.option(
    "--template", type=click.IntRange(1, MAX_MASSES), metavar="MASSES",
    help="Print a device file to start from, with this many masses and every key explained.",
)  # fmt: skip
@click.option("--from", "model", metavar="FILE", type=click.Path(path_type=Path),
              help="Make a device from a joint of an MJCF or URDF model (with --joint), or from a"
              " servo of BAM (a JSON file).")  # fmt: skip
@click.option("--joint", metavar="NAME", help="The joint of the model given with --from.")
@force_option
@json_option
def command(
    device: str | None,
    passive: bool,
    save: Path | None,
    template: int | None,
    model: Path | None,
    joint: str | None,
    json_file: str | None,
) -> None:
    """List the devices that come with zwidth, or describe one.

    DEVICE is the name of one of them or a device file.
    """
    console = Console(json_file)
    servo = model is not None and model.suffix.lower() == ".json"
    if (model is None or servo) != (joint is None):
        raise click.UsageError(
            "--from and --joint must be given together, except for a JSON file of BAM; give the"
            " model and its joint"
        )
    if template is not None:
        if device is not None or passive or model is not None:
            raise click.UsageError(
                "--template needs no device; leave out DEVICE, --passive and --from"
            )
        _template(console, template, save)
    elif model is not None:
        if device is not None:
            raise click.UsageError("--from already gives the device; leave DEVICE out")
        found, left_out = _read_model(model, joint)
        for what in left_out:
            console.note(f"not included in the device: {what}")
        _describe(console, found, passive, save, {"left_out": left_out})
    elif device is not None:
        _describe(console, load_device(device), passive, save, {})
    elif passive or save:
        raise click.UsageError("--passive and --out need a DEVICE; give its name or file")
    else:
        _list(console)


def _read_model(model: Path, joint: str | None) -> tuple[Device, list[str]]:
    """Return a joint of a robot's model, or a servo of BAM, and what is left out of it."""
    if joint is None:
        from zwidth.export.bam import device_of_bam

        return device_of_bam(model)
    from zwidth.export.read_joint import device_of_joint

    return device_of_joint(model, joint)


def _template(console: Console, masses: int, save: Path | None) -> None:
    console.will_write(*([save] if save else []))
    text = template_text(masses)
    if save:
        console.say(f"wrote {write_text(save, text)}")
    else:
        console.show(text)
    console.result({"masses": masses, "toml": text})


def _list(console: Console) -> None:
    found = {name: load_device(name) for name in shipped_devices()}
    console.will_write()
    columns = [Column("device", False), Column("masses"), Column("what it is", False)]
    rows = [[name, str(d.chain.masses.size), d.name] for name, d in found.items()]
    console.table(
        f"{len(rows)} shipped device(s); a device file of your own works too", columns, rows
    )
    console.result({"devices": [{"device": name, "name": d.name} for name, d in found.items()]})


def _describe(
    console: Console, device: Device, passive: bool, save: Path | None, result: dict[str, Any]
) -> None:
    console.will_write(*([save] if save else []))
    if passive:
        fit = nearest_passive(device.chain)
        device = replace(
            device.with_chain(fit.chain),
            name=f"{device.name}, nearest passive chain",
            source=f"{device.source}; relative rms distance {fit.distance:.3g} over 1-300 Hz",
        )
        result["distance"] = fit.distance
    for warning in warnings_of(device):
        console.warn(warning)
    console.say(f"{device.name} ({device.source})\n")
    _chain_table(console, device)
    modes = _modes(device)
    _mode_table(console, modes)
    _settings(console, device)
    if save:
        console.say(f"wrote {write_text(save, commented_text(device))}")
    console.result(_as_json(device, modes) | result)


def _chain_table(console: Console, device: Device) -> None:
    force, length, mass = ("N m", "rad", "kg m2") if device.rotary else ("N", "m", "kg")
    chain = device.chain
    columns = [
        Column("", False),
        Column(f"mass [{mass}]"),
        Column(f"damper to ground [{force} s/{length}]"),
        Column(f"spring to next [{force}/{length}]"),
        Column(f"damper to next [{force} s/{length}]"),
    ]
    links = [*zip(chain.link_springs, chain.link_dampers, strict=True), ("", "")]
    rows = [
        [f"m{i + 1}", *(f"{value:.6g}" if value != "" else "" for value in (mass, damper, *link))]
        for i, (mass, damper, link) in enumerate(
            zip(chain.masses, chain.ground_dampers, links, strict=True)
        )
    ]
    console.table("The chain, force and encoder at m1", columns, rows)
    if chain.ground_spring:
        console.say(f"spring from m1 to ground: {chain.ground_spring:.6g} {force}/{length}")


def _modes(device: Device) -> ModalModel | None:
    """Return the modal form, None where the mechanism has none (a ground spring, a real pole)."""
    try:
        return device.modal or from_chain(device.chain)
    except ValueError:
        return None


def _mode_table(console: Console, modal: ModalModel | None) -> None:
    if modal is None or not modal.modes:
        return
    columns = [
        Column("", False),
        Column("resonance [Hz]"),
        Column("damping ratio"),
        Column("antiresonance [Hz]"),
        Column("damping ratio"),
    ]
    rows = [
        [f"mode {i + 1}", *(f"{value:.5g}" for value in _mode(mode).values())]
        for i, mode in enumerate(modal.modes)
    ]
    console.say()
    console.table("Its modes", columns, rows)


def _mode(mode: Any) -> dict[str, float]:
    return {
        "resonance_hz": mode.omega / TURN,
        "resonance_damping": mode.c / (2.0 * mode.omega),
        "antiresonance_hz": mode.v / TURN,
        "antiresonance_damping": mode.d / (2.0 * mode.v),
    }


def _settings(console: Console, device: Device) -> None:
    interface = device.interface
    console.say(
        f"\nsampled every {1e3 * interface.period:g} ms, delay {1e3 * interface.delay:g} ms"
    )
    for what, value, none in (
        ("encoder step", interface.encoder_step, 0.0),
        ("command step", interface.command_step, 0.0),
        ("command limit", interface.command_limit, math.inf),
        ("command gain", interface.command_gain, 1.0),
        ("position origin", interface.position_origin, 0.0),
        ("velocity cutoff [Hz]", interface.velocity_cutoff_hz, math.inf),
        ("velocity step", interface.velocity_step, 0.0),
        ("order of the velocity filter", interface.velocity_order, 1),
        ("force sensor in", interface.force_sensor, ""),
        ("gain of the force feedback", interface.force_gain, 0.0),
        ("samples from one velocity to the next", interface.velocity_ticks, 1),
        ("samples from one position of the law to the next", interface.position_ticks, 1),
    ):
        if value != none:
            console.say(f"{what} {value if isinstance(value, str) else f'{value:g}'}")
    for line in said_of_estimator(interface, device.rotary):
        console.say(line)
    known = device.uncertainty
    for what, value, usual in (
        ("command scale", known.command_scale, USUAL.command_scale),
        ("masses", known.masses, USUAL.masses),
        ("springs", known.springs, USUAL.springs),
        ("dampers", known.dampers, USUAL.dampers),
    ):
        if value != usual:
            console.say(f"{what} known to {100.0 * value:g} % (one sigma)")
    if known.zeros != USUAL.zeros:
        unit = "rad" if device.rotary else "m"
        console.say(f"zero offsets of position sensors known to {known.zeros:g} {unit} (one sigma)")
    for physics in device.physics:
        values = ", ".join(f"{key} {value:g}" for key, value in physics.values.items())
        console.say(f"{place_label(physics)}: {in_points(physics) or values}")


def _as_json(device: Device, modal: ModalModel | None) -> dict[str, Any]:
    return {
        "name": device.name,
        "source": device.source,
        "rotary": device.rotary,
        "chain": {key: np.asarray(value).tolist() for key, value in device.chain._asdict().items()},
        "modes": [_mode(mode) for mode in modal.modes] if modal else None,
        "interface": {
            key: None if value == math.inf else value
            for key, value in vars(device.interface).items()
        },
        "uncertainty": dict(vars(device.uncertainty)),
        "physics": [
            {"effect": p.effect.name, "at": p.at, "parameters": dict(p.values)}
            for p in device.physics
        ],
        "warnings": warnings_of(device),
    }
