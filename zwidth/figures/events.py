"""An event over time: its force with the 95 % band, and the motion there."""

from dataclasses import replace

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from zwidth.diagnosis.answer.events import SLIP, STOP, TOUCH, UNEXPLAINED, Course, Event
from zwidth.figures.style import AFTER, BEFORE, INTERVAL, STYLE, pushing
from zwidth.sim.readable import scaled

FORCE, MOTION, WHEN = BEFORE, AFTER, INTERVAL
STEPS = 400  # most steps of a course: the resolution of a picture


def events_figure(event: Event) -> Figure:
    """Return force (or slip) and motion about an event, over the time of its recording."""
    own = coarse(event.course)
    factor, unit = scaled(float(np.abs(own.force).max()), own.unit)
    far, length = scaled(float(np.abs(own.motion).max()), own.length)
    pushed = pushing("N m" in own.unit)[0]
    what = "off by" if event.kind == SLIP and own.unit == own.length else pushed
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.2), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True)
        top.fill_between(own.times, factor * own.lower, factor * own.upper, step="post",
                         color=FORCE, alpha=0.25, linewidth=0.0, label="95 %")  # fmt: skip
        top.step(own.times, factor * own.force, where="post", color=FORCE, label="as fitted")
        bottom.plot(own.times, far * own.motion, color=MOTION, label="motion there")
        for ax in (top, bottom):
            ends = event.between if event.until_between is None else (
                event.between[0], event.until_between[1],
            )  # fmt: skip
            ax.axvspan(*ends, color=WHEN, zorder=0, label="when, 95 %" if ax is top else None)
        top.set_ylabel(f"{what} [{unit or '1'}]")
        bottom.set_ylabel(f"{event.place.replace('_', ' ')} [{length}]")
        bottom.set_xlabel(f"time in {event.recording} [s]")
        words = {STOP: "A hit on a stop", TOUCH: "A hand or another contact",
                 UNEXPLAINED: "No contact explains this"}  # fmt: skip
        name = words.get(event.kind, f"A {event.kind}")
        top.set_title(f"{name}: {pushed} and motion over time" if what == pushed
                      else f"{name}: the error of the reading, and the reading")  # fmt: skip
        figure.legend(loc="outside lower center", ncols=4)
    return figure


def coarse(course: Course) -> Course:
    """Return a course of at most `STEPS` steps: the largest force in each, and all of its band."""
    size = course.times.size
    first = np.arange(0, size, -(-size // STEPS))
    ends = np.append(first[1:], size).tolist()
    steps = zip(first.tolist(), ends, strict=True)
    largest = [begin + int(np.abs(course.force[begin:end]).argmax()) for begin, end in steps]
    return replace(
        course, times=course.times[first], force=course.force[largest],
        lower=np.fmin.reduceat(course.lower, first), upper=np.fmax.reduceat(course.upper, first),
        motion=course.motion[first],
    )  # fmt: skip
