"""The sections of the report, in its order, and one worker that computes any of them."""

import time
from importlib import import_module

from zwidth.paper.report import DrawnSection, draw

# key (of the command line and of the file zwidth/paper/KEY.py) -> what the section shows.
SECTIONS = {
    "identification": "Fig. 3 and Table I: the device identified",
    "boundaries": "Fig. 6 and Fig. 7: critical stiffness and ultimate frequency over damping",
    "modes": "Why f jumps, and why the 4 ms region is larger: root loci and the late damper",
    "delays": "B_t and K_max over every delay from 0 to 10 ms",
    "sensitivity": "What B_t and K_max owe to each of the ten parameters",
    "beside": "What users ask next: passive walls, a hand, uncertain parameters",
    "relay": "Fig. 8 and the relay: what the method measures, and how far off",
    "fig_10": "Table II and Fig. 10: theory against the real device",
    "inversion": "Table II read as measurements of the plant",
    "explained": "Which physics explains Table II",
    "paddle": "A measured boundary on another device: a haptic paddle",
}


def compute(key: str) -> DrawnSection:
    """Compute a section and draw its pictures; raises what its computation raises."""
    start = time.perf_counter()
    section = import_module(f"zwidth.paper.{key}").section()
    return draw(key, section, time.perf_counter() - start)
