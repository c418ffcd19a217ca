"""The page of evidence: what was asked, what was reached, and which confusion stands in the way."""

from collections.abc import Mapping, Sequence
from typing import Any

SINGLE_2X, SINGLE_5X, IN_CLASS = 0.90, 0.97, 0.99
TWO, THREE, UNKNOWN, CONFIDENT, FALSE = 0.90, 0.80, 0.90, 0.05, 0.02
COVERED, HELD_OUT, SECONDS = (0.92, 0.98), 0.95, 10.0
FEW = 50  # parameters that cannot tell 92 % from 98 %


def page(found: Mapping[str, Any], facts: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    """Return Markdown.

    found: the JSON of `zwidth exam`. facts: command, seed, length of the recordings. pictures: name
    -> path, relative to the page.
    """
    parts = [
        _head(found, facts),
        _goals(found),
        _magnitudes(found, pictures),
        _effects(found, pictures),
        _several(found),
        _silent(found),
        _misses(found["marks"]),
        _numbers(found),
    ]
    return "\n\n".join(parts) + "\n"


def _head(found: Mapping[str, Any], facts: Mapping[str, Any]) -> str:
    return f"""# Evidence: an exam on {found["recordings"]} sealed recordings

    {facts["command"]}

{found["recordings"]} recordings of {facts["length"]} at 1 kHz, seed {facts["seed"]}.
Devices (chains of one to four masses, rotary and linear, free or tied to ground, the PHANToM of
Table I), drives (noise, multisine, steps, slow triangles, sessions of all; open and closed loop),
noise (white and coloured, of force and of reading), encoder steps and jitter are drawn. Device
files are up to 10 % off in every number, or were fitted to the recording with the concealed effect
in it.

The truth is integrated by other code than the simulation that is fitted: Runge-Kutta with 40 steps
a tick instead of matrix exponentials, LuGre friction with stiff bristles instead of a set-valued
force (`scenarios/concealed/integrator.py`). What was concealed was sealed before the first
diagnosis: the SHA-256 of each salted key stands in its recording's description, the key holds those
of recording and device file, and the exam refuses to mark what does not fit.

*The limit* is the magnitude that stands five sigma above what a linear refit of this recording
absorbs (`diagnosis/limits.py`). An effect *stands apart* where the computed separation from every
rival is at least five sigma (`diagnosis/separation.py`): there it must be named first, at its
place. Elsewhere it must stand in the class that is named: the finding and its rivals within five
sigma. A rival that merely contains the effect does not count against it. The limit is that of the
whole recording; a diagnosis fits on 70 % of it, where five sigma are 4.2. Intervals are
Clopper-Pearson, 95 %."""


def ratio(s: Mapping[str, Any]) -> str:
    """Return "93.1 % (27 of 29; 77.2 to 99.2 %)"."""
    if not s["count"]:
        return "none"
    low, high = s["ci95"]
    return (
        f"{100 * s['share']:.1f} % ({s['right']} of {s['count']};"
        f" {100 * low:.1f} to {100 * high:.1f} %)"
    )


def _row(asked: str, goal: str, s: Mapping[str, Any] | None, reached: bool) -> list[str]:
    if s is None or not s["count"]:
        return [asked, goal, "not asked here", ""]
    return [asked, goal, ratio(s), "yes" if reached else "**no**"]


def table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def goals(found: Mapping[str, Any]) -> list[list[str]]:
    """Return rows: what is asked, the goal, what was found, whether that reaches it."""
    classes, rows = found["classes"], list[list[str]]()

    def least(asked: str, s: Mapping[str, Any] | None, goal: float) -> None:
        reached = s is not None and bool(s["count"]) and s["share"] >= goal
        rows.append(_row(asked, f">= {100 * goal:.0f} %", s, reached))

    def most(asked: str, s: Mapping[str, Any] | None, goal: float) -> None:
        reached = s is not None and bool(s["count"]) and s["share"] <= goal
        rows.append(_row(asked, f"<= {100 * goal:.0f} %", s, reached))

    for name, title, goal in (
        ("single_2x", "one effect at 2 times the limit", SINGLE_2X),
        ("single_5x", "one effect at 5 times and above", SINGLE_5X),
    ):
        c = classes.get(name)
        least(f"{title}: right effect and place first, where it stands apart",
              c and c["right_where_apart"], goal)  # fmt: skip
        least(f"{title}: the true one in the class named", c and c["in_class"], IN_CLASS)
    for name, title, goal in (("two_5x", "two effects", TWO), ("three_5x", "three", THREE)):
        c = classes.get(name)
        least(f"{title} at 5 times: all found", c and c["all_right"], goal)
    most("nothing concealed: a false claim", found["none"]["false_claims"], FALSE)
    least("in no library: `unknown_physics`", found["unknown"]["said_so"], UNKNOWN)
    most("in no library: a confident wrong name", found["unknown"]["confident_wrong"], CONFIDENT)
    covered = found["coverage_counts"]
    row = _row("95 % intervals of effects hold the truth", "92 to 98 %", covered, _covers(covered))
    rows.append([*row[:3], "too few to tell"] if _too_few(covered) else row)
    share = found["held_out"]["share"]
    if share["count"]:
        rows.append(
            ["held-out free run: median share of the improvement that perfect knowledge gives",
             ">= 95 %", f"{100 * share['median']:.1f} % (of {share['count']})",
             "yes" if share["median"] >= HELD_OUT else "**no**"]
        )  # fmt: skip
    seconds = found["seconds"]["median_of_10_s"]
    rows.append(["diagnosis of a 10 s recording, median", "<= 10 s", f"{seconds:.1f} s",
                 "yes" if seconds <= SECONDS else "**no**"])  # fmt: skip
    return rows


def _covers(s: Mapping[str, Any]) -> bool:
    return bool(s["count"]) and COVERED[0] <= s["share"] <= COVERED[1]


def _too_few(s: Mapping[str, Any]) -> bool:
    """Whether a share outside the range is so by chance alone, for all that can be told."""
    if not 0 < s["count"] < FEW or _covers(s):
        return False
    low, high = s["ci95"]
    return low <= COVERED[0] and COVERED[1] <= high


def _goals(found: Mapping[str, Any]) -> str:
    return "## Asked and reached\n\n" + table(("asked", "goal", "seen", "reached"), goals(found))


def _magnitudes(found: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    rows = [
        [f"{r['from']:g} to {r['to']:.3g}", ratio(r["first_where_apart"]), ratio(r["in_class"])]
        for r in found["by_magnitude"]
    ]
    return (
        "## Single effects against their size\n\n"
        + table(("times the limit", "named first, where it stands apart", "in the class"), rows)
        + f"\n\n![shares against magnitude]({pictures['magnitude']})"
    )


def _effects(found: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    rows = [
        [
            f"`{name}`", str(e["recordings"]), str(e["stand_apart"]), str(e["first"]),
            ratio(e["first_where_apart"]), ratio(e["in_class"]),
            ", ".join(f"{k} {n}" for k, n in sorted(e["taken_for"].items())) or "-",
        ]
        for name, e in found["by_effect"].items()
    ]  # fmt: skip
    heading = ("effect", "recordings", "stand apart", "first", "first where apart", "in the class",
               "else first named")  # fmt: skip
    note = "An effect under its own name in the last column was named at another place."
    return (
        "## Effect by effect (single ones)\n\n"
        + table(heading, rows)
        + f"\n\n{note}\n\n![what was taken for what]({pictures['confusion']})"
    )


def _several(found: Mapping[str, Any]) -> str:
    rows = [
        [name, str(c["recordings"]), ratio(c["stand_apart"]), ratio(c["all_right"]),
         ratio(c["right_where_apart"]), ratio(c["in_class_elsewhere"]), ratio(c["extra_claims"])]
        for name, c in found["classes"].items()
    ]  # fmt: skip
    heading = ("class", "recordings", "effects that stand apart", "all right",
               "right where apart", "in the class elsewhere", "with claims too many")  # fmt: skip
    return "## Class by class\n\n" + table(heading, rows)


def _silent(found: Mapping[str, Any]) -> str:
    none, unknown = found["none"], found["unknown"]
    claimed = ", ".join(none["claimed"]) or "nothing"
    rows = [
        [f"`{name}`", ", ".join(f"{k} {n}" for k, n in sorted(answers.items()))]
        for name, answers in unknown["by_effect"].items()
    ]
    text = (
        "## Nothing concealed, and what is in no library\n\n"
        f"Of {none['recordings']} recordings with nothing concealed, false claims in"
        f" {ratio(none['false_claims'])}: {claimed}."
    )
    return f"{text}\n\n{table(('in no library', 'named first'), rows)}" if rows else text


def _misses(marks: Sequence[Mapping[str, Any]]) -> str:
    """Every effect of the library that was not told, and what was said instead."""
    rows: list[list[str]] = []
    for m in marks:
        wanting = [e for e in m["effects"] if not _told(e, len(m["effects"]) > 1)]
        for e in wanting:
            place = "" if e["apart"] else ", does not stand apart"
            rows.append(
                [m["recording"], m["stratum"],
                 f"`{e['effect']}` at {e['at']}, {e['times_limit']:.3g} times{place}",
                 "named" if e["in_class"] else "not named",
                 m["first"].replace("@", " at ") or "nothing", f"`{m['verdict']}`"]
            )  # fmt: skip
    if not rows:
        return "## What was missed\n\nNothing."
    heading = ("recording", "class", "concealed", "as a rival", "named first", "verdict")
    return "## What was missed\n\n" + table(heading, rows)


def _told(e: Mapping[str, Any], several: bool) -> bool:
    if not e["apart"]:
        return bool(e["in_class"])
    return bool(e["found"] if several else e["first"])


def _numbers(found: Mapping[str, Any]) -> str:
    share, beyond = found["held_out"]["share"], found["held_out"]["share_beyond_refit"]
    seconds = found["seconds"]
    lines = [
        "## Numbers",
        f"Intervals of linear parameters hold the truth: {ratio(found['coverage_linear'])}.",
        _held_out("the device file", share),
        _held_out("the linear refit", beyond),
        f"A diagnosis took {seconds['median']:.1f} s in the median and {seconds['most']:.1f} s at"
        f" most, per 10 s of recording {seconds['median_of_10_s']:.1f} s in the median and"
        f" {seconds['ninth_decile_of_10_s']:.1f} s in the ninth decile; it kept one core busy for"
        f" {seconds['core_seconds_of_10_s']:.1f} s of 10 s of recording, in the median.",
    ]
    if found["errors"]:
        lines.append(f"Diagnoses that ended with an error: {', '.join(found['errors'])}.")
    return "\n\n".join(lines)


def _held_out(of: str, s: Mapping[str, Any]) -> str:
    if not s["count"]:
        return f"Held-out improvement on {of}: none to be told."
    return (
        f"Held-out improvement on {of}, share of perfect knowledge's: median"
        f" {100 * s['median']:.1f} %, lower quartile {100 * s['lower_quartile']:.1f} %, tenth"
        f" {100 * s['tenth']:.1f} % ({s['count']} recordings where perfect knowledge improves it by"
        " 2 % or more)."
    )
