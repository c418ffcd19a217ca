"""B_t and K_max over continuous delay: where the damper makes the next resonance critical."""

import numpy as np

from zwidth.figures.delays import delay_figure
from zwidth.paper.content import Picture, Section
from zwidth.paper.theory import phantom
from zwidth.stability.linear import corner, last_stable_damping

DELAYS = np.arange(0.0, 10.0 + 1e-9, 0.2)


def section() -> Section:
    """Return the map over delays 0 to 10 ms in steps of 0.2 ms."""
    tops = [corner(phantom(1e-3 * float(d))) for d in DELAYS]
    found = [(d, t) for d, t in zip(DELAYS.tolist(), tops, strict=True) if t is not None]
    at = np.array([d for d, _ in found])
    damping = np.array([t.damping for _, t in found])
    stiffness = np.array([t.stiffness for _, t in found])
    above = np.array([t.frequency_above_hz for _, t in found])
    last = np.array([last_stable_damping(phantom(1e-3 * d)) or np.nan for d in at.tolist()])
    inside = (at >= 1.0) & (at <= 6.0)
    best = int(np.flatnonzero(inside)[np.argmax(damping[inside])])
    worst = int(np.flatnonzero((at >= 1.0) & (at <= at[best]))[
        np.argmin(stiffness[(at >= 1.0) & (at <= at[best])])
    ])  # fmt: skip
    peak = worst + int(np.argmax(stiffness[worst : best + 10]))
    return Section(
        "B_t and K_max over every delay from 0 to 10 ms",
        (
            Picture(
                "delays", delay_figure(at, damping, last, stiffness, above),
                "Corner B_t, largest stiffness K_max and the frequency just beyond B_t, over the"
                " loop's delay in steps of 0.2 ms; circles are the three delays of the paper. A"
                " delay that is no multiple of T changes the held command inside a tick, exactly."
                " Where f beyond B_t is low, the top is smooth: no other branch meets it.",
                "zwidth paper --section delays",
            ),
            "The region does not shrink steadily. Between 1 and 6 ms B_t rises to"
            f" {damping[best]:.3f} at {at[best]:.1f} ms, and K_max has a valley of"
            f" {stiffness[worst]:.1f} at {at[worst]:.1f} ms and a second summit of"
            f" {stiffness[peak]:.1f} at {at[peak]:.1f} ms: on this device a loop of"
            f" {at[worst]:.1f} ms gains stiffness by waiting {at[peak] - at[worst]:.1f} ms longer.",
        ),
    )  # fmt: skip
