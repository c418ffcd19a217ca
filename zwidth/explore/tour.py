"""A tour of three steps for new users: three addresses, each with what to look at."""

from dataclasses import dataclass, replace
from html import escape

from zwidth.explore.bench import Bench
from zwidth.explore.view import View

BELOW, BEYOND = 0.6, 1.2  # K of the tour's walls, over the linear boundary
DAMPING = 0.25  # damping of the walls, over the largest in the plane
COARSE = 0.1  # encoder step of the tour, over the start amplitude
SEEN = ("device", "delay", "encoder_step", "command_limit", "friction", "start", "one_sided",
        "stiffness", "damping")  # fmt: skip


@dataclass(frozen=True)
class Step:
    """One step: its name, the view, and what to look at there."""

    name: str
    view: View
    sentence: str

    def shows(self, view: View) -> bool:
        """Whether a view is that of this step, whatever part of it is shown."""
        return all(getattr(view, name) == getattr(self.view, name) for name in SEEN)


def steps(bench: Bench) -> tuple[Step, ...]:
    """Return the steps for the first device of a bench; none if it has no stable wall."""
    first = bench.fitted(View())
    assert first.damping_range is not None
    damping = _short(DAMPING * first.damping_range[1])
    critical = bench.line(first).at(damping)
    if critical is None:
        return ()
    stable = View(damping=damping, stiffness=_short(BELOW * critical[0]))
    beyond = replace(stable, stiffness=_short(BEYOND * critical[0]))
    coarse = replace(stable, encoder_step=COARSE * stable.start)
    return (
        Step("below the boundary", stable, "The marked wall lies below the black line, where linear"
             " theory calls walls stable. The run beside it shows whether it comes to rest."),
        Step("beyond it", beyond, "The same damping with a stiffness beyond the black line. The run"
             " grows, near the frequency of linear theory (dashed in the spectrum)."),
        Step("a coarse encoder", coarse, "The first wall again, now with an encoder step that is a"
             " tenth of the start amplitude. Compare the colours below the black line with those of"
             " the first step: linear theory does not include the step."),
    )  # fmt: skip


def links(bench: Bench, view: View) -> str:
    """Return the tour as a line of HTML: its links, and what to look at in the present step."""
    found = steps(bench)
    if not found:
        return ""
    parts: list[str] = []
    said = ""
    for number, step in enumerate(found, 1):
        name = f"{number} {escape(step.name)}"
        if step.shows(view):
            parts.append(f"<b>{name}</b>")
            said = f" {escape(step.sentence)}"
        else:
            parts.append(f'<a href="?{escape(step.view.query())}">{name}</a>')
    return f"Tour: {' &middot; '.join(parts)}.{said}"


def _short(value: float) -> float:
    return float(f"{value:.2g}")
