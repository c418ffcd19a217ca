"""Work before the first page opens: compiles every kernel that a slider may call."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from zwidth.explore.bench import Bench
from zwidth.explore.look import look
from zwidth.explore.view import View
from zwidth.stability.fates import evaluate

NEVER_FELT = 1e-12  # a level of friction that only loads its kernel


def steps(bench: Bench) -> list[tuple[str, Callable[[], object]]]:
    """Return the steps of the preparation: name and function."""
    found: list[tuple[str, Callable[[], object]]] = []
    for number, device in enumerate(bench.devices):
        view = replace(bench.fitted(View(device=number)), stiffness=1.0, damping=0.0)
        dry = replace(view, friction=NEVER_FELT)
        found += [
            (f"for a run of {device.name}", lambda v=dry: look(bench, v)),
            (f"for the K-B plane of {device.name}", lambda v=view: _one_point(bench, v)),
            ("for the same plane with friction", lambda v=dry: _one_point(bench, v)),
        ]
    return found


def _one_point(bench: Bench, view: View) -> None:
    evaluate(bench.plane(view), np.array([0.0]), np.array([1.0]), workers=1)
