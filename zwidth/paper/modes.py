"""Why f jumps and why the 4 ms region is larger: root loci by mode, the damper's own phase."""

import numpy as np

from zwidth.figures.modes import Locus, Piece, critical_figure, damper_figure, loci_figure
from zwidth.paper.content import Picture, Section, Table
from zwidth.paper.theory import COLOUR, DELAYS, ms, phantom
from zwidth.sim.modal import ModalModel
from zwidth.stability.branches import RIGID, critical_mode, damper_effect, damping_locus
from zwidth.stability.linear import boundary, corner, last_stable_damping

STEPS = 160
GRID = 60
COMMAND = "zwidth paper --section modes"


def section() -> Section:
    """Return loci over B, the boundary by critical mode, and the late damper's effect."""
    model = phantom(0.002).modal
    assert model is not None
    modal_hz = damped_hz(model)
    return Section(
        "Why f jumps, and why the 4 ms region is larger: root loci and the late damper",
        (
            "The paper sees f jump and leaves open why. Followed continuously from K = B = 0, each"
            " eigenvalue keeps the name of the mode it starts from. The boundary is the least K at"
            " which any of them leaves the stable half: for small B it is the rigid body against"
            " the spring, beyond B_t a faster oscillation that the damper itself drives: mode 2"
            " at 2 and 8 ms, at 4 ms one that no mode owns. f jumps because two different"
            " oscillations, each continuous in B, change places.",
            Picture(
                "modes_critical", critical_figure(_pieces()),
                "The boundary by what goes unstable on it: rigid body (thin), a mode, or an"
                " oscillation that grows out of the stored commands of the delay line.",
                COMMAND,
            ),
            Picture(
                "modes_loci", loci_figure(_loci()),
                "Root loci at K = 0 as B rises from 0 (dot) to 1.3 times the last stable B (arrow):"
                " decay rate and frequency of each mode, and of"
                " what starts in the delay line. Left of zero an oscillation grows; it"
                " crosses at the last stable B (circle). Both axes hold for one tick: z = exp(sT).",
                COMMAND,
            ),
            "A damper whose force comes late by the delay, half a hold and half a difference turns"
            " its force by about 360 f (T + t_d) degrees. Its real part, over a true damper of the"
            " same B, says what it does to a mode at frequency f: at +1 it damps, below 0 it"
            " drives.",
            Picture(
                "modes_damper", damper_figure(_effects(), modal_hz),
                "What the delayed damper does, over a true damper of the same B. Upright lines: the"
                " modes of the device, at the frequency at which they ring.", COMMAND,
            ),
            Table(
                "The damper's effect at each mode, and the mode that ends the region there.",
                ["delay", *[f"at mode {i + 1} ({f:.0f} Hz)" for i, f in enumerate(modal_hz)],
                 "B_t", "goes unstable beyond B_t", "at [Hz]", "last B"],
                _rows(model), COMMAND, (0, 4),
            ),
            _verdict(model),
        ),
    )  # fmt: skip


def damped_hz(model: ModalModel) -> list[float]:
    """Return the frequency of the free oscillation of each mode."""
    return [
        float(np.sqrt(mode.omega**2 - 0.25 * mode.c**2) / (2.0 * np.pi)) for mode in model.modes
    ]


def _pieces() -> list[Piece]:
    """The boundary of each delay, its points named by the mode that is critical there."""
    pieces: list[Piece] = []
    for delay in DELAYS:
        device = phantom(delay)
        top = corner(device)
        last = last_stable_damping(device)
        assert top is not None
        assert last is not None
        dampings = np.union1d(
            np.linspace(0.0, last * (1.0 - 1e-6), GRID),
            [
                top.damping * (1.0 - 1e-6),
                *np.linspace(top.damping * (1.0 + 1e-6), last * (1.0 - 1e-6), GRID // 3),
            ],
        )
        found = [p for p in boundary(device, dampings) if p.stable]
        named = [(p, critical_mode(device, p) or "") for p in found]
        pieces.append(
            Piece(
                ms(delay),
                np.array([p.damping for p, _ in named]),
                np.array([p.stiffness for p, _ in named]),
                np.array([p.frequency_hz for p, _ in named]),
                tuple(name for _, name in named),
            )
        )
    return pieces


def _loci() -> list[Locus]:
    loci: list[Locus] = []
    for delay in DELAYS:
        device = phantom(delay)
        last = last_stable_damping(device) or 0.0
        branches = damping_locus(device, np.linspace(0.0, 1.3 * last, STEPS))
        chosen = [i for i, name in enumerate(branches.names) if name != RIGID]
        names = tuple(branches.names[i] for i in chosen)
        loci.append(
            Locus(
                ms(delay), names, branches.gains, branches.decay[:, chosen],
                branches.frequency_hz[:, chosen], last,
            )
        )  # fmt: skip
    return loci


def _effects() -> list[tuple[str, str, np.ndarray, np.ndarray]]:
    frequency = np.linspace(1.0, 400.0, 800)
    return [
        (ms(d), COLOUR[d], frequency, damper_effect(phantom(d), frequency).real) for d in DELAYS
    ]


def _rows(model: ModalModel) -> list[list[str]]:
    rows: list[list[str]] = []
    frequencies = damped_hz(model)
    for delay in DELAYS:
        device = phantom(delay)
        top, last = corner(device), last_stable_damping(device)
        assert top is not None
        assert last is not None
        (beyond,) = boundary(device, [0.5 * (top.damping + last)])
        effects = damper_effect(device, frequencies).real
        rows.append([
            ms(delay), *[f"{e:+.2f}" for e in effects], f"{top.damping:.4f}",
            critical_mode(device, beyond) or RIGID, f"{beyond.frequency_hz or 0.0:.0f}",
            f"{last:.4f}",
        ])  # fmt: skip
    return rows


def _verdict(model: ModalModel) -> str:
    second = damped_hz(model)[1]
    at = [float(damper_effect(phantom(d), second).real) for d in DELAYS]
    top = corner(phantom(0.004))
    assert top is not None
    early = float(damper_effect(phantom(0.004), top.frequency_above_hz).real)
    return (
        f"So the 4 ms region is larger because of a phase, not in spite of one. At mode 2"
        f" ({second:.0f} Hz) the virtual damper acts with {at[0]:+.2f}, {at[1]:+.2f} and"
        f" {at[2]:+.2f} of its strength at 2, 4 and 8 ms. At 2 and 8 ms it feeds the mode, which"
        " gives way near B = 0.1. At 4 ms it has come full circle and damps the mode. What ends the"
        " region there is no mode of the device at all: it is an oscillation of the loop itself,"
        f" out of the commands on their way, at {top.frequency_above_hz:.0f} Hz. There the damper"
        f" drives with only {early:+.2f} of its strength, so it takes more than twice the B."
    )
