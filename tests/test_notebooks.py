"""The notebooks run, and their pages are made of them."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import nbformat
import pytest

DOCS = Path(__file__).parents[1] / "docs"
NOTEBOOKS = DOCS / "notebooks"
NAMES = sorted(file.stem for file in NOTEBOOKS.glob("*.ipynb"))
PAGES = "make_notebook_pages"


@pytest.fixture(scope="module")
def pages() -> ModuleType:
    spec = importlib.util.spec_from_file_location(PAGES, DOCS / f"{PAGES}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[PAGES] = module
    spec.loader.exec_module(module)
    return module


def test_there_are_four_and_the_page_of_python_names_each():
    text = (DOCS / "python.md").read_text(encoding="utf-8")
    assert NAMES == ["boundary", "diagnosis", "log", "own_device"]
    assert sorted(re.findall(r"\(notebooks/(\w+)\.md\)", text)) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_is_kept_without_what_it_showed(name: str):
    """Mutation: a notebook saved with its outputs, in which every run is another file."""
    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.outputs == [] and cell.execution_count is None for cell in code)
    assert notebook.metadata.kernelspec.name == "python3"


@pytest.mark.parametrize("name", NAMES)
def test_a_page_has_the_text_and_the_code_of_its_notebook(name: str, pages: ModuleType):
    """Mutation: a cell changed, and the page not made anew."""
    notebook = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    text = (NOTEBOOKS / f"{name}.md").read_text(encoding="utf-8")
    place = 0
    for cell in notebook.cells:
        part = cell.source if cell.cell_type == "markdown" else pages.code(cell.source)
        assert part in text[place:], f"make {name}.md anew: python docs/{PAGES}.py {name}"
        place = text.index(part, place) + len(part)
    for picture in re.findall(r"\]\((\w+\.png)\)", text):
        assert (NOTEBOOKS / picture).exists()


@pytest.mark.truth
@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_runs_and_shows_as_many_pictures_as_its_page(name: str, pages: ModuleType):
    """Mutation: `plot` that does not tell a notebook how to show figures."""
    text, pictures = pages.page(name, pages.run(name))
    kept = (NOTEBOOKS / f"{name}.md").read_text(encoding="utf-8")
    assert re.findall(r"\]\((\w+\.png)\)", kept) == list(pictures)
    assert "Traceback" not in text
    assert "object at 0x" not in text
