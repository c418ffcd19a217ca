"""How many files of zwidth a command passes through: those of which at least one function ran.

    python -m benchmarks.flow diagnose recording.csv --effort quick --out /tmp/runs

Runs the command in this process, as `zwidth` would, and prints the files by folder with how many of
their functions ran. What is compiled is no function of Python and is not seen, nor is what runs
while a module is imported.
"""

import sys
import threading
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

ROOT = Path(__file__).parent.parent.resolve()


class Flow:
    """The functions of zwidth that were called: code -> file, "" for what is not ours."""

    def __init__(self) -> None:
        self.files: dict[CodeType, str] = {}

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Take note of a call; as `sys.setprofile` wants it."""
        if event == "call" and frame.f_code not in self.files:
            self.files[frame.f_code] = self._ours(frame.f_code)

    def _ours(self, code: CodeType) -> str:
        if code.co_name == "<module>":
            return ""
        file = Path(code.co_filename).resolve()
        inside = file.is_relative_to(ROOT) and "site-packages" not in file.parts
        return str(file.relative_to(ROOT)) if inside and file != Path(__file__).resolve() else ""

    def functions(self) -> dict[str, int]:
        """Return each file with how many of its functions were called."""
        found: dict[str, int] = defaultdict(int)
        for file in self.files.values():
            if file and not file.startswith("."):
                found[file] += 1
        return dict(sorted(found.items()))


def followed(arguments: Sequence[str]) -> tuple[int, dict[str, int]]:
    """Run a command line of zwidth; return its exit status and `Flow.functions`."""
    from zwidth.cli import run

    flow = Flow()
    threading.setprofile(flow)
    sys.setprofile(flow)
    try:
        status = run(arguments)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # pyright: ignore[reportArgumentType]  # takes None, as `sys`'s
    return status, flow.functions()


def main() -> int:
    """Follow the command line of this process."""
    if len(sys.argv) < 2:
        print(__doc__, file=sys.stderr)
        return 2
    status, found = followed(sys.argv[1:])
    folders: dict[str, list[str]] = defaultdict(list)
    for file, functions in found.items():
        folders[str(Path(file).parent)].append(f"{Path(file).stem} {functions}")
    for folder, files in folders.items():
        print(f"{folder} ({len(files)}): {', '.join(files)}")
    print(f"{len(found)} files, {sum(found.values())} functions")
    return status


if __name__ == "__main__":
    sys.exit(main())
