"""Every compiler option in one place.

No fastmath and no fused multiply-add: the compiled loop equals the same Python source bit for bit,
which makes the source its own oracle (run it with ``NUMBA_DISABLE_JIT=1``).

Numba's on-disk cache looks at the file of a function, not at the files of the functions it calls,
so an edit of a callee would leave a stale caller behind. The cache folder is therefore named by the
text of every file of `sim` and `controllers` that holds compiled functions, or `Equations`, whose
fields compiled functions know by their order, and of every effect of the user's own
(`sim/own_files.py`), which is compiled with them.
"""

import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core.event import Event, Listener, register

from zwidth.sim.compiling import tell
from zwidth.sim.own_files import own_texts

Function = TypeVar("Function", bound=Callable[..., Any])
COMPILED_PACKAGES = ("sim", "controllers")
MARKS = (b"zwidth.sim.jit", b"compile_step", b"class Equations")


def _fingerprint() -> str:
    digest = hashlib.sha256(f"{numba.__version__} {sys.version}".encode())
    root = Path(__file__).parent.parent
    for package in COMPILED_PACKAGES:
        for file in sorted((root / package).rglob("*.py")):
            text = file.read_bytes()
            if any(mark in text for mark in MARKS):
                digest.update(text)
    for _, text in own_texts():
        digest.update(text or b"")
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Return the folder that holds the compiled kernels of exactly this source text."""
    base = os.environ.get("ZWIDTH_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "zwidth" / _fingerprint()


numba.config.CACHE_DIR = str(cache_folder())  # pyright: ignore[reportAttributeAccessIssue]


class _Compiling(Listener):
    """Tells when numba begins to compile and when it has ended, and nothing where it loads.

    What a kernel absorbs is compiled within it, so these calls are nested, and only the outermost
    counts. They come from one thread at a time, which holds numba's lock.
    """

    depth = 0

    def on_start(self, event: Event) -> None:
        self.depth += 1
        if self.depth == 1:
            tell(True)

    def on_end(self, event: Event) -> None:
        self.depth -= 1
        if self.depth == 0:
            tell(False)


register("numba:compile", _Compiling())

# _nrt off: no reference counts in kernels (they cost more than the arithmetic), hence no allocation
# there either; callers bring every array. forceinline: a NamedTuple of arrays handed to a function
# that is not absorbed is copied word by word at every call.
OPTIONS: dict[str, Any] = {
    "cache": True,
    "error_model": "numpy",
    "fastmath": False,
    "nogil": True,
    "_nrt": False,
}


INLINED: Any = OPTIONS | {"cache": False, "forceinline": True}  # of functions that choose by type


def jit(function: Function) -> Function:
    """Compile a kernel; divisions follow IEEE 754, the GIL is released."""
    return cast("Function", numba.njit(**OPTIONS)(function))


def part(function: Function) -> Function:
    """Compile a part of a kernel, absorbed by its callers."""
    return cast("Function", numba.njit(forceinline=True, **OPTIONS)(function))
