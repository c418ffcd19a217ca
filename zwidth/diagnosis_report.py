"""The report of a diagnosis as one HTML file: the verdict first, all pictures inside the file."""

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from zwidth.diagnosis.answer.friction_curve import friction_curve
from zwidth.diagnosis.answer.result import (
    Diagnosis,
    Estimate,
    Finding,
    Rival,
    Unanswered,
    Verdict,
)
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.diagnosis.answer.words import (
    IF_RIGHT,
    effect_in_words,
    negligible_in_words,
    own_parameter,
    parameter_in_words,
    place_in_words,
    worth_in_words,
)
from zwidth.diagnosis.forces.locate import densest
from zwidth.diagnosis.intake.units import unit_of
from zwidth.diagnosis.mishaps import collecting, isolated, silent
from zwidth.diagnosis.noise.predictor import window
from zwidth.diagnosis_summary import (
    SHORT,
    how_sure,
    law_errors,
    no_better,
    title,
    what_now,
    whereabouts,
    with_law,
    worse_runs,
    worth,
)
from zwidth.files.whole import write_text
from zwidth.report_curves import curves_of, program
from zwidth.report_page import embedded, page
from zwidth.sim.device_file import commented_text
from zwidth.sim.physics import EFFECTS
from zwidth.sim.place import place_at
from zwidth.sim.readable import interval, most, number, of_the_motion, percent, plain, with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from zwidth.stability.augmented_boundary import AugmentedBoundary

WORDS = {
    "nothing_missing": "Nothing missing",
    "identified": "Identified",
    "confusable": "Confusable: another explanation fits nearly as well",
    "unknown_physics": "Unknown physics",
    "linear_parameters": "Linear parameters: only these differ",
    "recording_fault": "Recording fault",
    "undecided": "Undecided",
}
NAMES = re.compile(rf"\b({'|'.join(name for name in EFFECTS if '_' in name)})\b")
RIVALS = 6  # listed rivals of a finding
HELD = {
    "held out": (
        "data kept out of it: the last 30 % of each recording, or the recordings of --validate"
    ),
    "not judged alone": "data kept out of the fit, too short for a separate run",
}
INTERRUPTED = "interrupted, so this is the result so far"


@dataclass(frozen=True)
class Commands:
    """Command lines and files for the next steps of a report's reader.

    again: computes the report again; explore: opens both devices side by side; improved: the path
    of the improved device, "" if none was written; device: the path or name of the device that the
    recordings were compared with; read: the file that says how each recording was read; assumed:
    what this file assumes because the recordings do not state it.
    """

    again: str
    explore: str
    improved: str = ""
    device: str = ""
    read: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()


def save_report(
    diagnosis: Diagnosis,
    recordings: Sequence[str],
    commands: Commands,
    path: Path,
    boundary: "AugmentedBoundary | None" = None,
    drawn: dict[str, str] | None = None,
) -> Path:
    """Write the report; boundary: the stiffest wall before and after. Returns the path.

    drawn: the pictures of an earlier report of the diagnosis, which are used again, and to which
    new ones are added. A picture that fails is left out and named. Pictures of the smallest events
    and changes are left out if the file would become larger than `WHOLE`.
    """
    top = max(diagnosis.located.maps, key=lambda m: m.gained, default=None)
    curves: list[dict[str, Any]] = []
    drawn = {} if drawn is None else drawn
    with collecting(silent) as mishaps:
        with isolated("curves"):
            curves = _curves(diagnosis)
        room = WHOLE - TEXT - len(json.dumps(curves))
        pictures = _pictures(diagnosis, boundary, drawn, room)
        errors = list(dict.fromkeys((*diagnosis.errors, *mishaps.found)))
    states = diagnosis.located.state if densest(diagnosis.located.state) else []

    def rival(other: Rival) -> str:
        return effect_at(diagnosis, other.effect, other.at)

    text = page(
        "diagnosis_report.html",
        {
            "number": number,
            "estimate": estimate,
            "sentence": sentence,
            "sigma": _sigma,
            "worth": worth_in_words,
            "percent": percent,
            "words": in_words,
            "parameter": own_parameter,
            "rival": rival,
            "odds": most,
            "error": error,
            "output": output_in_words,
        },
        d=diagnosis,
        verdict=WORDS[diagnosis.verdict.value],
        found=found_rows(diagnosis),
        interrupted=INTERRUPTED,
        title=title(diagnosis),
        sure=how_sure(diagnosis, in_words(diagnosis.sentence)),
        worth=worth(diagnosis),
        where=whereabouts(diagnosis),
        short=_short_run(diagnosis),
        horizons=_horizons(diagnosis),
        improved=commented_text(diagnosis.device) if commands.improved else "",
        law=law_errors(diagnosis),
        now=what_now(diagnosis, commands.improved),
        assumptions=assumptions(diagnosis, commands),
        negligible=negligible_in_words(diagnosis.negligible, masses_of(diagnosis)),
        gain=gain_sentence(diagnosis),
        scale=scale_sentence(diagnosis),
        linear=linear_words(diagnosis),
        changed=changes_in_words(diagnosis),
        bounds=_bounds(diagnosis),
        recordings=recordings,
        commands=commands,
        boundary=boundary,
        errors=errors,
        pictures=pictures,
        left_out={
            kind: sum(not text and key.startswith(kind) for key, text in drawn.items()) // 2
            for kind in ("event", "change")
        },
        curves=curves,
        program=program(),
        place="" if top is None else place_in_words(place_at(top.place), masses_of(diagnosis)),
        state=sorted(states, key=lambda s: -float(s["share"])),
        fits=(("one sample ahead", diagnosis.one_step), ("short free runs", diagnosis.free_run)),
        whole_runs=diagnosis.whole_runs,
        force_errors=diagnosis.force_errors,
    )
    return write_text(path, text)


def save_unanswered(
    unanswered: Unanswered, device: str, recordings: Sequence[str], again: str, path: Path
) -> Path:
    """Write the report of a diagnosis that failed; again: the command line to repeat it."""
    text = page(
        "diagnosis_unanswered.html",
        {"sentence": sentence},
        u=unanswered,
        verdict=WORDS["undecided"],
        device=device,
        recordings=recordings,
        again=again,
    )
    return write_text(path, text)


NARROW = " narrow"  # suffix of a picture's name for its version on phones
PICTURES = ("motion", "missing force", "residual", "friction", "law", "force", "boundary")
WHOLE = 3_000_000  # characters of a report, so that it can be sent by mail
TEXT = 200_000  # of these for everything that is neither a picture nor a curve


def _pictures(
    diagnosis: Diagnosis, boundary: "AugmentedBoundary | None", drawn: dict[str, str], room: int
) -> dict[str, str]:
    """The pictures by their names, "" for one that there is not, or that failed.

    Of events and changes, those with the largest gain, as far as all pictures have `room`; the
    others are "" in `drawn`, too.
    """
    # matplotlib is loaded only here: earlier failures need no picture.
    from zwidth.figures import diagnosis as figures
    from zwidth.figures.narrow import narrow_bytes
    from zwidth.figures.style import picture_bytes

    rotary, named = diagnosis.device.rotary, bool(diagnosis.findings)
    draw: dict[str, Callable[[], Figure]] = {}
    if diagnosis.located.maps and whereabouts(diagnosis):
        draw["missing force"] = lambda: figures.force_map_figure(diagnosis.located, rotary)
    if diagnosis.whole_runs:
        draw["motion"] = lambda: figures.whole_run_figure(diagnosis.whole_runs[0], named)
    draw["residual"] = lambda: figures.residual_figure(diagnosis.residuals, named)
    if diagnosis.force_errors:
        draw["force"] = lambda: figures.force_error_figure(diagnosis.force_errors[0], named)
    with isolated("picture", "friction"):
        rubs = None if "friction" in drawn else friction_curve(diagnosis.searched)
        if rubs is not None:
            from zwidth.figures.friction_curve import friction_curve_figure

            draw["friction"] = partial(friction_curve_figure, rubs, rotary)
    if (law := diagnosis.learned) is not None:
        from zwidth.figures.learned_surface import law_figure

        draw["law"] = partial(law_figure, law, rotary)
    gained: dict[str, float] = {}
    for i, change in enumerate(diagnosis.changes):
        from zwidth.figures.changes import changes_figure

        draw[f"change {i + 1}"] = partial(changes_figure, change)
        gained[f"change {i + 1}"] = change.gained
    for i, event in enumerate(diagnosis.events):
        from zwidth.figures.events import events_figure

        draw[f"event {i + 1}"] = partial(events_figure, event)
        gained[f"event {i + 1}"] = event.gained
    if boundary is not None:
        from zwidth.figures.augmented_boundary import augmented_boundary_figure

        draw["boundary"] = lambda: augmented_boundary_figure(boundary)
    for name in sorted(draw, key=lambda name: -gained.get(name, math.inf)):
        both = (name, name + NARROW)
        if name not in drawn and (room > 0 or name not in gained):
            with isolated("picture", name):
                picture = draw[name]()
                pair = embedded(picture_bytes(picture)), embedded(narrow_bytes(picture))
                drawn.update(zip(both, pair, strict=True))
        room -= sum(len(drawn.get(key, "")) for key in both)
        if name in gained and room < 0:
            drawn.update(dict.fromkeys(both, ""))
    names = dict.fromkeys((*PICTURES, *draw))
    return {n: drawn.get(n, "") for name in names for n in (name, name + NARROW)}


def _short_run(diagnosis: Diagnosis) -> str:
    """How long a short free run is: "0.5 s"."""
    lengths = sorted({window(e) * e.period for e in diagnosis.experiments})
    return " to ".join(plain(s, 2) for s in dict.fromkeys((lengths[0], lengths[-1]))) + " s"


def _horizons(diagnosis: Diagnosis) -> str:
    """Over how long the effects were compared with the answer without them: "0.05 s and 2 s"."""
    horizons = sorted({f.worth.horizon for f in diagnosis.findings if f.worth and f.worth.pays})
    return " and ".join(f"{plain(s, 3)} s" for s in horizons)


def _curves(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Free runs over whole stretches as data that a reader can zoom."""
    from zwidth.figures.diagnosis import run_lines

    runs = diagnosis.whole_runs
    return curves_of(runs, run_lines(bool(diagnosis.findings), runs[0])) if runs else []


def assumptions(diagnosis: Diagnosis, commands: Commands) -> list[str]:
    """The assumptions of the answer, and where each can be corrected; without full stops."""
    samples = sum(e.command.shape[0] for e in diagnosis.experiments)
    count = len(diagnosis.experiments)
    said = [f"{samples} samples in {count} recording{'s' if count > 1 else ''}"]
    if commands.read:
        files = " and ".join(commands.read)
        said[0] += (
            f"; the columns of time, command and motion, and their units, are stated in {files}"
        )
    compared = commands.device or diagnosis.device.name
    said.append(
        f"masses, springs and dampers start from {compared} and may change as far as its"
        " [uncertainty] allows"
    )
    if "gain" not in diagnosis.linear_refit:
        said.append(
            "the scale of the command is assumed to be exact: if it is wrong by 3 %, every force,"
            " mass, spring and damper is wrong by 3 % (with command_scale in [uncertainty], the"
            " scale is fitted)"
        )
    said += _where_the_spring_rests(diagnosis)
    held = "held out" if any(run.held_out for run in diagnosis.whole_runs) else "not judged alone"
    said.append(f"the fit is judged on {HELD[held]}; the intervals are 95 %")
    return [*commands.assumed, *said]


def _where_the_spring_rests(diagnosis: Diagnosis) -> list[str]:
    """The rest position of a spring to ground, if it moved: k (q - q0) is k q less a force k q0."""
    _, moved = diagnosis.linear_refit.get("origin", (0.0, None))
    if moved is None or moved.lower <= 0.0 <= moved.upper:
        return []
    force, _, length = diagnosis.linear_refit["k0"][1].unit.rpartition("/")
    offset = moved.value * diagnosis.experiments[0].swing
    same = with_unit(diagnosis.device.chain.ground_spring * offset, force, 3)
    return [
        f"the rest position of the spring to ground is fitted ({with_unit(offset, length, 3)} from"
        f" that of the device file): a constant force of {same} would look the same"
    ]


def changes_in_words(found: Diagnosis) -> list[str]:
    """What changed, with a doubt if something else is missing; without full stops."""
    doubt = IF_RIGHT if found.verdict is Verdict.UNKNOWN_PHYSICS else ""
    return [f"{doubt}{change.sentence}" for change in found.changes]


def verdict_line(diagnosis: Diagnosis) -> str:
    """The verdict by its name, the effects as in device files, and what was not yet mentioned."""
    names = ", ".join(f"{f.effect} at {f.at}" for f in diagnosis.findings)
    line = f"Verdict: {diagnosis.verdict.value}" + (f" ({names})" if names else "")
    if diagnosis.verdict in (Verdict.IDENTIFIED, Verdict.NOTHING_MISSING):
        return line
    return f"{line}: {in_words(diagnosis.sentence)}"


def output_in_words(run: WholeRun) -> str:
    """An output of a recording: "position of m1, cart.csv"."""
    return f"{run.output.replace('_', ' of ')}, {run.recording}"


def in_words(text: str) -> str:
    """A sentence with the names of effects as people write them."""
    return NAMES.sub(lambda name: effect_in_words(name[0]), text)


def masses_of(diagnosis: Diagnosis) -> int:
    """Return the number of masses of the device."""
    return diagnosis.device.chain.masses.size


def found_rows(diagnosis: Diagnosis) -> list[tuple[str, Finding, list[Rival]]]:
    """Every finding with its name and place in words, and the nearest of its rivals."""
    return [
        (effect_at(diagnosis, f.effect, f.at), f, list(f.rivals[:RIVALS]))
        for f in diagnosis.findings
    ]


def effect_at(diagnosis: Diagnosis, effect: str, at: str) -> str:
    """Return an effect and its place in words: "Coulomb friction at the motor"."""
    return f"{effect_in_words(effect)} {place_in_words(place_at(at), masses_of(diagnosis))}"


def _bounds(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Effect at place, parameter, and what it is at most: "below 2 mN m", "within 3e-7 of 1"."""
    rows: list[tuple[str, str, str]] = []
    for label, bound in diagnosis.upper_bounds.items():
        effect, at = label.split("@")
        for name, value in bound.items():
            parameter = EFFECTS[effect].parameter(name)
            none = parameter.none_of_it()
            size = with_unit(abs(value - none), parameter.unit_for(diagnosis.device.rotary), 3)
            said = f"within {size} of {plain(none)}" if none else f"below {size}"
            rows.append((effect_at(diagnosis, effect, at), own_parameter(name), said))
    return rows


def linear_words(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """The linear parameters in words: name, the device file's value, the refitted one."""
    return [
        (parameter_in_words(name, e.unit), with_unit(nominal, e.unit), estimate(e))
        for name, (nominal, e) in linear_rows(diagnosis).items()
    ]


def gain_sentence(diagnosis: Diagnosis) -> str:
    """A sentence on the fitted gain of the command over the device file's, "" if it may be 1."""
    _, gain = diagnosis.linear_refit.get("gain", (1.0, Estimate(1.0, 1.0, 1.0)))
    if gain.lower <= 1.0 <= gain.upper or not math.isfinite(gain.upper - gain.lower):
        return ""
    unit = unit_of(gain.value)
    asked = "" if unit is None else f"; is the unit wrong ({unit})?"
    return (
        f"the improved device multiplies the command by {gain.value:.3g} (command_gain in its"
        f" [interface]){asked}"
    )


def scale_sentence(diagnosis: Diagnosis) -> str:
    """Say how uncertain the command's scale is, which no other interval includes; "" if known."""
    if "gain" not in diagnosis.linear_refit:
        return ""
    _, gain = diagnosis.linear_refit["gain"]
    return (
        f"the command's scale: {estimate(gain)}; all forces, masses, springs and dampers are"
        " proportional to this scale"
    )


def linear_rows(diagnosis: Diagnosis) -> dict[str, tuple[float, Estimate]]:
    """Return the linear parameters of the table: all but the command's scale."""
    return {k: both for k, both in diagnosis.linear_refit.items() if k != "gain"}


def improvement(found: Diagnosis) -> str:
    """Say how much smaller the error on held-out data became, and which whole run got worse."""
    worse = worse_runs(found)
    return f"{_improvement(found)}; {worse}" if worse else _improvement(found)


def _improvement(found: Diagnosis) -> str:
    fit = found.free_run
    if (law := law_errors(found)) is not None:
        none = ", no better than with the refit alone" if no_better(found) else ""
        return f"{with_law(*law)}{none}"
    if not fit.after > 0.0 or not fit.refit > 0.0:
        return "there is too little held-out data to judge by"
    if math.isinf(fit.after):
        return "with the found effects added, free runs on held-out data diverge"
    if math.isinf(fit.refit):
        errs = of_the_motion(fit.after)
        return (
            "free runs on held-out data diverge after the refit alone; with the found effects"
            f" added, their error is {errs}"
        )
    if not found.findings:
        less = fit.before / fit.refit
        if no_better(found):
            return (
                f"{SHORT}: {of_the_motion(fit.refit)} after the refit, no better than with the"
                f" device file ({percent(fit.before)})"
            )
        if not less < math.inf:
            return f"{SHORT}: {of_the_motion(fit.refit)} after the refit"
        return (
            f"{SHORT}: {of_the_motion(fit.refit)} after the refit,"
            f" {plain(less, 3)} times smaller than with the device file"
        )
    if no_better(found):
        file = f", {percent(fit.before)} with the device file" if fit.before < fit.after else ""
        return (
            f"{SHORT}: {of_the_motion(fit.after)}, no better than with the refit alone"
            f" ({percent(fit.refit)}{file})"
        )
    return (
        f"{SHORT}: {of_the_motion(fit.after)},"
        f" {plain(fit.refit / fit.after, 3)} times smaller than with the refit alone"
    )


def error(size: float, unit: str) -> str:
    """An rms error with its unit."""
    return "without bound" if math.isinf(size) else with_unit(size, unit)


def _sigma(value: float) -> str:
    return f"{value:.0f} sigma" if math.isfinite(value) else "an unknown number of sigma"


def sentence(text: str) -> str:
    """Return text with a capital first letter, unless it begins with the name of a channel."""
    return text if "_" in text.split(" ", 1)[0] else text[:1].upper() + text[1:]


def estimate(value: Estimate) -> str:
    """Return a value with its interval, in a convenient unit."""
    return interval(value.value, value.lower, value.upper, value.unit)
