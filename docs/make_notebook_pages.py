"""Run the notebooks of `docs/notebooks` and write each as a page that can be read as it is.

    python docs/make_notebook_pages.py [NAME...]

A notebook is kept without what it showed; NAME.md is its text, its code, and what that showed, with
the pictures beside it. Half a minute a notebook at most on an idle core, once all is compiled.
"""

import base64
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import nbformat
from nbclient import NotebookClient

from zwidth.files.protection import writing_as
from zwidth.files.whole import write_bytes, write_text

NOTEBOOKS = Path(__file__).parent / "notebooks"
SECONDS = 600  # a notebook may take: compiling comes first on a new machine


def names() -> list[str]:
    """Return the names of the notebooks."""
    return sorted(file.stem for file in NOTEBOOKS.glob("*.ipynb"))


def run(name: str) -> Any:
    """Return a notebook with the output of its cells; raises if one of them fails."""
    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    with TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        client = NotebookClient(
            notebook, timeout=SECONDS, kernel_name="python3", resources=resources
        )
        return client.execute()


def page(name: str, notebook: Any) -> tuple[str, dict[str, bytes]]:
    """Return a notebook as Markdown, and its pictures by the names of their files."""
    parts = [f"<!-- made of {name}.ipynb by docs/make_notebook_pages.py: edit that one -->"]
    pictures: dict[str, bytes] = {}
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(code(cell.source))
        for output in joined(cell.outputs):
            data = output.get("data", {})
            if "image/png" in data:
                file = f"{name}_{len(pictures) + 1}.png"
                pictures[file] = base64.b64decode(data["image/png"])
                parts.append(f"![{_about(parts)}]({file})")
            else:
                shown = output.get("text") or data.get("text/plain", "")
                parts.append(f"```text\n{shown.rstrip()}\n```")
    return "\n\n".join(parts) + "\n", pictures


def joined(outputs: list[Any]) -> list[Any]:
    """Return outputs with what was printed in one piece, as it may come in several."""
    found: list[Any] = []
    for output in outputs:
        if "zwidth" in output.get("metadata", {}):  # what was being done (zwidth.api.notebook)
            continue
        if found and output.output_type == found[-1].output_type == "stream":
            found[-1].text += output.text
        else:
            found.append(output)
    return found


def code(source: str) -> str:
    """Return a cell of code as a page has it."""
    return f"```python\n{source}\n```"


def _about(parts: list[str]) -> str:
    """Return what a picture shows: the last line of the code that drew it."""
    drawn = next(p for p in reversed(parts) if p.startswith("```python"))
    return drawn.splitlines()[-2]


def main() -> None:
    """Write the pages that are named, or all."""
    for name in sys.argv[1:] or names():
        text, pictures = page(name, run(name))
        with writing_as("make_notebook_pages", overwrite=True):
            for file, picture in pictures.items():
                write_bytes(NOTEBOOKS / file, picture)
            print(f"wrote {write_text(NOTEBOOKS / f'{name}.md', text)}")


if __name__ == "__main__":
    main()
