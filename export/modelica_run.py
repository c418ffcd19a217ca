"""An exported Modelica model, translated and run: by OpenModelica where it is, else by rumoca."""

import csv
import shutil
import subprocess
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from zwidth.export.model import Floats
from zwidth.files.whole import write_text

TOLERANCE = 1e-9
SCRIPT = """\
loadFile("run.mo"); getErrorString();
simulate(Run, startTime=0.0, stopTime=STOP, numberOfIntervals=TICKS, tolerance=TOLERANCE,
  outputFormat="csv", fileNamePrefix="run"); getErrorString();
"""


def translator() -> str:
    """Return what translates Modelica here: "OpenModelica", "rumoca", or "" for nothing."""
    if shutil.which("omc"):
        return "OpenModelica"
    return "rumoca" if _rumoca() else ""


def run_modelica(text: str, name: str, commands: Floats, period: float) -> Floats:
    """Return what a model of this name measures under commands (ticks,), one a period [s].

    Raises ValueError without a translator, and for a text that it refuses.
    """
    whole = f"{text}\n{_driver(name, commands, period)}"
    by = translator()
    if not by:
        raise ValueError("there is no Modelica translator; install OpenModelica or rumoca")
    run = _run_omc if by == "OpenModelica" else _run_rumoca
    times, measured = run(whole, commands.size, period)
    # what is measured at a tick stands there after its events, until the next
    rows = np.searchsorted(times, (np.arange(commands.size) + 0.5) * period) - 1
    return measured[rows]


def _driver(name: str, commands: Floats, period: float) -> str:
    values = ", ".join(repr(u) for u in commands.tolist())
    return f"""\
model Run
  parameter Real u[{commands.size}] = {{{values}}};
  {name} device;
  discrete Integer k(start=0, fixed=true);
  discrete Real now(start=0.0, fixed=true);
equation
  when sample(0.0, {period!r}) then
    k = pre(k) + 1;
    now = u[min(k, {commands.size})];
  end when;
  device.command = now;
end Run;
"""


def _rumoca() -> Any:
    try:
        return import_module("rumoca")
    except ImportError:
        return None


def _run_rumoca(text: str, ticks: int, period: float) -> tuple[Floats, Floats]:
    rumoca = _rumoca()
    try:
        model = rumoca.Session().loads(text, model="Run")
        config = rumoca.SimConfig(solver="rk-like", rtol=TOLERANCE, atol=1e-2 * TOLERANCE)
        found = model.simulate((0.0, (ticks - 0.5) * period), dt=period, config=config)
    except rumoca.RumocaError as error:
        raise ValueError(f"rumoca refuses the exported model: {str(error)[:400]}") from None
    return np.asarray(found.time), np.asarray(found["device.measured"])


def _run_omc(text: str, ticks: int, period: float) -> tuple[Floats, Floats]:
    script = SCRIPT.replace("STOP", repr(ticks * period)).replace("TICKS", str(ticks))
    with TemporaryDirectory() as folder:
        write_text(Path(folder) / "run.mo", text, own=True)
        write_text(Path(folder) / "run.mos", script.replace("TOLERANCE", repr(TOLERANCE)), own=True)
        ran = subprocess.run(
            ["omc", "run.mos"], cwd=folder, capture_output=True, text=True, check=False
        )
        result = Path(folder) / "run_res.csv"
        if not result.exists():
            raise ValueError(f"OpenModelica refuses the exported model: {ran.stdout[-400:]}")
        with result.open(newline="") as stream:
            rows = list(csv.DictReader(stream))
    return (
        np.array([float(row["time"]) for row in rows]),
        np.array([float(row["device.measured"]) for row in rows]),
    )
