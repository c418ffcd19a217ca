"""Everything that the page shows, as one value; in the page's address it is a query."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args
from urllib.parse import urlencode

Layer = Literal["fate", "amplitude", "frequency"]
LAYERS: tuple[Layer, ...] = get_args(Layer)
Span = tuple[float, float]


@dataclass(frozen=True)
class View:
    """What is shown. Units are those of the device, rad and N m or m and N; times are in s.

    device: its number, from 0. delay to friction: None if the device's own value is meant.
    start: amplitude. stiffness, damping: the wall whose run is shown, None for none yet. damping_
    and stiffness_range: axes of the plane, None if they fit the boundary. time_range: part of
    the run that is shown, None for all. recording_from: time in the recording at t = 0 of the run.
    """

    device: int = 0
    layer: Layer = "fate"
    delay: float | None = None
    encoder_step: float | None = None
    command_limit: float | None = None
    friction: float | None = None
    start: float = 1e-3
    one_sided: bool = False
    stiffness: float | None = None
    damping: float | None = None
    damping_range: Span | None = None
    stiffness_range: Span | None = None
    time_range: Span | None = None
    recording_from: float = 0.0

    def query(self) -> str:
        """Return the query of an address, without default values."""
        first = View()
        pairs = [
            (KEYS[f.name][0], _text(getattr(self, f.name)))
            for f in fields(self)
            if getattr(self, f.name) != getattr(first, f.name)
        ]
        return urlencode(pairs, safe=",")


# Fields on which the plane, and the run of the chosen wall, depend.
OF_THE_PLANE = (
    "device", "delay", "encoder_step", "command_limit", "friction", "start", "one_sided",
    "damping_range", "stiffness_range",
)  # fmt: skip
OF_THE_RUN = (*OF_THE_PLANE[:7], "stiffness", "damping")


def differ(one: View, other: View, names: Sequence[str]) -> bool:
    """Whether two views differ in any of these parts."""
    return any(getattr(one, name) != getattr(other, name) for name in names)


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return ",".join(_text(v) for v in value)  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, bool):
        return str(int(value))
    return repr(value) if isinstance(value, float) else str(value)


def _number(lowest: float, *, above: bool = False, infinite: bool = False) -> Callable[[str], Any]:
    words = f"a number {'above' if above else 'of'} {lowest:g}{' or more' if not above else ''}"

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        large_enough = value > lowest if above else value >= lowest
        if not large_enough or (math.isinf(value) and not infinite) or 1e15 < value < math.inf:
            raise ValueError(words)
        return value

    return read


def _span(lowest: float) -> Callable[[str], Span]:
    def read(text: str) -> Span:
        try:
            start, stop = (_number(lowest)(part) for part in text.split(","))
            if start < stop:
                return start, stop
        except ValueError:
            pass
        raise ValueError(
            f"two numbers of {lowest:g} or more, the smaller first, separated by a comma"
        )

    return read


def _whole(text: str) -> int:
    if not (text.isdecimal() and text.isascii() and len(text) < 5):
        raise ValueError("a whole number of 0 or more")
    return int(text)


def _layer(text: str) -> str:
    if text not in LAYERS:
        raise ValueError(f"one of {', '.join(LAYERS)}")
    return text


def _flag(text: str) -> bool:
    if text not in ("0", "1"):
        raise ValueError("0 or 1")
    return text == "1"


# Field -> its key in a query, and its parser, which raises ValueError with what is allowed.
KEYS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "device": ("device", _whole),
    "layer": ("layer", _layer),
    "delay": ("delay_s", _number(0.0)),
    "encoder_step": ("encoder_step", _number(0.0)),
    "command_limit": ("command_limit", _number(0.0, above=True, infinite=True)),
    "friction": ("friction", _number(0.0)),
    "start": ("start", _number(0.0, above=True)),
    "one_sided": ("one_sided", _flag),
    "stiffness": ("K", _number(0.0, above=True)),
    "damping": ("B", _number(0.0)),
    "damping_range": ("B_range", _span(0.0)),
    "stiffness_range": ("K_range", _span(0.0)),
    "time_range": ("t_range", _span(0.0)),
    "recording_from": ("recording_from_s", _number(0.0)),
}


def read_query(query: Mapping[str, Sequence[str]], devices: int = 1) -> tuple[View, list[str]]:
    """Return the view of a query, and a sentence on each ignored part.

    query: key -> values, as from `urllib.parse.parse_qs`. devices: their number.
    """
    names = {key: (name, read) for name, (key, read) in KEYS.items()}
    view, complaints = View(), list[str]()
    for key, values in query.items():
        if key not in names:
            complaints.append(f"the link has an unknown part {key[:40]!r}, which is left out")
            continue
        name, read = names[key]
        try:
            view = replace(view, **{name: read(values[-1])})
        except ValueError as error:
            text = values[-1][:40]
            complaints.append(
                f"the link has {key} = {text!r}, which is left out: it must be {error}"
            )
    if view.device >= devices:
        complaints.append(f"the link asks for device {view.device}; there are {devices} here")
        view = replace(view, device=0)
    return view, complaints
