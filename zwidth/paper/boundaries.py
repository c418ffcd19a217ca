"""Fig. 6 and Fig. 7: theory at three delays, with and without vibration modes."""

import numpy as np

from zwidth.figures.curves import THEIRS, Curve, curves_figure, key
from zwidth.paper.appendix import appendix
from zwidth.paper.content import Picture, Section, Table, number
from zwidth.paper.theory import COLOUR, DELAYS, lines, ms, phantom
from zwidth.sim.ladder import frequency_response
from zwidth.stability.linear import corner, last_stable_damping

OURS = 3.2  # width of a line under another line
FIG_6 = "zwidth boundary phantom_1_0 --delay-ms 2 4 8"


def section() -> Section:
    """Return both figures, and the tops of the three regions."""
    ours, theirs, rows = [], [], []
    for delay in DELAYS:
        device = phantom(delay)
        last = last_stable_damping(device) or 0.0
        printed = appendix(delay, last)
        ours.append(Curve(*lines(device), COLOUR[delay], width=OURS))
        theirs.append(
            Curve(printed.damping, printed.stiffness, printed.frequency_hz, "black", THEIRS, 1.0)
        )
        top = corner(device)
        assert top is not None
        best = int(np.argmax(printed.stiffness))
        rows.append([
            ms(delay), number(top.damping, 5), number(printed.damping[best], 3),
            number(top.stiffness, 6), number(printed.stiffness[best], 6),
            f"{top.frequency_below_hz:.2f} to {top.frequency_above_hz:.1f}", number(last, 5),
        ])  # fmt: skip
    legend = [key(f"{ms(d)}, ours", COLOUR[d]) for d in DELAYS]
    legend.append(key("theirs (Appendix I)", "black", THEIRS))
    return Section(
        "Fig. 6 and Fig. 7: critical stiffness and ultimate frequency over damping",
        (
            "The boundary is the first K, going up from 0, at which an eigenvalue of the exact"
            " one-tick loop reaches the unit circle. Theirs is the paper's own program with its"
            " rounded coefficients, its lost parentheses put back, and its steps of 0.001 in B.",
            Picture(
                "fig_6", curves_figure([*ours, *theirs], legend=legend),
                "Fig. 6. Critical stiffness and ultimate frequency at 2, 4 and 8 ms. Each region"
                " ends at the last B with any stable K; beyond it the gain margin of their program"
                " still prints numbers (not drawn), which are no boundary.", FIG_6,
            ),
            Table(
                "Tops of the three regions. The corner B_t is where the slow branch and a modal"
                " branch cross; theirs is the largest point on a grid of 0.001.",
                ["delay", "B_t", "theirs", "K_max", "theirs", "f across B_t [Hz]", "last B"],
                rows, FIG_6,
            ),
            *_fig_7(),
        ),
    )  # fmt: skip


def _fig_7() -> tuple[Picture, str]:
    device = phantom(0.002)
    rigid = device.rigid()
    with_modes, without = lines(device), lines(rigid)
    printed = appendix(0.002, last_stable_damping(device) or 0.0)
    inside = without[0] <= 0.2
    figure = curves_figure(
        [
            Curve(*with_modes, COLOUR[0.002], width=OURS),
            Curve(without[0][inside], without[1][inside], without[2][inside], "0.45"),
            Curve(printed.damping, printed.stiffness, printed.frequency_hz, "black", THEIRS, 1.0),
        ],
        legend=[
            key("two modes, ours", COLOUR[0.002]), key("rigid body, ours", "0.45"),
            key("two modes, theirs", "black", THEIRS),
        ],
    )  # fmt: skip
    shared = 0.05
    k_modes, k_rigid = (np.interp(shared, v[0], v[1]) for v in (with_modes, without))
    frequency = float(np.interp(shared, with_modes[0], with_modes[2]))
    share = abs(
        frequency_response(device.chain, np.array([frequency]))[0]
        / frequency_response(rigid.chain, np.array([frequency]))[0]
    )
    top, rigid_top = corner(device), corner(rigid)
    assert top is not None
    assert rigid_top is not None
    return (
        Picture(
            "fig_7", figure,
            "Fig. 7. The same device at 2 ms with its modes and as one rigid body of the same"
            " inertia and damping (drawn up to B = 0.2).",
            "zwidth paper --section boundaries",
        ),
        f"Modes end the region at B = {top.damping:.4f}, K = {top.stiffness:.1f}; the rigid body"
        f" would reach K = {rigid_top.stiffness:.0f} at B = {rigid_top.damping:.2f}. Below that the"
        f" modes help: at B = {shared} K_CR is {k_modes:.2f} with them and {k_rigid:.2f} without."
        " Each mode has its antiresonance below its resonance, so at the"
        f" {frequency:.0f} Hz at which the wall oscillates"
        f" there, the device moves {100.0 * share:.1f} % as much"
        " under the same torque as the rigid body does.",
    )  # fmt: skip
