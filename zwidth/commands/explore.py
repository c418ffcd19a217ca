"""`zwidth explore`: the K-B plane of a device in a browser."""

import webbrowser
from importlib.util import find_spec
from pathlib import Path

import click

from zwidth.console import Console, progress
from zwidth.door import asker, fitted, taken
from zwidth.estimator_option import estimator_option, with_estimator
from zwidth.heartbeat import HEART
from zwidth.options import device_argument
from zwidth.sim.device_file import load_device, remarks_on, shipped_devices
from zwidth.sim.trace import Trace

PORT = 5006


@click.command("explore")
@device_argument()
@click.option("--compare", multiple=True, metavar="DEVICE2",
              help="Another device that you can select on the page, for example the improved"
              " device of 'zwidth diagnose' (NAME.augmented.toml); may be repeated.")  # fmt: skip
@click.option("--recording", metavar="FILE", type=click.Path(path_type=Path),
              help="Recording to plot together with every run. You can also drop a file on the"
              " page.")  # fmt: skip
@estimator_option
@click.option("--port", type=click.IntRange(0, 65535), default=PORT, show_default=True,
              help="Port of the page; 0 for any free port.")  # fmt: skip
@click.option("--address", default="localhost", show_default=True, metavar="HOST",
              help="Address at which this machine serves the page. With its host name or network"
              " address, others can open the page; there is no password.")  # fmt: skip
@click.option(
    "--no-browser", is_flag=True, help="Only print the address of the page; open no browser."
)
def command(
    device: str, compare: tuple[str, ...], recording: Path | None, estimator: str | None,
    port: int, address: str, no_browser: bool,
) -> None:  # fmt: skip
    """Explore the K-B plane of a device in the browser.

    DEVICE is a shipped device, a device file, or a recording such as a CSV. If you give a
    recording, a device is fitted to it, and the recording is drawn beside every run. Sliders change
    the encoder, amplifier, delay, friction and start. A click on the plane simulates the wall at
    that point; the run can be saved as a log or a scenario. The page's address contains all
    settings, so it can be bookmarked. Ctrl-C ends the command.
    """
    console = Console()
    if find_spec("bokeh") is None:
        raise ValueError(
            "explore needs Bokeh, which is not installed; run: pip install 'zwidth[explore]'"
        )
    if _is_data(device):
        recording = recording or Path(device)
    trace = None if recording is None else _taken(console, recording)
    if trace is not None and recording is not None and _is_data(device):
        own, said = fitted([(recording.stem, trace)])
        for line in said:
            console.note(line)
    else:
        own = load_device(device)
    own = with_estimator(own, estimator)
    devices = [own, *(load_device(name) for name in compare)]
    for warning in dict.fromkeys(w for d in devices for w in remarks_on(d)):
        console.warn(warning)
    from zwidth.explore.bench import Bench
    from zwidth.explore.prepare import steps
    from zwidth.explore.server import LOCAL, listen

    bench = Bench(devices, trace)
    server, url = listen(bench, address, port)
    try:
        preparing = steps(bench)
        with progress("compiling the simulation", len(preparing)) as advance:
            for what, prepare in preparing:
                advance(0, now=what)
                prepare()
                advance(1, now=what)
        if address != LOCAL:
            console.warn(f"anyone who can reach {url} can use the page; there is no password")
        server.start()
        console.say(f"{bench.devices[0].name}: {url} (Ctrl-C to end)")
        HEART.stop()  # now it only waits for the browser
        if not no_browser:
            server.io_loop.add_callback(webbrowser.open, url)
        server.io_loop.start()
    except KeyboardInterrupt:
        console.say("ended")
    finally:
        server.stop()


def _is_data(name: str) -> bool:
    """Whether what was named as the device is a file of data and no device file."""
    return (
        name not in shipped_devices()
        and Path(name).suffix.lower() != ".toml"
        and Path(name).is_file()
    )


def _taken(console: Console, path: Path) -> Trace:
    trace, said = taken(path, asker())
    if said:
        console.note(f"{path.name} was written by another tool; its columns are read as follows:")
    for line in said:
        console.note(f"  {line}")
    if said:
        console.note(
            f"if this is wrong, run 'zwidth diagnose {path}' and edit the two files that it writes:"
            " one says how the columns are read, the other describes the fitted device"
        )
    return trace
