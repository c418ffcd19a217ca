"""`zwidth identify`: the parameters of eq. (1) from a recording, as a device file."""

import math
import re
from pathlib import Path

import click
import numpy as np

from zwidth.console import Column, Console
from zwidth.covariance import save_covariance
from zwidth.door import described
from zwidth.figures.style import picture_files
from zwidth.files.whole import write_text
from zwidth.heartbeat import HEART
from zwidth.identification.coordinates import MAX_MODES
from zwidth.identification.fit import Fit, fit_response
from zwidth.identification.identified import identified
from zwidth.identification.search import REJECTED
from zwidth.logs.recording import read_recording
from zwidth.logs.recording_file import KNOWN_FORCE
from zwidth.options import Quantity, force_option, json_option, out_option
from zwidth.sim.device import Device, warnings_of
from zwidth.sim.device_file import commented_text


@click.command("identify")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--modes", type=click.IntRange(0, MAX_MODES),
              help="Number of vibration modes. Default: as many as the data show.")  # fmt: skip
@click.option("--delay-ms", metavar="MS|fit", default="0", show_default=True,
              help="Known delay from command to force, or 'fit' to fit it too.")  # fmt: skip
@click.option("--command", "channel", default="command", show_default=True,
              help="Channel of the command.")  # fmt: skip
@click.option("--position", default="position_m1", show_default=True,
              help="Channel of the position.")  # fmt: skip
@click.option("--from-hz", type=Quantity("Hz", above=True), default=0.7, show_default=True,
              help="Lowest frequency used.")  # fmt: skip
@click.option("--to-hz", type=Quantity("Hz", above=True), default=300.0, show_default=True,
              help="Highest frequency used.")  # fmt: skip
@click.option("--name", help="Name of the device and of its files. Default: the recording's.")
@out_option("runs/identify")
@force_option
@json_option
def command(
    recording: Path,
    modes: int | None,
    delay_ms: str,
    channel: str,
    position: str,
    from_hz: float,
    to_hz: float,
    name: str | None,
    out: Path,
    json_file: str | None,
) -> None:
    """Fit a device to a recording of its command and position.

    RECORDING is any file that 'zwidth diagnose' reads. Writes the device file (NAME.toml with
    --name, else RECORDING.device.toml), the covariance of its parameters, and a Bode diagram.
    """
    console = Console(json_file)
    if not recording.exists():
        raise ValueError(f"there is no recording {str(recording)!r}; check the path")
    HEART.begins(f"reading {recording.name}")
    trace = read_recording(described(console, recording, out))
    stem = _file_stem(name) if name else recording.stem
    device_file = out / (f"{stem}.toml" if name else f"{stem}.device.toml")
    spread, bode = out / f"{stem}.covariance.json", out / f"{stem}_bode"
    console.will_write(device_file, spread, *picture_files(bode))
    fit = fit_response(
        trace, modes, output=position, command=channel, delay=_delay(delay_ms), from_hz=from_hz,
        to_hz=to_hz, say=lambda how: HEART.begins(f"fitting the device: {how}"),
    )  # fmt: skip
    warned = trace.facts.get("warnings", ())
    for warning in (*(warned if isinstance(warned, list | tuple) else ()), fit.note):
        if warning:
            console.warn(f"{recording.name}: {warning}")
    if any(c.startswith(KNOWN_FORCE) for c in trace.channels):
        console.warn(f"{recording.name} has a [[known_force]], which this command does not use")
    source = f"identified from {recording.name}"
    found = identified(fit, name or recording.stem, trace.units[position], source, position)
    device = found.device
    _tell(console, device, fit)
    write_text(device_file, commented_text(device))
    save_covariance(spread, fit.names, fit.covariance)
    console.result(_result(device, fit, device_file, spread))
    HEART.begins("drawing the Bode diagram")
    from zwidth.figures.identified import fit_figure  # matplotlib takes a second, after the work
    from zwidth.figures.style import save_figure

    figure = fit_figure(fit)
    for path in (device_file, spread, *save_figure(figure, bode)):
        console.say(f"wrote {path}")


def _file_stem(name: str) -> str:
    """Return a device's name as the name of a file: what some system does not allow becomes "_"."""
    return re.sub(r'[\x00-\x1f<>:"/\\|?*]', "_", name).strip(" .") or "device"


def _delay(text: str) -> float | None:
    if text == "fit":
        return None
    try:
        delay = 1e-3 * float(text)
    except ValueError:
        delay = math.nan
    if not 0.0 <= delay < math.inf:
        raise ValueError(f"--delay-ms is {text!r}; give 0 or more [ms], or fit")
    return delay


def _units(rotary: bool) -> dict[str, str]:
    body = ("kg m2", "N m s/rad") if rotary else ("kg", "N s/m")
    return {"m": body[0], "b": body[1], "delay": "s"}


def _tell(console: Console, device: Device, fit: Fit) -> None:
    units = _units(device.rotary)
    rows = [
        [key, units.get(key, "rad/s"), f"{value:.6g}", f"{low:.6g}", f"{high:.6g}"]
        for key, (value, low, high) in fit.intervals().items()
    ]
    columns = [Column("parameter", False), Column("unit", False), Column("value")]
    columns += [Column("from"), Column("to (95 %)")]
    console.table(f"{device.name}: {len(fit.model.modes)} mode(s)", columns, rows)
    console.say(
        f"noise {fit.noise_rms:.3g} {'rad' if device.rotary else 'm'} rms; squared error of the"
        " fit,"
        f" in units of the noise: {fit.misfit:.3g} (1 if only noise is left)"
    )
    for warning in warnings_of(device):
        console.warn(warning)
    if fit.misfit > REJECTED:
        error = np.abs(fit.response.value - fit.fitted) ** 2 / fit.variance
        worst = float(fit.response.frequency_hz[int(np.argmax(error))])
        console.warn(
            f"the model leaves an error larger than noise, the largest near {worst:.3g} Hz; the"
            " intervals include noise only, so they are too narrow. Allow more modes, narrow the"
            " band, or check for friction with a recording of another amplitude"
        )


def _result(device: Device, fit: Fit, device_file: Path, spread: Path) -> dict[str, object]:
    units = _units(device.rotary)
    return {
        "device": device.name,
        "modes": len(fit.model.modes),
        "parameters": {
            key: {"value": value, "unit": units.get(key, "rad/s"), "ci95": [low, high]}
            for key, (value, low, high) in fit.intervals().items()
        },
        "misfit": fit.misfit,
        "noise_rms": fit.noise_rms,
        "device_file": str(device_file),
        "covariance_file": str(spread),
    }
