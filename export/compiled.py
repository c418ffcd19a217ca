"""An exported C file, compiled and driven by a command."""

import os
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
FLAGS = ("-std=c99", "-O1", "-ffp-contract=off", "-Wall", "-Werror", "-Wno-unused-label")
DRIVER = """\

#include <stdio.h>

int main(void)
{
    NAME_state s;
    double command;
    NAME_reset(&s);
    while (fread(&command, sizeof command, 1, stdin) == 1) {
        const double measured = NAME_step(&s, command);
        fwrite(&measured, sizeof measured, 1, stdout);
    }
    return 0;
}
"""


def compiler() -> str | None:
    """Return this machine's C compiler: the one in CC, else cc, gcc or clang, or None."""
    named = os.environ.get("CC")
    return next((f for c in (named, "cc", "gcc", "clang") if c and (f := shutil.which(c))), None)


def run_c(text: str, name: str, commands: Floats, flags: tuple[str, ...] = FLAGS) -> Floats:
    """Compile a C export of this name and return its readings under commands (ticks,).

    Raises ValueError if there is no compiler or it refuses the text.
    """
    found = compiler()
    if found is None:
        raise ValueError("there is no C compiler (cc, gcc or clang); install one, or set CC")
    whole = f"{text}\n{DRIVER.replace('NAME', name)}"
    with TemporaryDirectory() as folder:
        program = Path(folder) / "main"
        made = subprocess.run(
            [found, *flags, "-x", "c", "-", "-x", "none", "-o", str(program), "-lm"], input=whole,
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if made.returncode != 0:
            raise ValueError(f"{found} refuses the exported file: {made.stderr.strip()[:400]}")
        ran = subprocess.run(
            [str(program)], input=np.ascontiguousarray(commands, np.float64).tobytes(),
            capture_output=True, check=True,
        )  # fmt: skip
    return np.frombuffer(ran.stdout, dtype=np.float64).copy()
