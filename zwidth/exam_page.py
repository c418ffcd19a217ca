"""The page of evidence: what was asked, what was reached, and which confusion stands in the way."""

from collections.abc import Mapping, Sequence
from typing import Any

from zwidth.exam_sections import (
    calibration_section,
    held_out_line,
    laboratory_section,
    outside_section,
    ratio,
    rig_section,
    table,
)

SINGLE_2X, SINGLE_5X, IN_CLASS = 0.90, 0.97, 0.99
TWO, THREE, UNKNOWN, CONFIDENT, FALSE = 0.90, 0.80, 0.90, 0.05, 0.02
COVERED, HELD_OUT, SECONDS = (0.92, 0.98), 0.95, 10.0
RIG_NAMED, RIG_FIRST, RIG_PLAY, RIG_WRONG, RIG_CLEAN = 0.80, 0.90, 0.90, 0.02, 0.95
OWN_JUDGEMENT, CALIBRATED = 0.05, 0.03
FEW = 50  # parameters that cannot tell 92 % from 98 %
HANDFUL = 5  # subjects, below which neither side of a goal is reached by chance alone
UNTOLD = "too few to tell"


def page(found: Mapping[str, Any], facts: Mapping[str, Any], pictures: Mapping[str, str]) -> str:
    """Return Markdown.

    found: the JSON of `zwidth exam`. facts: command, seed, length of the recordings. pictures: name
    -> path, relative to the page.
    """
    parts = [_head(found, facts), _goals(found)]
    if _at_limit(found):
        parts += [
            "# At the limit",
            _limit_head(),
            _magnitudes(found, pictures),
            _effects(found, pictures),
            _several(found),
            _silent(found),
            _misses([m for m in found["marks"] if m["kind"] == "limit"]),
        ]
    if found["rigs"]["recordings"]:
        parts.append(rig_section(found["rigs"], "Rigs at full size"))
    if found["mujoco"]["recordings"]:
        parts.append(rig_section(found["mujoco"], "Rigs that MuJoCo moved"))
    if found["laboratory"]["recordings"]:
        parts.append(laboratory_section(found["laboratory"]))
    if found["outside"]["recordings"]:
        parts.append(outside_section(found["outside"]))
    if found["calibration"]["statements"]:
        parts.append(calibration_section(found["calibration"], pictures))
    parts.append(_numbers(found))
    return "\n\n".join(parts) + "\n"


def _at_limit(found: Mapping[str, Any]) -> int:
    """Return how many recordings are of classes at the limit."""
    beside = ("rigs", "mujoco", "laboratory", "outside")
    return found["recordings"] - sum(found[kind]["recordings"] for kind in beside)


def _head(found: Mapping[str, Any], facts: Mapping[str, Any]) -> str:
    limit, rigs, outside = _at_limit(found), found["rigs"], found["outside"]
    kinds = [
        f"{count} {what}"
        for count, what in (
            (limit, "recordings at the limit"),
            (rigs["recordings"], "rigs at full size"),
            (found["mujoco"]["recordings"], "rigs that MuJoCo moved"),
            (found["laboratory"]["recordings"], "machines as laboratories record them"),
            (outside["recordings"], "subjects with an unnamed law"),
        )
        if count
    ]
    length = f", {facts['length']} each" if facts["length"] else ""
    return f"""# Evidence: an exam on {found["recordings"]} sealed subjects

    {facts["command"]}

{", ".join(kinds)}{length}, seed {facts["seed"]}.
What each class is, and how it is marked, stands in [exam.md](exam.md).

The truth is integrated by other code than the simulation that is fitted: Runge-Kutta in steps of 25
to 100 us instead of matrix exponentials, LuGre friction with stiff bristles instead of a set-valued
force (`scenarios/concealed/integrator.py`). What was concealed was sealed before the first
diagnosis: the SHA-256 of each salted key stands in its recording's description, the key holds those
of recording and device file, and the exam refuses to mark what does not fit. Intervals are
Clopper-Pearson, 95 %."""


def _limit_head() -> str:
    return """Recordings of 10 to 20 s at 1 kHz. Devices (chains of one to five masses, rotary and
linear, free or tied to ground, the PHANToM of Table I), drives (noise, multisine, steps, slow
triangles, sessions of all; open and closed loop), noise (white and coloured, of force and of
reading), encoder steps and jitter are drawn. Device files are up to 10 % off in every number, or
were fitted to the recording with the concealed effect in it.

*The limit* is the magnitude that stands five sigma above what a linear refit of this recording
absorbs (`planning/limits.py`). An effect *stands apart* where the computed separation from every
rival is at least five sigma (`planning/separation.py`): there it must be named first, at its
place. Elsewhere it must stand in the class that is named: the finding and its rivals within five
sigma. A rival that merely contains the effect does not count against it. The limit is that of the
whole recording; a diagnosis fits on 70 % of it, where five sigma are 4.2."""


def _row(asked: str, goal: str, s: Mapping[str, Any] | None, reached: bool) -> list[str]:
    if s is None or not s["count"]:
        return [asked, goal, "not asked here", ""]
    return [asked, goal, ratio(s), "yes" if reached else "**no**"]


def _in_doubt(row: list[str], s: Mapping[str, Any] | None, goal: float) -> list[str]:
    """The row, undecided where a handful of subjects allows both sides of the goal: 0 of 1 is none.

    Of 0 of 1 the 95 % interval is 0 to 97.5 %.
    """
    if s is None or not 0 < s["count"] < HANDFUL or not s["ci95"][0] <= goal <= s["ci95"][1]:
        return row
    return [*row[:3], UNTOLD]


def goals(found: Mapping[str, Any]) -> list[list[str]]:
    """Return rows: what is asked, the goal, what was found, whether that reaches it."""
    classes, rows = found["classes"], list[list[str]]()
    rigs, outside = found["rigs"], found["outside"]

    def least(asked: str, s: Mapping[str, Any] | None, goal: float) -> None:
        reached = s is not None and bool(s["count"]) and s["share"] >= goal
        rows.append(_in_doubt(_row(asked, f">= {100 * goal:.0f} %", s, reached), s, goal))

    def most(asked: str, s: Mapping[str, Any] | None, goal: float) -> None:
        reached = s is not None and bool(s["count"]) and s["share"] <= goal
        rows.append(_in_doubt(_row(asked, f"<= {100 * goal:.0f} %", s, reached), s, goal))

    def near(asked: str, share: Mapping[str, Any]) -> None:
        if share["count"]:
            seen = f"{100 * share['median']:.1f} % (of {share['count']})"
            reached = share["median"] >= HELD_OUT
            rows.append([asked, f">= {100 * HELD_OUT:.0f} %", seen, "yes" if reached else "**no**"])

    def covers(asked: str, s: Mapping[str, Any]) -> None:
        row = _row(asked, "92 to 98 %", s, _covers(s))
        rows.append([*row[:3], UNTOLD] if _too_few(s) else row)

    if _at_limit(found):
        for name, title, goal in (
            ("single_2x", "one effect at 2 times the limit", SINGLE_2X),
            ("single_5x", "one effect at 5 times and above", SINGLE_5X),
        ):
            c = classes.get(name)
            least(f"{title}: right effect and place first, where it stands apart",
                  c and c["right_where_apart"], goal)  # fmt: skip
            least(f"{title}: the true one among those named", c and c["in_class"], IN_CLASS)
        for name, title, goal in (("two_5x", "two effects", TWO), ("three_5x", "three", THREE)):
            c = classes.get(name)
            least(f"{title} at 5 times the limit: all found", c and c["all_right"], goal)
        most("nothing concealed: an effect claimed", found["none"]["false_claims"], FALSE)
        least("in no library: `unknown_physics`", found["unknown"]["said_so"], UNKNOWN)
        most(
            "in no library: a confident wrong name", found["unknown"]["confident_wrong"], CONFIDENT
        )
        covers("95 % intervals of effects contain the truth", found["coverage_counts"])
        near("held-out free run: median share of the improvement with the true device",
             found["held_out"]["share"])  # fmt: skip
    if rigs["recordings"]:
        least("rigs: every effect found at its place, or among those named",
              rigs["all_named"], RIG_NAMED)  # fmt: skip
        least("rigs: the first finding is right, and no rival is near",
              rigs["first_right_and_alone"], RIG_FIRST)  # fmt: skip
        least("rigs: play named, its gap within 10 %", rigs["play"], RIG_PLAY)
        most("rigs: wrong ones among those `identified`", rigs["identified_and_wrong"], RIG_WRONG)
        most(
            "rigs: wrong findings among those without a near rival",
            rigs["confident_wrong_names"],
            RIG_WRONG,
        )
        least("clean rigs: `nothing_missing`", rigs["clean"]["nothing_missing"], RIG_CLEAN)
        covers("rigs: 95 % intervals of effects contain the truth", rigs["coverage"])
        near("rigs, held-out free run: median share of the improvement with the true device",
             rigs["held_out"]["share"])  # fmt: skip
    if found["mujoco"]["recordings"]:
        least("rigs of MuJoCo: every effect found at its place, or among those named",
              found["mujoco"]["all_named"], RIG_NAMED)  # fmt: skip
        most("rigs of MuJoCo: wrong ones among those `identified`",
             found["mujoco"]["identified_and_wrong"], RIG_WRONG)  # fmt: skip
    if found["laboratory"]["recordings"]:
        most("recorded as laboratories do, nothing concealed: an effect claimed",
             found["laboratory"]["false_claims"], FALSE)  # fmt: skip
    if outside["recordings"]:
        least("unnamed laws: `unknown_physics`, or rightly adequate", outside["right"], UNKNOWN)
        most("unnamed laws: a confident wrong name", outside["confident_wrong"], CONFIDENT)
    adequacy, calibration = found["adequacy"], found["calibration"]
    if adequacy["asked"]:
        most("own judgement: sound answers refused", adequacy["sound_refused"], OWN_JUDGEMENT)
        most("own judgement: bad answers passed", adequacy["bad_passed"], OWN_JUDGEMENT)
    if calibration["statements"]:
        error = calibration["expected_error"]
        rows.append(["probabilities: expected calibration error", f"<= {CALIBRATED:g}",
                     f"{error:.3f} ({calibration['statements']} statements)",
                     "yes" if error <= CALIBRATED else "**no**"])  # fmt: skip
    seconds = found["seconds"]["median_of_10_s"]
    rows.append(["diagnosis of 10 000 samples, median", "<= 10 s", f"{seconds:.1f} s",
                 "yes" if seconds <= SECONDS else "**no**"])  # fmt: skip
    return rows


def _covers(s: Mapping[str, Any]) -> bool:
    return bool(s["count"]) and COVERED[0] <= s["share"] <= COVERED[1]


def _too_few(s: Mapping[str, Any]) -> bool:
    """Whether a share outside the range may be so by chance."""
    if not 0 < s["count"] < FEW or _covers(s):
        return False
    low, high = s["ci95"]
    return low <= COVERED[0] and COVERED[1] <= high


def _goals(found: Mapping[str, Any]) -> str:
    return "## Goals and results\n\n" + table(("asked", "goal", "seen", "reached"), goals(found))


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
    lines = ["# Numbers"]
    if _at_limit(found):
        lines += [
            "At the limit, intervals of linear parameters contain the truth:"
            f" {ratio(found['coverage_linear'])}.",
            held_out_line("the device file", share),
            held_out_line("the linear refit", beyond),
        ]
    lines.append(
        f"A diagnosis took {seconds['median']:.1f} s in the median and {seconds['most']:.1f} s at"
        f" most, per 10 000 samples {seconds['median_of_10_s']:.1f} s in the median and"
        f" {seconds['ninth_decile_of_10_s']:.1f} s in the ninth decile; it kept one core busy for"
        f" {seconds['core_seconds_of_10_s']:.1f} s of 10 000 samples, in the median."
    )
    if found["errors"]:
        lines.append(f"Diagnoses that ended with an error: {', '.join(found['errors'])}.")
    return "\n\n".join(lines)
