"""A digest of what a result depends on besides its task: the code, its libraries and Python."""

import ast
import hashlib
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Any

LIBRARIES = ("numpy", "scipy", "numba")
PLACES = [Path(place) for place in import_module("zwidth").__path__]


def code_digest(function: Callable[..., Any]) -> str:
    """Return the digest of all files that a function's module imports, libraries and Python."""
    while isinstance(function, partial):
        function = function.func
    return _of_module(function.__module__)


@cache
def _of_module(module: str) -> str:
    digest = hashlib.sha256(sys.version.encode())
    digest.update(" ".join(version(name) for name in LIBRARIES).encode())
    for text in _sources(module):
        digest.update(text)
    return digest.hexdigest()[:16]


def _sources(module: str) -> Iterator[bytes]:
    """Yield the project's files that a module imports, directly or through others, each once.

    Of a package that imports its modules by name (the library of effects), all files count.
    """
    seen, waiting = set[str](), [module]
    while waiting:
        name = waiting.pop()
        file = next((f for f in _files(name) if f.is_file()), None)
        if name in seen or file is None:
            continue
        seen.add(name)
        text = file.read_bytes()
        yield text
        if file.name == "__init__.py" and b"import_module(f" in text:
            waiting += [f"{name}.{other.stem}" for other in sorted(file.parent.glob("*.py"))]
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                waiting += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module is not None:
                waiting += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]


def _files(module: str) -> list[Path]:
    top, *rest = module.split(".")
    paths = [place.joinpath(*rest) for place in PLACES]
    if top != "zwidth":  # a test or a benchmark, beside the package
        paths = [PLACES[0].parent.joinpath(top, *rest)]
    return [file for path in paths for file in (path.with_suffix(".py"), path / "__init__.py")]
