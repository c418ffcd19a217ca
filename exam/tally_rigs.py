"""From marks of rigs at full size, and of laws of no name, to shares."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from zwidth.exam.mark import Mark
from zwidth.exam.perfect import HeldOut
from zwidth.exam.share import quantiles, share

PLAY, PLAY_NEAR = "backlash", 0.1
SILENT = ("nothing_missing", "linear_parameters")
NEARLY = 1.5  # times the error that the truth leaves, up to which an answer is sound


def rigs(marks: Sequence[Mark], fits: Mapping[str, HeldOut]) -> dict[str, Any]:
    """Return the statistics of rigs at full size; fits: recording -> its held-out errors."""
    bare = [m for m in marks if not m.effects]
    full = [m for m in marks if m.effects]
    effects = [e for m in full for e in m.effects]
    play = [e for e in effects if e.effect == PLAY]
    identified = [m for m in marks if m.verdict == "identified"]
    counts = sorted({len(m.effects) for m in full})
    return {
        "recordings": len(marks),
        "all_named": share(m.all_named for m in full).as_json(),
        "all_named_nothing_else": share(m.right for m in full).as_json(),
        "by_count": {
            str(n): share(m.all_named for m in full if len(m.effects) == n).as_json()
            for n in counts
        },
        "effects_found": share(e.found for e in effects).as_json(),
        "effects_in_class": share(e.in_class for e in effects).as_json(),
        "by_effect": {
            name: {
                "found": share(e.found for e in effects if e.effect == name).as_json(),
                "in_class": share(e.in_class for e in effects if e.effect == name).as_json(),
                "coverage": share(
                    ok for e in effects if e.effect == name for ok in e.inside.values()
                ).as_json(),
            }
            for name in sorted({e.effect for e in effects})
        },
        "first_right": share(m.first_right for m in full).as_json(),
        "first_right_and_alone": share(m.first_right and m.first_alone for m in full).as_json(),
        "play": share(
            e.found and abs(e.errors.get("gap", 1.0)) <= PLAY_NEAR for e in play
        ).as_json(),
        "identified": len(identified),
        "identified_and_wrong": share(not m.right for m in identified).as_json(),
        "confident_wrong_names": confident(marks),
        "false_names": dict(Counter(label for m in marks for label in m.claims).most_common()),
        "coverage": share(ok for e in effects for ok in e.inside.values()).as_json(),
        "coverage_linear": share(ok for m in marks for ok in m.linear.values()).as_json(),
        "held_out": held_out(full, fits),
        "clean": clean(bare)
        | {"nothing_missing": share(m.verdict == "nothing_missing" for m in bare).as_json()},
        "verdicts": dict(Counter(m.verdict for m in marks)),
    }


def clean(marks: Sequence[Mark]) -> dict[str, Any]:
    """Return how often something was claimed where nothing is concealed, and what."""
    return {
        "recordings": len(marks),
        "false_claims": share(m.verdict not in SILENT for m in marks).as_json(),
        "claimed": sorted(m.first or m.verdict for m in marks if m.verdict not in SILENT),
    }


def outside(marks: Sequence[Mark], fits: Mapping[str, HeldOut]) -> dict[str, Any]:
    """Return the statistics of laws outside the library.

    An answer is right if it says `unknown_physics`, or calls adequate a model that errs hardly more
    than the truth.
    """
    effects = [e for m in marks for e in m.effects]
    return {
        "recordings": len(marks),
        "said_so": share(m.verdict == "unknown_physics" for m in marks).as_json(),
        "right": share(
            m.verdict == "unknown_physics" or (m.adequate is True and near_truth(m, fits) is True)
            for m in marks
        ).as_json(),
        "identified": share(m.verdict == "identified" for m in marks).as_json(),
        "confident_wrong": share(
            m.verdict == "identified" and near_truth(m, fits) is not True for m in marks
        ).as_json(),
        "confident_wrong_names": confident(marks),
        "beside": share(e.in_class for e in effects).as_json(),
        "held_out": held_out(marks, fits),
        "verdicts": dict(Counter(m.verdict for m in marks)),
    }


def confident(marks: Sequence[Mark]) -> dict[str, Any]:
    """Return how many of the findings that stand alone explain nothing that is concealed."""
    return share(not so for m in marks for so in m.alone.values()).as_json()


def near_truth(m: Mark, fits: Mapping[str, HeldOut]) -> bool | None:
    """Return whether an answer errs hardly more on held-out data than the truth; None: unknown."""
    fit = fits.get(m.recording)
    return None if fit is None else fit.after <= NEARLY * fit.perfect


def adequacy(marks: Sequence[Mark], fits: Mapping[str, HeldOut]) -> dict[str, Any]:
    """Return how often the answer's judgement of its own adequacy is wrong, if it gives one.

    An answer is sound if it names everything and nothing else and errs hardly more than the truth
    on held-out data. It is bad if it errs more, whatever it names. Other answers are not counted.
    """
    asked = [m for m in marks if m.adequate is not None]
    known = [(m, near_truth(m, fits)) for m in asked]
    sound = [m for m, near in known if m.right and near is True]
    bad = [m for m, near in known if near is False]
    return {
        "asked": len(asked),
        "sound_refused": share(m.adequate is False for m in sound).as_json(),
        "bad_passed": share(m.adequate is True for m in bad).as_json(),
    }


def held_out(marks: Sequence[Mark], fits: Mapping[str, HeldOut]) -> dict[str, Any]:
    """Return quantiles of the share of the truth's improvement on held-out data."""
    known = [fits[m.recording] for m in marks if m.recording in fits]
    return {
        "share": quantiles([f.share for f in known]),
        "share_beyond_refit": quantiles([f.share_beyond_refit for f in known]),
    }
