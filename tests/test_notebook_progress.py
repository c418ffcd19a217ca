"""Progress and tables in real notebooks: a Jupyter kernel, and marimo."""

import os
import subprocess
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
ASKED = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})  # Jupyter starts kernels without PYTHONPATH
import zwidth
device = zwidth.load_device("phantom_1_0")
found = zwidth.boundary(device, [0.01, 0.02], search=zwidth.Search(tolerance=0.05))
"""
# What a spinner of marimo shows, from its start to its end.
WATCHED = """
import marimo
class Watched(marimo.status.spinner):
    def __enter__(self):
        shown = super().__enter__()
        update = shown.update
        def watched(**words):
            update(**words)
            print(shown.title, shown.subtitle, sep=": ", file=told, flush=True)
        shown.update = watched
        return shown
told = open("told.txt", "w")
marimo.status.spinner = Watched
"""
MARIMO = f"""
import marimo
app = marimo.App()

@app.cell
def _():
    {(WATCHED + ASKED).strip().replace(chr(10), chr(10) + "    ")}
    found.points[0]
    return

if __name__ == "__main__":
    app.run()
"""


# What is called, and the line that it leaves; each is a cell of one notebook.
TOLD = {
    "zwidth.boundary(device, [0.01, 0.02], search=fast)": "finding the boundary: done",
    "zwidth.find_boundaries([device], [array([0.01, 0.02])], search=fast)": (
        "finding the boundaries: done"
    ),
    "zwidth.make_map(device, coarse=3, levels=1)": "computing the map: done",
    "zwidth.sweep(device, values=[50.0], dampings=3, rounds=0, search=fast)": (
        "finding the widest Z-width: done"
    ),
    "zwidth.relay(device, [0.0, 0.01], starts=1)": "running the relay experiment: done",
    "zwidth.plan(cart, 'chirp', seconds=1.0)": "planning the recording: done",
    "zwidth.identify(session, delay=0.002)": "fitting the device: done",
    "zwidth.replay(log)": "simulating the log again: done",
    "zwidth.check(known, recording)": "checking the device: done",
}
# In each cell: the updates of its line, besides the line as it ends.
WATCH = """
from ipykernel.zmqshell import ZMQDisplayPublisher
told, publish = [], ZMQDisplayPublisher.publish
def watched(self, data, *args, **kwargs):
    told.append(data["text/plain"])
    return publish(self, data, *args, **kwargs)
ZMQDisplayPublisher.publish = watched
"""
PREPARED = """
from dataclasses import replace
from tempfile import TemporaryDirectory
from numpy import array
from numpy.random import default_rng
from zwidth.sim.band import Band, OutputBand
fast = zwidth.Search(tolerance=0.05)
face = zwidth.Interface(period=0.002, delay=0.002, encoder_step=1e-5)
cart = zwidth.Device("cart", "a test", False, zwidth.make_chain([0.5], [0.8]), face)
command = zwidth.excitation(cart, seconds=2.0, level=4.0, travel=0.05)
recording = zwidth.simulate(cart, zwidth.recorded(command))
band = Band(0.2, 9, 1.0, (OutputBand("position_m1", 1e-3, 1e-5, 0.1, 0.2),))
known = replace(cart, band=band)
noise = zwidth.excitation(cart, "white_noise", seconds=20.0, level=4.0, travel=0.05)
pushes = 0.02 * default_rng(0).standard_normal(noise.size)
session = zwidth.simulate(cart, zwidth.recorded(noise), disturbance=pushes)
folder = TemporaryDirectory()
log = folder.name + "/run.mcap"
wall = zwidth.Scenario(cart, zwidth.wall(40.0, 1.0), 0.5, zwidth.Start(1e-3))
written = zwidth.logged_run(wall, log)
"""
JOINTS = """
import numpy as np
from zwidth.diagnosis import diagnose as pipeline
def searching(known, fit_on, judge_by, say, effort):
    say("coulomb_friction@m1")
    raise ValueError("enough")
pipeline.diagnose = searching
t = 0.001 * np.arange(3000)
table = {"t": t}
for joint in ("elbow", "wrist"):
    table |= {f"torque_{joint}_Nm": np.sin(9.0 * t), f"position_{joint}_rad": np.cos(9.0 * t)}
told.clear()
zwidth.diagnose_joints(table, "phantom_1_0").left
"""


def test_jupyter_shows_one_line_of_progress_and_tables():
    """Of every function that takes seconds, with the share done where the length is known.

    Mutations: a function that says nothing; a new line for each; a value as one line of all its
    numbers; a joint without its name.
    """
    ready, joints = ASKED.partition("found =")[0] + PREPARED + WATCH, "told"
    calls = [f"told.clear(); found = {call}; told" for call in TOLD]
    cells = [ready, *calls, JOINTS, joints, "found.recordings[0]"]
    made = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    first, *every = NotebookClient(made, timeout=500).execute().cells
    assert first.outputs == []
    for cell, end in zip(every[: len(calls)], TOLD.values(), strict=True):
        line, told = cell.outputs
        assert line.data["text/plain"] == end
        assert line.metadata == {"zwidth": "progress"}
        assert "%" in told.data["text/plain"], end
        assert "@" not in told.data["text/plain"]
    *lines, left = every[len(calls)].outputs
    assert [line.data["text/plain"] for line in lines] == [
        "diagnosing joint elbow: stopped", "diagnosing joint wrist: stopped",
    ]  # fmt: skip
    assert "enough" in left.data["text/plain"]
    told = every[len(calls) + 1].outputs[0].data["text/plain"]
    assert "diagnosing joint wrist: coulomb friction at m1" in told.lower()
    (value,) = every[-1].outputs
    assert "<b>Recording</b>" in value.data["text/html"]
    assert "<td" in value.data["text/html"]


def test_marimo_shows_tables_and_a_spinner_that_ends(tmp_path: Path):
    """Mutations: a spinner that marimo does not know, that stays, or that never starts."""
    (tmp_path / "app.py").write_text(MARIMO)
    page = tmp_path / "app.html"
    line = [sys.executable, "-m", "marimo", "export", "html", "app.py", "-o", str(page)]
    done = subprocess.run(
        line, cwd=tmp_path, env={**os.environ, "CI": "1"}, capture_output=True, text=True,
        timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    text = page.read_text(encoding="utf-8")
    assert "BoundaryPoint" in text
    assert "MarimoExceptionRaisedError" not in text
    assert "finding the boundary" not in text  # the spinner is gone
    told = (tmp_path / "told.txt").read_text().splitlines()
    assert "finding the boundary: 100 %" in told
    assert all(line.startswith("finding the boundary: ") for line in told)
