"""The classes of concealed recordings, and the share of each."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Stratum:
    """A class of recordings.

    kind: one of KINDS, by which it is marked. At the limit, effects: how many are concealed, at
    magnitudes log-uniform from least to most times the information limit; outside: it is one that
    is in no library; share: of all recordings, where no numbers are asked for.
    """

    name: str
    title: str
    effects: int
    least: float = 0.0
    most: float = 0.0
    outside: bool = False
    share: float = 0.0
    kind: str = "limit"


RIGS, OUTSIDE, LABORATORY, MUJOCO = "rigs", "outside", "laboratory", "mujoco"
KINDS = ("limit", RIGS, OUTSIDE, LABORATORY, MUJOCO)
STRATA: Mapping[str, Stratum] = {
    s.name: s
    for s in (
        Stratum("none", "nothing concealed", 0, share=0.34),
        Stratum("single_2x", "one effect at 2 times the limit", 1, 2.0, 2.0, share=0.16),
        Stratum("single_5x", "one effect at 5 to 100 times", 1, 5.0, 100.0, share=0.24),
        Stratum("single_any", "one effect at 1 to 100 times", 1, 1.0, 100.0),
        Stratum("two_5x", "two effects at 5 times", 2, 5.0, 5.0, share=0.1),
        Stratum("three_5x", "three effects at 5 times", 3, 5.0, 5.0, share=0.08),
        Stratum("unknown", "physics in no library, 5 to 50 times", 1, 5.0, 50.0, True, share=0.08),
        Stratum(RIGS, "a rig at full size, none to five effects", 5, kind=RIGS),
        Stratum(LABORATORY, "nothing concealed, recorded as laboratories do", 0, kind=LABORATORY),
        Stratum(MUJOCO, "a rig moved by MuJoCo, none to five effects", 5, kind=MUJOCO),
        Stratum(OUTSIDE, "a random law without a name", 1, outside=True, kind=OUTSIDE),
    )
}


def counts(
    total: int | None, asked: str | None = None, rigs: int = 0, outside: int = 0
) -> dict[str, int]:
    """Return how many recordings of each class.

    total: so many at the limit, by share; asked: so many of each class named instead
    ("none=100,unknown=20"). rigs, outside: so many of these besides. Raises ValueError (field,
    value, what is allowed).
    """
    found = {} if total is None and asked is None else _at_limit(total, asked)
    for name, count in ((RIGS, rigs), (OUTSIDE, outside)):
        if count:
            found[name] = found.get(name, 0) + count
    return found


def _at_limit(total: int | None, asked: str | None) -> dict[str, int]:
    if asked is not None:
        return _asked(asked)
    if total is None or total < 1:
        raise ValueError(f"count is {total}; at least one recording must be made")
    exact = {name: s.share * total for name, s in STRATA.items() if s.share > 0.0}
    whole = {name: int(value) for name, value in exact.items()}
    # What rounding down left goes to the largest remainders.
    rest = sorted(exact, key=lambda name: whole[name] - exact[name])
    for name in rest[: total - sum(whole.values())]:
        whole[name] += 1
    return {name: n for name, n in whole.items() if n > 0}


def _asked(text: str) -> dict[str, int]:
    found: dict[str, int] = {}
    for item in text.split(","):
        name, _, number = item.partition("=")
        name = name.strip()
        if name not in STRATA:
            raise ValueError(f"strata has {name!r}; its classes are {', '.join(STRATA)}")
        if not number.strip().isdigit() or int(number) < 1:
            raise ValueError(
                f"strata has {item.strip()!r}; give NAME=COUNT, with a count of 1 or more"
            )
        found[name] = found.get(name, 0) + int(number)
    return found
