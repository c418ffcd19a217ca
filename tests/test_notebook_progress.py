"""Progress and tables in real notebooks: a Jupyter kernel, and marimo."""

import os
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
ASKED = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})  # Jupyter starts kernels without PYTHONPATH
import zwidth
device = zwidth.load_device("phantom_1_0")
found = zwidth.boundary(device, [0.01, 0.02], search=zwidth.Search(tolerance=0.05))
"""
MARIMO = f"""
import marimo
app = marimo.App()

@app.cell
def _():
    {ASKED.strip().replace(chr(10), chr(10) + "    ")}
    found.points[0]
    return

if __name__ == "__main__":
    app.run()
"""


def test_jupyter_shows_one_line_of_progress_and_tables():
    """Mutations: a new line for each; a value as one line of all its numbers."""
    cells = [nbformat.v4.new_code_cell(ASKED), nbformat.v4.new_code_cell("found.points[0]")]
    notebook = NotebookClient(nbformat.v4.new_notebook(cells=cells), timeout=300).execute()
    (line,) = notebook.cells[0].outputs
    assert line.data["text/plain"] == "finding the boundary: done"
    assert line.metadata == {"zwidth": "progress"}
    (value,) = notebook.cells[1].outputs
    assert "<b>BoundaryPoint</b>" in value.data["text/html"]
    assert "<td" in value.data["text/html"]


def test_marimo_shows_tables_and_ends_its_spinner(tmp_path: Path):
    """Mutation: a spinner that marimo does not know, or that stays."""
    pytest.importorskip("marimo", reason="marimo is not installed")
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
    assert "finding the boundary" not in text
