"""The sensitivities of B_t and K_max to each of the ten parameters."""

from zwidth.figures.sensitivity import sensitivity_figure
from zwidth.paper.content import Picture, Section
from zwidth.paper.theory import COLOUR, DELAYS, ms, phantom
from zwidth.stability.sensitivity import corner_sensitivities


def section() -> Section:
    """Return the sensitivities at the three delays, and their interpretation."""
    found = {delay: corner_sensitivities(phantom(delay)) for delay in DELAYS}
    words: list[str] = []
    for delay, rows in found.items():
        first, second = sorted(rows, key=lambda row: -abs(row.damping))[:2]
        words.append(
            f"at {ms(delay)} B_t answers to {first.parameter} ({first.damping:+.2f}) and"
            f" {second.parameter} ({second.damping:+.2f})"
        )
    figure = sensitivity_figure([(ms(d), COLOUR[d], rows) for d, rows in found.items()])
    return Section(
        "What B_t and K_max owe to each of the ten parameters",
        (
            Picture(
                "sensitivity", figure,
                "Relative sensitivities: per cent of B_t (left) and of K_max (right) for one per"
                " cent of each parameter of Table I.", "zwidth paper --section sensitivity",
            ),
            "Strongest: " + "; ".join(words) + ". The virtual damping that a device stands is a"
            " property of its modes, hardly of its rigid body's damping b.",
        ),
    )  # fmt: skip
