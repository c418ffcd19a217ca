"""Compiles the kernels of a diagnosis, if they are not compiled yet, in two processes at once.

A diagnosis follows recordings by one device and by many devices side by side. Each is compiled from
the same source for its own types, for more than a minute on one core, and numba compiles one
function at a time in a process. So the first diagnosis starts two processes, which compile them
into the cache (`sim.jit.cache_folder`), and reads them from there.

    python -m zwidth.diagnosis.compiled alone | many

Limits: a recording of other types (one with gaps, for example) needs more kernels, which are
compiled when they are first needed; so are those that could not be compiled here.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from filelock import FileLock

from zwidth.diagnosis.fitting.many import Many
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SEARCHING, free_runs, innovations
from zwidth.diagnosis.noise.steady import steady_gains
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.files.whole import write_text
from zwidth.sim.chain import make_chain
from zwidth.sim.compiling import tell
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.jit import cache_folder

PARTS = ("alone", "many")
DONE = "diagnosis.compiled"  # in the cache's folder: the copies of zwidth that it serves
HERE = str(Path(__file__).resolve())  # numba's cache depends on the path of the source
TICKS = 64


def compiled() -> None:
    """Compile what a diagnosis needs if this was not done; returns at once if it was.

    If another process is compiling, this waits. On one core, kernels are compiled when needed.
    """
    done = cache_folder() / DONE
    if _marked(done) or (os.cpu_count() or 1) < 2 or _interpreted():
        return
    tell(True)
    try:
        done.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(done.with_suffix(".lock")):
            if not _marked(done) and _side_by_side():
                write_text(done, "\n".join([*_served(done), HERE, ""]), own=True)
    except OSError:  # nothing can be kept there
        return
    finally:
        tell(False)


def _marked(done: Path) -> bool:
    """Whether a file names this place of zwidth."""
    return HERE in _served(done)


def _served(done: Path) -> list[str]:
    """Return the places of zwidth that a file names; none without the file."""
    return done.read_text(encoding="utf-8").splitlines() if done.is_file() else []


def _interpreted() -> bool:
    """Whether numba was told to compile nothing."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


def _side_by_side() -> bool:
    """Compile each part in a process of its own; whether all were."""
    line = [sys.executable, "-m", "zwidth.diagnosis.compiled"]
    at_work = [
        subprocess.Popen([*line, part], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for part in PARTS
    ]
    try:
        return not any(one.wait() for one in at_work)
    finally:
        for one in at_work:
            one.kill()


def run(part: str) -> None:
    """Run a part once on a short recording, which compiles it."""
    chain = make_chain([1e-3], [1e-2], 0.0, [], [])
    device = Device("compiled", "", True, chain, Interface(period=1e-3))
    command = np.sin(np.arange(TICKS))
    outputs = (Output("position", 0),)
    e = Experiment(1e-3, command, 1e-3 * command[:, None], outputs, "compiled", 1e-3)
    gain = np.full((device.plant().size, 1), 0.1)
    if part == "alone":
        innovations(device, e, gain)
        free_runs(device, e, gain, [TICKS // 4])
    else:
        model = Model(device)
        Many(model, [np.zeros(len(model.parameters))] * 2, SEARCHING).innovations(e, gain)
        steady_gains([device, device], e, 1.0)


if __name__ == "__main__":
    run(sys.argv[1])
