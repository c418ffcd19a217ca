"""`zwidth map`: how runs end, over two quantities of wall and device, with linear theory."""

from pathlib import Path
from typing import Any, get_args

import click
from click.core import ParameterSource

from zwidth.console import Column, Console, progress
from zwidth.estimator_option import estimator_option, say_without_theory, with_estimator
from zwidth.figures.style import picture_files, save_figure
from zwidth.jobs.choose import executor
from zwidth.law_options import law_of, law_options
from zwidth.options import (
    Quantity,
    cluster_option,
    device_argument,
    force_option,
    json_option,
    out_option,
)
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.equations import enough_substeps
from zwidth.sim.perception import FORCE, Perception
from zwidth.stability.fate_map import make_map, save_map
from zwidth.stability.judging import Trial
from zwidth.stability.map_summary import summary
from zwidth.stability.plane import QUANTITIES, Axis, Plane, with_friction
from zwidth.stability.plane import Quantity as Quantities
from zwidth.stability.usual_plane import usual_axis

# The option that sets a quantity that is not on an axis.
FIXED_BY: dict[Quantities, str] = {
    "K": "stiffness", "B": "damping", "delay": "delay_ms", "encoder_step": "encoder_step",
    "command_limit": "command_limit", "friction": "friction", "amplitude": "start",
    "cutoff": "cutoff_hz",
}  # fmt: skip


@click.command("map")
@device_argument()
@click.option("--axes", nargs=2, type=click.Choice(QUANTITIES), default=("B", "K"),
              show_default=True, help="The quantities on the horizontal and the vertical"
              " axis.")  # fmt: skip
@click.option("--x-range", nargs=2, type=Quantity("SI"),
              help="Range of the horizontal axis. Default for B and K: around the linear boundary;"
              " for others: a customary range.")  # fmt: skip
@click.option("--y-range", nargs=2, type=Quantity("SI"),
              help="Range of the vertical axis; the default is chosen in the same"
              " way.")  # fmt: skip
@click.option(
    "--log",
    multiple=True,
    type=click.Choice(QUANTITIES),
    help="Give the axis of this quantity a logarithmic scale.",
)
@click.option("--stiffness", type=Quantity("N m/rad | N/m", above=True), default=10.0,
              show_default=True, help="K, if it is not an axis.")  # fmt: skip
@click.option("--damping", type=Quantity("N m s/rad | N s/m"), default=0.0, show_default=True,
              help="B, if it is not an axis.")  # fmt: skip
@click.option("--delay-ms", type=Quantity("ms"), help="Loop delay. Default: the device's.")
@click.option(
    "--encoder-step", type=Quantity("rad | m"), help="Encoder step. Default: the device's."
)
@click.option("--command-limit", type=Quantity("N m | N", above=True),
              help="Largest command. Default: the device's.")  # fmt: skip
@click.option("--friction", type=Quantity("N m | N"),
              help="Coulomb friction at m1. Default: the device's.")  # fmt: skip
@click.option("--cutoff-hz", type=Quantity("Hz", above=True),
              help="Cut-off of the velocity filter. Default: the device's.")  # fmt: skip
@click.option("--start", type=Quantity("rad | m", above=True), default=1e-3, show_default=True,
              help="Start amplitude, if it is not an axis.")  # fmt: skip
@click.option("--seconds", type=Quantity("s", above=True), default=4.0, show_default=True,
              help="Length of a run. A run with an unclear outcome is extended, up to four"
              " times this length.")  # fmt: skip
@click.option("--substeps", type=click.IntRange(1, 1000), default=None,
              help="Integration steps per sample. Default: 10 with friction, else 1.")  # fmt: skip
@click.option("perceptible", "--felt-force", "--perceptible", type=Quantity("N m | N"),
              default=FORCE, show_default=True,
              help="Smallest force of dither that a hand feels.")  # fmt: skip
@click.option("perceptible_position", "--felt-position", "--perceptible-position",
              type=Quantity("rad | m", above=True),
              help="Smallest amplitude of dither that a hand feels. Default: the threshold of"
              " vibration on the skin; for a rotary device, only with --lever.")  # fmt: skip
@click.option("--lever", type=Quantity("m", above=True),
              help="Distance of the hand from the axis of a rotary device.")  # fmt: skip
@click.option("--one-sided", is_flag=True, help="Make the wall one-sided: it only pushes.")
@law_options
@click.option("--coarse", type=click.IntRange(3, 513), default=25, show_default=True,
              help="Points along each axis before refinement.")  # fmt: skip
@click.option("--levels", type=click.IntRange(0, 8), default=3, show_default=True,
              help="Number of refinements; each halves the step where the outcome"
              " changes.")  # fmt: skip
@estimator_option
@cluster_option
@out_option("runs/map")
@force_option
@json_option
@click.pass_context
def command(
    context: click.Context,
    device: str,
    cluster: str | None,
    out: Path,
    json_file: str | None,
    **options: Any,
) -> None:
    """Map the outcome of runs over two quantities, with the linear boundary drawn over it.

    DEVICE is a shipped device or a device file. A run comes to rest, grows, or dithers: the steps
    of the encoder or the command sustain an oscillation, whether a hand feels it or not. Finished
    parts are kept in --out: after an interruption, the same command continues where it stopped,
    here or on a cluster.
    """
    console = Console(json_file)
    _refuse_idle_options(context, options)
    plane = _plane(load_device(device), options)
    say_without_theory(console, plane.device)
    console.will_write(out / "map.nc", *picture_files(out / "map"))
    with executor(cluster) as runner, progress("computing the map, percent", 100) as advance:
        shown = 0

        def report(share: float, runs: int) -> None:
            nonlocal shown
            percent = int(100.0 * share)
            advance(percent - shown, now=f"({runs} runs simulated)")
            shown = percent

        result = make_map(
            plane, options["coarse"], options["levels"], out / "parts", report, runner=runner
        )
    console.say(f"wrote {save_map(result, out / 'map.nc')}")
    from zwidth.figures.map import map_figure  # matplotlib takes a second, after the work

    figure = map_figure(result)
    for path in save_figure(figure, out / "map"):
        console.say(f"wrote {path}")
    found = summary(result)
    _say(console, found, plane.device.rotary)
    console.result(found)


def _refuse_idle_options(context: click.Context, options: dict[str, Any]) -> None:
    """Refuse what would change nothing: a fixed value of an axis, equal ratios of no axis."""
    for quantity in options["axes"]:
        name = FIXED_BY[quantity]
        if context.get_parameter_source(name) == ParameterSource.COMMANDLINE:
            option = name.replace("_", "-")
            raise ValueError(
                f"--{option} has no use while {quantity} is an axis; leave it out, or choose"
                " another axis"
            )
    for quantity in options["log"]:
        if quantity not in options["axes"]:
            raise ValueError(
                f"--log {quantity} has no use while {quantity} is not an axis; leave it out, or add"
                f" {quantity} to --axes"
            )


def _plane(device: Device, options: dict[str, Any]) -> Plane:
    changes = {
        field: options[option] * scale
        for field, option, scale in (
            ("delay", "delay_ms", 1e-3),
            ("encoder_step", "encoder_step", 1.0),
            ("command_limit", "command_limit", 1.0),
            ("velocity_cutoff_hz", "cutoff_hz", 1.0),
        )
        if options[option] is not None
    }
    device = with_estimator(device.with_interface(**changes), options["estimator"])
    if options["friction"] is not None:
        device = with_friction(device, options["friction"])
    quantities = options["axes"]
    axes = [
        _axis(device, quantity, options[limits], quantity in options["log"])
        for quantity, limits in zip(quantities, ("x_range", "y_range"), strict=True)
    ]
    rubbing = with_friction(device, 1.0) if "friction" in quantities else device
    seconds = options["seconds"]
    trial = Trial(
        options["start"], seconds, 4.0 * seconds, min(0.5, seconds / 8.0),
        substeps=options["substeps"] or enough_substeps(rubbing, 10 if rubbing.physics else 1),
        law=law_of([device], options),
        perception=Perception(
            options["perceptible"], options["perceptible_position"], options["lever"]
        ),
    )  # fmt: skip
    return Plane(
        device, axes[0], axes[1], options["stiffness"], options["damping"], trial,
        options["one_sided"],
    )  # fmt: skip


def _axis(
    device: Device, quantity: Quantities, limits: tuple[float, float] | None, ratios: bool
) -> Axis:
    assert quantity in get_args(Quantities)
    if limits is not None:
        return Axis(quantity, *limits, "log" if ratios else "linear")
    return usual_axis(device, quantity, ratios)


def _say(console: Console, found: dict[str, Any], rotary: bool) -> None:
    length, force = ("rad", "N m") if rotary else ("m", "N")
    fates = found["fates"]
    columns = [
        Column("fate", False), Column("share of the plane"),
        Column(f"median amplitude [{length}]"), Column(f"largest [{length}]"),
        Column("median in encoder steps"), Column("largest in encoder steps"),
        Column(f"median force [{force}]"), Column(f"largest [{force}]"),
    ]  # fmt: skip
    rows = [
        [name, f"{100.0 * f['share']:.1f} %", *_two(f["amplitude"]),
         *_two(f["encoder_steps"]), *_two(f["force"])]
        for name, f in fates.items() if f["share"] > 0.0
    ]  # fmt: skip
    console.table(
        f"{found['runs']} runs for a lattice of {found['lattice']} points ({found['device']})",
        columns, rows,
    )  # fmt: skip
    if found["stable_but_not_resting"] is not None:
        _say_beside_theory(console, found)
    if witness := found["describing_function"]:
        console.say(
            f"limit cycles at the force limit: describing functions predict their frequency within"
            f" {100.0 * witness['frequency_error']:.1f} %, their amplitude within"
            f" {100.0 * witness['amplitude_error']:.1f} % (median of {witness['points']} points)"
        )


def _say_beside_theory(console: Console, found: dict[str, Any]) -> None:
    console.say(
        "of the area that is stable by linear theory"
        f" {100.0 * found['stable_but_not_resting']:.1f} % does not come to rest;"
        f" {100.0 * found['stable_but_perceptible']:.1f} % is felt or grows"
    )
    share = 100.0 * found["unstable_but_resting"]
    console.say(f"of the area that is unstable by linear theory {share:.1f} % comes to rest")


def _two(values: list[float] | None) -> tuple[str, str]:
    """Median and most, a cell each."""
    return ("-", "-") if values is None else (f"{values[0]:.3g}", f"{values[1]:.3g}")
