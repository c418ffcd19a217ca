"""Additions to a boundary: passive walls, a hand that holds the device, uncertain parameters."""

import numpy as np

from zwidth.figures.beside import Band, beside_figure
from zwidth.identification.fit import fit_response
from zwidth.paper.content import Picture, Section, Table
from zwidth.paper.identification import experiment
from zwidth.paper.theory import COLOUR, DELAYS, lines, ms, phantom
from zwidth.stability.hand import DAMPING, MASS, STIFFNESS, hand_band
from zwidth.stability.linear import boundary, last_stable_damping
from zwidth.stability.passivity import passive_boundary
from zwidth.stability.uncertainty import stiffness_band

LEVER = 0.14  # [m], length of each link of the device; the place of the tip depends on the pose
GRID = 25
DRAWS = 40
COMMAND = (
    "zwidth boundary phantom_1_0 --delay-ms 2 4 8 --criterion passivity --hand --lever"
    f" {LEVER:g} --covariance FILE"
)


def section() -> Section:
    """Return the bands around the 2, 4 and 8 ms boundaries, and the passive walls below them."""
    fit = fit_response(experiment(), 2)
    panels: list[Band] = []
    rows: list[list[str]] = []
    for delay in DELAYS:
        device = phantom(delay)
        last = last_stable_damping(device) or 0.0
        grid = np.linspace(0.0, last * (1.0 - 1e-6), GRID)
        hand = hand_band(device, grid, LEVER)
        sure = stiffness_band(device, fit.names, fit.covariance, grid, DRAWS)
        limit = float(device.chain.ground_dampers.sum())
        passive = np.linspace(0.0, limit, 9)
        walls = [p.stiffness or 0.0 for p in passive_boundary(device, passive)]
        panels.append(
            Band(ms(delay), COLOUR[delay], lines(device), grid, np.array(hand), np.array(sure),
                 passive, np.array(walls))
        )  # fmt: skip
        free = boundary(device, [0.0])[0].stiffness or 0.0
        top = int(np.argmax([low for low, _ in hand]))
        rows.append([
            ms(delay), f"{walls[0]:.3f}", f"{limit:.5f}", f"{free:.3f}",
            f"{hand[0].low:.2f} to {hand[0].high:.2f}",
            f"{hand[top].low:.1f} to {hand[top].high:.1f} at {grid[top]:.3f}",
            f"{100.0 * max((h - low) / h for low, h in sure[: GRID // 2]):.2g} %",
        ])  # fmt: skip
    return Section(
        "What users ask next: passive walls, a hand, uncertain parameters",
        (
            "Stability with nobody holding the device is one question; the next are what no"
            " passive hand can make unstable (Colgate and Schenkel, here with the delay, exact over"
            " frequency), and what a real finger does. The finger is a mass, a spring and a damper"
            " at m3, each over the range ascribed to the index finger by Hajian and Howe (1997):"
            f" {1e3 * MASS.low:g} to {1e3 * MASS.high:g} g, {DAMPING.low:g} to {DAMPING.high:g}"
            f" N s/m, {STIFFNESS.low:g} to {STIFFNESS.high:g} N/m (numbers yet to be verified in"
            f" that paper), at {LEVER:g} m from the axis, a link's length.",
            Picture(
                "beside", beside_figure(panels),
                "K_CR of the free device (line), with a finger (light band), by the 95 % covariance"
                " of the parameters identified for Fig. 3 (dark band, from"
                f" {DRAWS} draws; on this simulated recording it is no wider than the line), and"
                " the passive walls (filled corner at the origin, enlarged in the insets).",
                COMMAND,
            ),
            Table(
                "Passive walls end at |B| = b of the device, whatever the delay. A finger damps the"
                " slow oscillation and lifts most of part I, at B = 0 up to tenfold; near B_t at 4"
                " and 8 ms a stiff one lowers it. Beyond B_t it changes hardly anything.",
                ["delay", "passive K at B = 0", "passive B up to", "free K at B = 0",
                 "with a finger", "best with a finger", "95 % band, widest in part I"],
                rows, COMMAND,
            ),
        ),
    )  # fmt: skip
