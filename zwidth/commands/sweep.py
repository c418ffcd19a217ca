"""`zwidth sweep`: the Z-width over one setting of the interface, and the setting's best value."""

from pathlib import Path
from typing import Any, get_args

import click
import numpy as np

from zwidth.console import Column, Console, progress
from zwidth.estimator_option import estimator_option, say_without_theory, with_estimator
from zwidth.figures.style import picture_files
from zwidth.files.whole import write_text
from zwidth.options import (
    ManyNumbers,
    Quantities,
    Quantity,
    device_argument,
    force_option,
    json_option,
    out_option,
)
from zwidth.scenarios.scenario import usual_substeps
from zwidth.sim.device_file import commented_text, load_device, remarks_on
from zwidth.stability.bisection import Search
from zwidth.stability.judging import Trial
from zwidth.stability.sweep import DAMPINGS, ROUNDS, TOLERANCE, Setting, Sweep, sweep
from zwidth.views.sweep import table


@click.command("sweep", cls=ManyNumbers)
@device_argument("name")
@click.option("--over", "setting", type=click.Choice(get_args(Setting)), default="cutoff",
              show_default=True, help="The setting: cut-off of the velocity filter [Hz], sample"
              " period [s], delay [s], encoder step, or the number of samples between two updates"
              " of the velocity or of the position.")  # fmt: skip
@click.option("--values", cls=Quantities, type=Quantity("SI"), rising=True, metavar="X ...",
              help="Values in rising order. Default: the setting's usual range. The device's"
              " own value is always included.")  # fmt: skip
@click.option("--order", type=click.IntRange(1, 2), default=None,
              help="Order of the velocity filter. Default: the device's.")  # fmt: skip
@click.option(
    "--encoder-step", type=Quantity("rad | m"), help="Encoder step. Default: the device's."
)
@click.option("--delay-ms", type=Quantity("ms"), help="Loop delay. Default: the device's.")
@click.option("--dampings", type=click.IntRange(3, 1001), default=DAMPINGS, show_default=True,
              help="Number of dampings in each boundary.")  # fmt: skip
@click.option("--rounds", type=click.IntRange(0, 20), default=ROUNDS, show_default=True,
              help="Number of refinements around the best value.")  # fmt: skip
@click.option("--start", type=Quantity("rad | m", above=True), default=1e-3, show_default=True,
              help="Start amplitude; with friction the boundary depends on it.")  # fmt: skip
@click.option("--tolerance", type=Quantity("of K", above=True), default=TOLERANCE,
              show_default=True, help="Relative accuracy of each K.")  # fmt: skip
@click.option("--limit-s", type=Quantity("s", above=True), default=64.0, show_default=True,
              help="Longest simulated time of one run.")  # fmt: skip
@estimator_option
@out_option("runs/sweep")
@force_option
@json_option
def command(name: str, out: Path, json_file: str | None, **options: Any) -> None:
    """Find the value of an interface setting that gives a device the largest Z-width.

    DEVICE is a shipped device or a device file. The Z-width is the area of stable walls in the
    plane of damping and stiffness. It is computed for each value of one setting, by simulation and
    by linear theory. Writes the device with the best value as best.toml.
    """
    console = Console(json_file)
    device = load_device(name)
    for warning in remarks_on(device):
        console.warn(warning)
    changes = {
        field: options[option] * scale
        for field, option, scale in (
            ("velocity_order", "order", 1), ("encoder_step", "encoder_step", 1.0),
            ("delay", "delay_ms", 1e-3),
        )
        if options[option] is not None
    }  # fmt: skip
    _refuse_idle(options)
    device = with_estimator(device.with_interface(**changes), options["estimator"])
    say_without_theory(console, device)
    console.will_write(out / "best.toml", *picture_files(out / "sweep"))
    limit = max(options["limit_s"], 4.0)
    trial = Trial(options["start"], limit_s=limit, substeps=usual_substeps(device))
    with progress("computing the sweep, percent", 100) as advance:
        shown = 0

        def report(done: int, total: int) -> None:
            nonlocal shown
            percent = int(100.0 * done / total)
            advance(percent - shown, now=f"{done} boundaries")
            shown = percent

        found = sweep(
            device, options["setting"], list(options["values"]) or None,
            dampings=options["dampings"], rounds=options["rounds"], trial=trial,
            search=Search(tolerance=options["tolerance"]), progress=report,
        )  # fmt: skip
    said = table(found)
    console.table(f"\n{said.title}", [Column(h) for h in said.headings], said.rows)
    for line in said.said:
        console.say(line)
    console.result(as_result(found))
    from zwidth.figures.style import save_figure  # after the work
    from zwidth.figures.sweep import sweep_figure

    console.say(f"wrote {write_text(out / 'best.toml', commented_text(found.best.device))}")
    for path in save_figure(sweep_figure(found), out / "sweep"):
        console.say(f"wrote {path}")


def _refuse_idle(options: dict[str, Any]) -> None:
    for setting, option in (("delay", "delay_ms"), ("encoder_step", "encoder_step")):
        if options["setting"] == setting and options[option] is not None:
            raise ValueError(
                f"--{option.replace('_', '-')} has no use while {setting} is swept; leave it out"
            )


def as_result(found: Sweep) -> dict[str, Any]:
    """Return the JSON form of a sweep; null for no cut-off, and where theory does not apply."""

    def value(number: float) -> float | None:
        return number if np.isfinite(number) else None

    return {
        "device": found.device.name,
        "setting": found.setting,
        "unit": found.unit,
        "best": value(found.best.value),
        "best_by_theory": None if (best := found.best_by_theory) is None else value(best.value),
        "steps": [
            {
                "value": value(step.value),
                "area": step.area,
                "linear_area": value(step.linear_area),
                "stiffest": step.stiffest,
                "dampings": step.dampings.tolist(),
                "linear": [value(k) for k in step.linear.tolist()],
                "simulated": step.simulated.tolist(),
            }
            for step in found.steps
        ],
    }
