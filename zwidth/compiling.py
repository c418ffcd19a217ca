"""Say that the kernels are being compiled, where a command has to wait for it."""

from zwidth.console import Console
from zwidth.sim.jit import cache_folder


def announce(console: Console) -> None:
    """Tell people why the first call of a version takes longer than all later ones."""
    folder = cache_folder()
    if not any(folder.rglob("*.nbc")):
        console.say(f"compiling the kernels, once for this version (about 20 s), into {folder}")
