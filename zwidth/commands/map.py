"""`zwidth map`: what a run does over two quantities of wall and device, beside linear theory."""

from pathlib import Path
from typing import Any

import click
import numpy as np

from sim.device_file import load_device
from stability.bisection import Trial
from stability.linear import last_stable_damping
from stability.map_store import FateMap, make_map, save_map
from stability.plane import QUANTITIES, Axis, Fate, Plane
from zwidth.compiling import announce
from zwidth.console import Column, Console, progress
from zwidth.files import write_with
from zwidth.options import Quantity, json_option, out_option


@click.command("map")
@click.argument("device", metavar="DEVICE")
@click.option("--axes", nargs=2, type=click.Choice(QUANTITIES), default=("B", "K"), show_default=True,
              help="Two quantities, horizontal and vertical.")  # fmt: skip
@click.option("--x-range", nargs=2, type=Quantity("x"), help="From and to of the first axis.")
@click.option("--y-range", nargs=2, type=Quantity("y"), help="From and to of the second axis.")
@click.option("--log", multiple=True, type=click.Choice(QUANTITIES), help="Axis in equal ratios.")
@click.option("--stiffness", type=Quantity("N m/rad | N/m", above=True), default=10.0,
              show_default=True, help="K where it is no axis.")  # fmt: skip
@click.option("--damping", type=Quantity("N m s/rad | N s/m"), default=0.0, show_default=True,
              help="B where it is no axis.")  # fmt: skip
@click.option("--delay-ms", type=Quantity("ms"), help="Loop delay, else the device's own.")
@click.option("--encoder-step", type=Quantity("rad | m"), help="Encoder step, else the device's.")
@click.option(
    "--command-limit", type=Quantity("N m | N", above=True), help="Limit, else the device's."
)
@click.option("--friction", type=Quantity("N m | N"), help="Coulomb friction added at m1.")
@click.option("--start", type=Quantity("rad | m", above=True), default=1e-3, show_default=True,
              help="Start amplitude where it is no axis.")  # fmt: skip
@click.option("--seconds", type=Quantity("s", above=True), default=4.0, show_default=True,
              help="Length of a run; undecided ones go on up to four times as long.")  # fmt: skip
@click.option("--substeps", type=click.IntRange(1, 1000), default=None,
              help="Substeps a tick; default 10 with friction or other physics, else 1.")  # fmt: skip
@click.option("--perceptible", type=Quantity("N m | N"), default=0.01, show_default=True,
              help="Force from which an oscillation is felt.")  # fmt: skip
@click.option("--one-sided", is_flag=True, help="The wall only pushes.")
@click.option("--coarse", type=click.IntRange(3, 513), default=25, show_default=True,
              help="Points a side before refinement.")  # fmt: skip
@click.option("--levels", type=click.IntRange(0, 8), default=2, show_default=True,
              help="Refinements, each halving the step where the fate changes.")  # fmt: skip
@out_option("runs/map")
@json_option
def command(device: str, out: Path, json_file: str | None, **options: Any) -> None:
    """Map what becomes of a run over two quantities, with the linear boundary over it.

    DEVICE is a shipped device or a device file. The folder keeps every finished part: the same
    command takes an interrupted map up where it stopped.
    """
    console = Console(json_file)
    plane = _plane(device, options)
    announce(console)
    with progress("mapping", 0) as advance:
        state = {"done": 0}

        def report(done: int, known: int) -> None:
            advance(done - state["done"], now=f"{done} of {known} runs so far")
            state["done"] = done

        result = make_map(plane, options["coarse"], options["levels"], out / "parts", report)
    console.say(f"wrote {save_map(result, out / 'map.nc')}")
    from zwidth.figures.map import map_figure

    figure = map_figure(result)
    for kind in ("png", "svg"):
        write_with(out / f"map.{kind}", lambda f, k=kind: figure.savefig(f, format=k, dpi=150))
        console.say(f"wrote {out / f'map.{kind}'}")
    _summary(console, result)


def _plane(name: str, options: dict[str, Any]) -> Plane:
    device = load_device(name)
    changes = {
        field: options[option] * scale
        for field, option, scale in (
            ("delay", "delay_ms", 1e-3),
            ("encoder_step", "encoder_step", 1.0),
            ("command_limit", "command_limit", 1.0),
        )
        if options[option] is not None
    }
    device = device.with_interface(**changes)
    if options["friction"]:
        from sim.physics import make_physics

        device = device.with_physics(
            make_physics("coulomb_friction", "m1", level=options["friction"])
        )
    quantities = options["axes"]
    axes = []
    for quantity, limits in zip(quantities, ("x_range", "y_range"), strict=True):
        start, stop = options[limits] or _default_range(device, quantity)
        axes.append(Axis(quantity, start, stop, "log" if quantity in options["log"] else "linear"))
    rough = bool(device.physics) or "friction" in quantities
    substeps = options["substeps"] or (10 if rough else 1)
    trial = Trial(
        options["start"], options["seconds"], 4.0 * options["seconds"],
        min(0.5, options["seconds"] / 8.0), substeps=substeps,
    )  # fmt: skip
    return Plane(
        device, axes[0], axes[1], options["stiffness"], options["damping"], trial,
        options["perceptible"], options["one_sided"],
    )  # fmt: skip


def _default_range(device: Any, quantity: str) -> tuple[float, float]:
    """A range that shows the linear boundary whole, or a customary one."""
    if quantity == "B":
        return 0.0, 1.2 * (last_stable_damping(device) or 0.1)
    if quantity == "K":
        from stability.linear import corner

        top = corner(device)
        high = 1.4 * top.stiffness if top is not None else 50.0
        return 0.01 * high, high
    return {
        "delay": (0.0, 0.01), "encoder_step": (0.0, 1e-3), "command_limit": (0.05, 1.0),
        "friction": (0.0, 0.02), "amplitude": (1e-4, 1e-1),
    }[quantity]  # fmt: skip


def _summary(console: Console, result: FateMap) -> None:
    lattice = result.run.size
    shares = {f: float(np.mean(result.fates.fate == f)) for f in Fate}
    rows = [[f.name.lower(), f"{100.0 * share:.1f} %"] for f, share in shares.items()]
    title = f"{result.runs} runs for a lattice of {lattice} points ({result.plane.device.name})"
    console.table(title, [Column("fate", False), Column("share of the plane")], rows)
    inside = result.linear < 0.0
    hidden = float(np.mean(result.fates.fate[inside] != Fate.RESTS)) if inside.any() else 0.0
    outside = float(np.mean(result.fates.fate[~inside] == Fate.RESTS)) if (~inside).any() else 0.0
    console.say(f"of the linearly stable part {100.0 * hidden:.1f} % does not come to rest")
    console.say(f"of the linearly unstable part {100.0 * outside:.1f} % comes to rest all the same")
    console.result(
        {
            "device": result.plane.device.name,
            "axes": [result.plane.x.quantity, result.plane.y.quantity],
            "runs": result.runs,
            "lattice": lattice,
            "shares": {f.name.lower(): share for f, share in shares.items()},
            "stable_but_not_resting": hidden,
            "unstable_but_resting": outside,
        }
    )
