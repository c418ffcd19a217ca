"""The report of a fleet as one HTML file: a row for each device, which opens its recordings."""

import html
import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from zwidth.figures.fleet import fleet_figure
from zwidth.figures.style import picture_bytes
from zwidth.files.whole import write_text
from zwidth.fleet.reasons import in_words
from zwidth.fleet.result import Fleet, Member
from zwidth.report_page import embedded, page
from zwidth.sim.readable import percent, with_unit

Floats = NDArray[np.float64]
WIDE, HIGH = 110, 22  # pixels of a spark line
RUN_WIDE, RUN_HIGH = 420, 90  # of the picture of a recording
MANY = 2000  # recordings, above which only noteworthy devices are shown
BEYOND = 6.0  # deviations at which a spark line is cut off


@dataclass(frozen=True)
class Row:
    """A device: the content of its row, and its recordings."""

    name: str
    remark: str
    changed: bool
    sparks: Sequence[Markup]
    members: Sequence["Recording"]


@dataclass(frozen=True)
class Recording:
    """A recording behind a device's row."""

    name: str
    date: str
    values: Sequence[str]
    free: str
    remark: str
    odd: bool
    picture: Markup
    line: str


def save_fleet_report(fleet: Fleet, line: str, device: Path, path: Path) -> Path:
    """Write the report; line: the command line to repeat; device: file of the typical device."""
    names = list(fleet.spreads)
    wide = {n: _width(fleet, n) for n in names}
    told = {c.device for c in fleet.changes} | {m.listed.device for m in fleet.odd}
    shown = [d for d in fleet.devices if len(fleet.members) <= MANY or d in told]
    heads = [f"{in_words(n).rstrip(',')}" for n in names]
    text = page(
        "fleet_report.html",
        {},
        fleet=fleet,
        heads=heads,
        parameters=[fleet.said_of_parameter(n) for n in names],
        changes=[fleet.said_of(c) for c in fleet.changes],
        odd=[m for m in fleet.odd if m.reason],
        rows=[_row(fleet, d, names, device, wide) for d in shown],
        left=len(fleet.devices) - len(shown),
        picture=embedded(picture_bytes(fleet_figure(fleet))),
        candidates=sorted(fleet.candidates.items(), key=lambda pair: pair[1])[:6],
        line=line,
    )
    return write_text(path, text)


def _width(fleet: Fleet, name: str) -> float:
    """What a parameter of the fleet's recordings scatters by."""
    place = list(fleet.names).index(name)
    every = np.array([m.quick.values[place] for m in fleet.members if m.pooled])
    return max(float(every.std()), 0.02 * abs(fleet.spreads[name].center.value), 1e-300)


def _row(
    fleet: Fleet, device: str, names: Sequence[str], file: Path, wide: Mapping[str, float]
) -> Row:
    members = fleet.of(device)
    changes = [c for c in fleet.changes if c.device == device]
    remarks = [fleet.said_of(c) for c in changes]
    kinds: dict[str, int] = {}
    for m in members:
        if m.reason is not None:
            kinds[m.reason.kind] = kinds.get(m.reason.kind, 0) + 1
    remarks += [f"{kind.replace('_', ' ')} in {n} of {len(members)}" for kind, n in kinds.items()]
    sparks = [_spark(fleet, members, name, wide[name]) for name in names]
    each = [_recording(fleet, m, names, file) for m in members]
    return Row(device, "; ".join(remarks), bool(changes), sparks, each)


def _spark(fleet: Fleet, members: Sequence[Member], name: str, wide: float) -> Markup:
    """A line of a parameter over a device's recordings, in the fleet's range."""
    place, s = list(fleet.names).index(name), fleet.spreads[name]
    own = [m for m in members if not m.quick.problem]
    if not own:
        return Markup("-")
    y = np.array([(m.quick.values[place] - s.center.value) / wide for m in own])
    y = np.clip(y, -BEYOND, BEYOND)
    x = np.linspace(4, WIDE - 4, y.size) if y.size > 1 else np.array([WIDE / 2])
    v = 0.5 * HIGH - y / BEYOND * (0.5 * HIGH - 3)
    line = " ".join(f"{a:.1f},{b:.1f}" for a, b, m in zip(x, v, own, strict=True) if m.pooled)
    dots = "".join(
        f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{1.6 if m.pooled else 2.8}"'
        f' class="{"sound" if m.pooled else "odd"}"/>'
        for a, b, m in zip(x, v, own, strict=True)
    )
    return Markup(
        f'<svg class="spark" width="{WIDE}" height="{HIGH}" role="img"'
        f' aria-label="{html.escape(in_words(name))} over the recordings">'
        f'<line x1="0" x2="{WIDE}" y1="{HIGH / 2}" y2="{HIGH / 2}" class="middle"/>'
        f'<polyline points="{line}"/>{dots}</svg>'
    )


def _recording(fleet: Fleet, m: Member, names: Sequence[str], file: Path) -> Recording:
    q = m.quick
    units = fleet.names
    places = [list(units).index(n) for n in names]
    values = ["-"] * len(names)
    if not q.problem:
        values = [
            "says nothing"
            if not math.isfinite(q.errors[k])
            else f"{with_unit(float(q.values[k]), units[n])}"
            f" +- {with_unit(1.96 * float(q.errors[k]), units[n])}"
            for k, n in zip(places, names, strict=True)
        ]
    remark = "" if m.reason is None else m.reason.sentence
    line = shlex.join(["zwidth", "diagnose", str(m.listed.path), "--device", str(file)])
    return Recording(
        m.listed.name, "" if m.listed.date is None else m.listed.date.date().isoformat(),
        values, "" if q.problem else percent(q.free), remark, m.reason is not None,
        _run(q.drawn), line,
    )  # fmt: skip


def _run(drawn: Floats) -> Markup:
    """The first output as measured, and as the fit runs freely."""
    if drawn.size == 0:
        return Markup("")
    low, high = float(drawn[0].min()), float(drawn[0].max())
    span = max(high - low, 1e-300)
    x = np.linspace(0.0, RUN_WIDE, drawn.shape[1])
    y = RUN_HIGH - (np.clip((drawn - low) / span, -0.1, 1.1) * 0.8 + 0.1) * RUN_HIGH
    lines = "".join(
        f'<polyline class="{kind}" points="'
        + " ".join(f"{a:.0f},{b:.1f}" for a, b in zip(x, row, strict=True))
        + '"/>'
        for kind, row in zip(("measured", "model"), y, strict=True)
    )
    return Markup(
        f'<svg class="run" width="{RUN_WIDE}" height="{RUN_HIGH}" role="img"'
        f' aria-label="measured, and the model running freely">{lines}</svg>'
    )
