"""The first line of a diagnosis, for every verdict, and what stands beside it."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from zwidth.diagnose_files import may_render
from zwidth.diagnosis.answer.adequacy import Adequacy, Ahead
from zwidth.diagnosis.answer.answered import _in_short
from zwidth.diagnosis.answer.changes import Change
from zwidth.diagnosis.answer.consequence import Worth
from zwidth.diagnosis.answer.levels import NextLevel
from zwidth.diagnosis.answer.result import Estimate, Finding, Held, HeldOut, Rival, Verdict
from zwidth.diagnosis.answer.verdict import Facts, Left, Reason, reason
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.diagnosis.answer.words import (
    LONGEST,
    SAYINGS,
    cautions,
    headline,
    in_words,
    where,
    why,
)
from zwidth.diagnosis.forces.locate import ForceMap, Located
from zwidth.diagnosis.forces.unknown import Instead
from zwidth.diagnosis.intake.gate import misread
from zwidth.diagnosis.learning.changing import EACH, RUN, STEP
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.figures.diagnosis import force_map_figure, whole_run_figure
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import EFFECTS, make_physics

FRICTION = Finding(
    "coulomb_friction", "m1", {"level": Estimate(0.0301, 0.0297, 0.0305, "N m")}, 40.0, (), 0.99
)
BAND = Rival("dead_band", "command", 3.0, 0.3)
GOOD = HeldOut(3.0, 0.7, 0.03, 0.02)
SOUND = Adequacy((Ahead(0.5, 0.01, 0.01, 0.02, 0.0, 0.1),), 0.95, 9.0, True, 9)
NOTHING = Left(0.0, "")
FORCE = Left(90.0, "a force at m1 that depends on time")
WEAK = replace(SOUND, ahead=(Ahead(0.5, 0.06, 0.01, 0.02, 0.0, 0.1),))
MOTOR = Device("motor", "", True, make_chain([1e-3], [6e-3]), Interface(period=0.001))


def answer(*findings: Finding, **facts: Any) -> Facts:
    known: dict[str, Any] = {"sound": SOUND, "free": GOOD, **facts}
    return Facts(findings, known.pop("refit", {}), known.pop("left", NOTHING), **known)


def test_what_was_found_in_the_words_of_an_engineer():
    """Breaks where the verdict or the name of a file is the heading."""
    found = answer(FRICTION)
    missing = "Coulomb friction of 30.1 mN m at the motor is missing"
    assert headline(found) == f"{missing} from the simulation"
    assert " at the motor (m1) is missing" in headline(replace(found, masses=3))


def test_rivals_that_cannot_be_told_apart_stand_in_the_headline():
    """Breaks where a rival within five sigma is left for the table."""
    found = answer(replace(FRICTION, rivals=(BAND,)))
    assert headline(found) == (
        "Coulomb friction of 30.1 mN m at the motor, or a dead band in the command: this recording"
        " cannot tell which is missing"
    )
    unsure = answer(replace(FRICTION, probability=0.41, with_richer=0.53))
    assert headline(unsure).endswith("may be missing: the probability is only 53 %")


STRIBECK = Finding(
    "stribeck_friction",
    "m1",
    {
        "level": Estimate(0.0250004, 0.0249990, 0.0250018, "N m"),
        "static_level": Estimate(0.039981, 0.039964, 0.039999, "N m"),
    },
    52.0,
    (),
)
GRAVITY = Finding("gravity_pendulum", "m1", {"level": Estimate(0.080002, 0.08, 0.08001, "N m")},
                  51.0, ())  # fmt: skip
STOP = Finding("backlash", "link12", {"gap": Estimate(0.0077, 0.0066, 0.0088, "m")}, 8.0, ())


def test_a_headline_has_no_intervals_and_says_a_place_once():
    """Mutations: intervals in brackets; more digits than three; "at the motor" after each."""
    assert headline(answer(STRIBECK, GRAVITY)) == (
        "Stribeck friction of 25.0 mN m (40.0 mN m at rest) and a gravity pendulum of 80.0 mN m at"
        " the motor are missing from the simulation"
    )
    assert headline(answer(STRIBECK, FRICTION, STOP, masses=2)).startswith(
        "Stribeck friction of 25.0 mN m (40.0 mN m at rest) and Coulomb friction of 30.1 mN m at"
        " the motor (m1), and play"
    )
    apart = headline(answer(FRICTION, STOP, GRAVITY, masses=2))
    assert apart.count("at the motor (m1)") == 2


def test_a_long_headline_leaves_out_sizes_and_no_effect():
    """The weakest effect's first. Mutations: the strongest's; an effect that is not named."""
    band = Finding("dead_band", "command", {"width": Estimate(0.02, 0.019, 0.021, "N m")}, 7.0, ())
    found = answer(STRIBECK, STOP, band, masses=2)
    text = headline(found)
    assert len(text.split()) <= LONGEST
    assert "Stribeck friction of 25.0 mN m" in text
    assert "play of 7.7 mm between the motor (m1) and the load (m2) and a dead band in" in text
    assert "20.0 mN m in the command" in headline(replace(found, findings=(STRIBECK, band)))
    more = headline(found, ["the inertia m1 rose from 1 to 2 kg m2 from run_2 on"])
    assert more.startswith("Stribeck friction at the motor (m1), backlash")
    assert more.endswith("; the inertia m1 rose from 1 to 2 kg m2 from run_2 on")


def test_the_nearest_rival_stands_with_its_distance():
    """Mutations: the first rival of the table; no figure; the finding's own sigma."""
    near = replace(BAND, separation_sigma=1.24)
    found = answer(replace(FRICTION, rivals=(BAND, near)))
    assert why(found) == (
        "the fit is only 1.2 sigma worse with a dead band in the command in place of Coulomb"
        " friction; to tell two effects apart, 5 sigma are required"
    )
    other = Rival("coulomb_friction", "m2", 0.01)
    both = answer(replace(FRICTION, rivals=(other,)), replace(STOP, rivals=(near,)), masses=3)
    assert why(both).startswith(
        "the fit is no worse with Coulomb friction at the mass m2 in place of Coulomb friction at"
        " the motor (m1) and only 1.2 sigma worse with a dead band in the command in place of"
    )
    assert headline(both).endswith("; Coulomb friction may instead be at the mass m2")


NO_WINDOWS = cast("Any", None)


def change(shape: str, **more: Any) -> Change:
    """A damper of a directional friction that rises, as far as its sentences read it."""
    known: dict[str, Any] = {
        "parameter": "viscous_minus", "effect": "directional_friction", "place": "m2",
        "recording": "run_2", "at": None, "between": None, "rate": None,
        "before": Estimate(1.5, 0.5, 2.4, "N s/m"), "after": Estimate(1.93, 1.0, 2.8, "N s/m"),
        "by": Estimate(0.43, 0.37, 0.48, "N s/m"), "gained": 90.0, "free_run": (0.2, 0.1),
        "masses": 2, "windows": NO_WINDOWS,
    }  # fmt: skip
    return Change(shape=shape, **(known | more))


def test_a_change_is_said_in_plain_words():
    """Mutations: a parameter's name as in a file; intervals in the headline's form."""
    one = change(STEP, at=0.7, between=(0.1, 0.8))
    what = "the backward damping of directional friction at the load (m2)"
    assert one.short == f"{what} rose by 430 mN s/m at 0.7 s"
    assert one.sentence == (
        f"{what} rose by 430 mN s/m (370 to 480) at 0.7 s (0.1 to 0.8 s); at first, it was"
        " 1.5 N s/m (0.5 to 2.4)"
    )


def test_the_headline_counts_further_changes_and_events():
    """Mutations: all of them; the last one in the place of the first."""
    one = change(STEP, at=0.7, between=(0.1, 0.8))
    hit = cast("Any", SimpleNamespace(short="a hit of 2 mN m s at the motor at 3.2 s"))
    other = change(RUN)
    assert _in_short([one], [hit]) == ([one.short], [hit.short])
    (changed,), (happened,) = _in_short([one, other, other], [hit, hit])
    assert changed == f"{one.short}, and 2 more parameters changed"
    assert happened == f"{hit.short}, and 1 more event"
    assert _in_short([], []) == ([], [])


def test_a_doubtful_change_is_left_to_the_lines_below_a_long_headline():
    """Mutations: sizes left out instead; an event left out with it; left out of a short one."""
    words = "if this model is right, the inertia m1 rose from 1 to 2 kg m2 from run_2 on"
    hit = "a hit of 2 mN m s at the motor at 3.2 s"
    found = answer(STRIBECK, GRAVITY, left=FORCE)
    assert headline(answer(FRICTION), [], [words]).endswith(f" the simulation; {words}")
    text = headline(found, [hit], [words])
    assert words not in text
    assert text.startswith("Stribeck friction ")
    assert text.endswith(hit)


def test_a_change_that_may_have_had_another_course_is_given_no_date():
    """Mutations: names of shapes as they are; "or" after each; a date in the headline."""
    either = change(STEP, as_well=("a drift over time", "settling", RUN, EACH))
    assert either.short.endswith("at the load (m2) rose by 430 mN s/m")
    assert either.sentence.endswith(
        "; a drift over time, settling, one recording unlike the others or another value in each"
        " recording would explain it equally well"
    )
    runs = change(RUN, as_well=(EACH,))
    assert runs.short.endswith("at the load (m2) is not constant")


def test_unknown_physics_says_how_far_the_names_go():
    """Breaks where a name that explains nothing is given its value in the headline."""
    found = answer(FRICTION, left=FORCE)
    assert headline(found).endswith(
        " is missing and explains 95 % of the error; the rest is outside the library of effects"
    )
    whole = replace(found, sound=replace(SOUND, explained=1.0))
    assert "and so is something that is not in the library of effects" in headline(whole)
    poor = replace(found, sound=replace(SOUND, explained=0.04))
    assert headline(poor).endswith(
        "the nearest effects (Coulomb friction) explain 4 % of the error"
    )
    bare = answer(left=FORCE)
    assert "a force at m1 that depends on time" in headline(bare)
    other = Instead(300.0, 9, "m1", "repeats every 6.3 rad", "force_ripple at m1")
    assert "a force at the motor that repeats every 6.3 rad" in headline(
        replace(found, other=other)
    )


def test_no_physics_but_a_parameter_says_which_and_by_how_much():
    """Breaks where the parameter is named and its change is not; 57.3 asks for degrees."""
    refit = {
        "m1": (1.2e-3, Estimate(1.56e-3, 1.55e-3, 1.57e-3, "kg m2")),
        "b1": (6e-3, Estimate(6.0e-3, 5.9e-3, 6.1e-3, "N m s/rad")),
    }
    found = answer(refit=refit)
    assert headline(found) == (
        "No physics is missing, but the inertia m1 is 0.00156 kg m2, 30 % above the device file's"
    )
    assert why(found) == "the inertia m1 differs from the device file by more than 5 sigma"
    both = replace(found, refit=refit | {"b1": (6e-3, Estimate(2.0e-2, 1.9e-2, 2.1e-2, "N s/m"))})
    assert headline(both) == (
        "No physics is missing, but parameters differ from the device file: the damper b1 by a"
        " factor of 3.33 and the inertia m1 by +30 %"
    )
    assert why(both).startswith("the inertia m1 and the damper b1 differ from the device file")
    scale = {"gain": (1.0, Estimate(57.4, 57.0, 57.8, ""))}
    assert "(degrees?)" in headline(replace(found, refit=scale))


@pytest.mark.parametrize(
    ("channels", "factor", "said"),
    [
        (("command",), -1.0, "The sign of the command of run is wrong"),
        (("position_m1",), 0.01745, "Position_m1 of run is 57.3 times too large (degrees?)"),
        (("position_m1",), 1e-3, "1000 times too large (mm or mN m?)"),
        (("command",), 57.3, "57.3 times too small (motion in degrees or turns?)"),
    ],
)
def test_a_fault_of_the_recording_comes_first(channels: tuple[str, ...], factor: float, said: str):
    """With the unit that the factor asks for; a command is in no degrees.

    Breaks where what was found hides what is wrong with the recording.
    """
    e = Experiment(0.001, np.zeros(9), np.zeros((9, 1)), (Output("position", 0),), "run")
    fault = misread(e, channels, factor)
    assert said in headline(answer(faults=(fault,)))
    both = headline(answer(FRICTION, faults=(fault,)))
    assert said in both
    assert "; with that corrected, Coulomb friction of 30.1 mN m" in both


def test_nothing_and_undecided():
    """Breaks where an error is told as an answer."""
    assert headline(answer()) == "This recording shows no missing physics"
    lost = answer(FRICTION, lost="a part of the search")
    assert headline(lost) == "Undecided: an internal error prevented a part of the search"
    away = answer(free=HeldOut(math.inf, math.inf, math.inf, 0.01))
    assert "without bound" in headline(away)


def test_no_infinity_in_what_is_said():
    """Breaks where a free run that runs away is told in percent."""
    away = HeldOut(math.inf, math.inf, math.inf, 0.01)
    said = [why(answer(free=away)), why(answer(FRICTION, free=away))]
    said += cautions((FRICTION,), away, ())
    assert not any("inf" in text.replace("information", "") for text in said)


def waves(*periods: float) -> list[Finding]:
    """Ripples at other places, with periods that are known to 1 %."""
    at = ("force_ripple", "m1"), ("encoder_eccentricity", "sensor")
    return [
        Finding(effect, place, {"period": Estimate(p, p - 7e-4, p + 7e-4, "rad")}, 9.0, ())
        for (effect, place), p in zip(at, periods, strict=False)
    ]


def test_a_reason_decides_and_the_first_counts():
    """Breaks where two of the list change places, or one is not asked."""
    fails = replace(FRICTION, regimes=(Held("forwards", "backwards", -9.0, True),))
    law = cast("Any", SimpleNamespace(curve=SimpleNamespace(replaced=()), turns=False))
    other = Instead(300.0, 9, "m1", "repeats every 6.3 rad", "force_ripple at m1")
    stray, level = HeldOut(3.0, 0.7, 0.4, 0.02), NextLevel(1.0, "N", 0.5, 0.1, 0.001)
    rival = replace(FRICTION, rivals=(BAND,), with_richer=0.5)
    moved = {"m1": (1.0, Estimate(2.0, 1.9, 2.1, "kg"))}
    every = {
        Reason.LOST: answer(FRICTION, lost="x", instead=True),
        Reason.ONE_LAW: answer(FRICTION, instead=True, other=other),
        Reason.OTHER: answer(FRICTION, other=other, left=FORCE),
        Reason.LEFT: answer(FRICTION, left=FORCE, sound=WEAK),
        Reason.INADEQUATE: answer(FRICTION, sound=WEAK, bad="far"),
        Reason.BAD: answer(fails, bad="far"),
        Reason.MORE: answer(fails, law=law, free=stray),
        Reason.ONE_REGIME: answer(fails, free=stray),
        Reason.DISTURBED: answer(FRICTION, free=stray, sound=None),
        Reason.UNJUDGED: answer(FRICTION, sound=None, level=level),
        Reason.ONE_LEVEL: answer(rival, level=level, free=replace(GOOD, noise_floor=0.0)),
        Reason.RIVALS: answer(rival),
        Reason.IMPROBABLE: answer(replace(FRICTION, with_richer=0.94)),
        Reason.DOUBTED: answer(FRICTION, left=Left(0.0, "", hint="it may be another"), refit=moved),
        Reason.WITH_LEVEL: answer(FRICTION, *waves(0.0798, 0.0793), with_level=True),
        Reason.ONE_PERIOD: answer(FRICTION, *waves(0.0798, 0.0793), contacts=2),
        Reason.TOUCHED: answer(FRICTION, contacts=2),
        Reason.UNCONFIRMED: answer(replace(FRICTION, worth=Worth(1.01, 0.9, 0.5)), contacts=1),
        Reason.NAMED: answer(FRICTION, left=replace(FORCE, beside=91.0), refit=moved, contacts=1),
        Reason.LAW: answer(free=stray, law=law),
        Reason.STRAY: answer(free=stray, refit=moved),
        Reason.LINEAR: answer(refit=moved),
        Reason.NOTHING: answer(sound=replace(SOUND, better=0.0), bad="far"),
    }
    assert list(every) == list(Reason)
    assert [reason(facts) for facts in every.values()] == list(Reason)
    assert every[Reason.UNCONFIRMED].verdict is Verdict.UNDECIDED
    few, known, none = Worth(1.0, 0.0, 0.5), Worth(1.1, 1.1, 0.5), Worth(0.9, 2.0, 0.1)
    for worths, so in (([few], True), ([known, none], True), ([none], False)):
        named = reason(answer(*(replace(FRICTION, worth=w) for w in worths))) is Reason.NAMED
        assert named is so
    assert every[Reason.DOUBTED].verdict is Verdict.CONFUSABLE
    assert every[Reason.WITH_LEVEL].verdict is Verdict.CONFUSABLE
    assert "law of speed or force" in why(every[Reason.WITH_LEVEL])
    assert every[Reason.ONE_PERIOD].verdict is Verdict.CONFUSABLE
    assert "a force ripple at the motor and encoder eccentricity repeat with the same" in why(
        every[Reason.ONE_PERIOD]
    )
    assert reason(answer(*waves(0.0798, 0.0783))) is Reason.NAMED
    assert reason(answer(*waves(0.0798))) is Reason.NAMED
    assert every[Reason.TOUCHED].verdict is Verdict.CONFUSABLE
    assert headline(every[Reason.TOUCHED]).endswith(
        " is missing, if the 2 contacts in the recording were real"
    )
    assert "unless somebody touched the device" in why(every[Reason.TOUCHED])
    assert answer(sound=WEAK).verdict is Verdict.UNKNOWN_PHYSICS
    assert answer(FRICTION, sound=replace(SOUND, better=0.5)).verdict is Verdict.UNKNOWN_PHYSICS
    assert all(why(facts) for because, facts in every.items() if facts.law is None
               and because is not Reason.ONE_LAW)  # fmt: skip


def test_every_effect_has_words_and_its_size():
    """Breaks where an effect is added without a saying, or one asks for a value it has not."""
    for name, effect in EFFECTS.items():
        if effect.sought in ("given", "learned"):
            continue
        values = {p.name: Estimate(0.02, 0.019, 0.021, p.unit) for p in effect.parameters}
        found = Finding(name, effect.places[0], values, 9.0, ())
        assert name in SAYINGS
        text = in_words(found, 3)
        assert "_" not in text
        assert not values or any(c.isdigit() for c in text)


def test_friction_in_one_direction_only_is_said_so():
    """Mutations: "0 uN m backwards"; said of a level that is small and known."""

    def said(forwards: float, backwards: float) -> str:
        levels = {"level_plus": forwards, "level_minus": backwards}
        values = {n: Estimate(v, max(v - 2e-6, 0.0), v + 2e-6, "N m") for n, v in levels.items()}
        return in_words(Finding("directional_friction", "m1", values, 9.0, ()), 1)

    assert said(0.0439, 1e-8) == "friction of 43.9 mN m forwards (none backwards) at the motor"
    assert said(0.0, 0.0439) == "friction of 43.9 mN m backwards (none forwards) at the motor"
    assert said(0.0439, 0.001).endswith(" forwards and 1.00 mN m backwards at the motor")


def held(top: ForceMap, share: float) -> Located:
    names = ("within 12 ms of a velocity reversal", "elsewhere")
    pairs = zip(names, (share, 1.0 - share), strict=True)
    state = [{"name": n, "share": s, "time_share": 0.5} for n, s in pairs]
    return Located("", [], [], state, [], (top,))


def force_map(place: str, against: str, gained: float = 900.0) -> ForceMap:
    edges = np.linspace(-1.0, 1.0, 9)
    middle = 0.5 * (edges[1:] + edges[:-1])
    return ForceMap(place, against, edges, -np.sign(middle), np.full(8, 0.1), gained)


def test_where_says_what_the_map_shows():
    """And says nothing of a state that lies where the time is.

    Breaks where "55 % lies elsewhere (55 % of the time)" is said.
    """
    agrees = where(held(force_map("m1", "velocity"), 0.9), 1)
    assert agrees.startswith(
        "90 % of the prediction error of the refitted device lies within 12 ms of a velocity"
        " reversal (50 % of the time); "
    )
    even = where(held(force_map("m1", "velocity"), 0.55), 1)
    assert even == (
        "before effects are added, a force at the motor that depends on velocity and acts against"
        " the motion best describes what is missing"
    )
    assert "changes with time" in where(held(force_map("m1", "time"), 0.5), 1)
    both = replace(
        held(force_map("m1", "time"), 0.5),
        maps=(force_map("m1", "velocity", 880.0), force_map("m1", "time"), force_map("m1", "q", 9)),
    )
    assert where(both, 1) == (
        "before effects are added, a force at the motor describes what is missing about equally"
        " well, whether it depends on time or velocity"
    )
    quiet = where(held(force_map("m1", "velocity", 9.0), 0.5), 1)
    assert quiet.endswith("stands out from the noise")


def test_a_warning_where_an_answer_makes_a_simulation_worse():
    """Breaks where this is left for a table."""
    assert cautions((FRICTION,), GOOD, ()) == []
    (worse,) = cautions((FRICTION,), replace(GOOD, before=0.2, after=0.4), ())
    assert "more than with the device file as it is (20 %)" in worse


def whole(before: float, after: float) -> WholeRun:
    y = 1e-3 * 1.1 * np.sin(np.linspace(0.0, 20.0, 500))
    runs = {"before": y + before, "refit": y + before, "after": y + after}
    return WholeRun("swing", "position_m1", "rad", 0.0, 0.001, y, runs, True)


def test_a_whole_run_that_is_worse_is_said():
    """Breaks where only windows of half a second are judged."""
    (said,) = cautions((FRICTION,), GOOD, (whole(1e-4, 3e-4),))
    assert said.startswith("over the whole run, the error of the position of m1 in swing is 300")
    assert cautions((FRICTION,), GOOD, (whole(3e-4, 1e-4),)) == []


def test_the_first_picture_shows_before_and_after_with_their_errors():
    """In units of the motion; breaks where the device file's own run is left out."""
    figure = whole_run_figure(whole(3e-4, 1e-4))
    motion, error = figure.axes
    assert motion.get_ylabel() == "position of m1 [mrad]"
    assert error.get_ylabel() == "error [mrad]"
    labels = [line.get_label() for line in motion.get_lines()]
    assert labels[0] == "measured"
    assert "with the found effects: error 100 \u00b5rad rms (13 %)" in labels
    assert any(str(label).startswith("device file: error 300") for label in labels)
    assert not any("cut off" in str(label) for label in labels)
    far = whole_run_figure(whole(5e-3, 1e-4)).axes[0]
    cut = [str(line.get_label()) for line in far.get_lines()]
    assert [label.endswith(", cut off") for label in cut[:4]] == [False, True, True, False]
    alone = whole_run_figure(whole(3e-4, 1e-4), named=False).axes[0]
    assert [str(line.get_label())[:9] for line in alone.get_lines()][2] == "refitted:"


def test_a_level_that_the_origin_takes_up_is_not_drawn():
    """Breaks where a map that is told but for its level is drawn at -30 kN."""
    flat = force_map("m1", "velocity")
    shape = 1e-3 * flat.force
    located = held(replace(flat, force=shape - 30e3, error=1e-4 * flat.error), 0.5)
    axes = force_map_figure(located, False).axes[0]
    low, high = axes.get_ylim()
    assert high - low < 10.0


def experiment(command: float, output: Output) -> Experiment:
    ticks = np.arange(300) * 0.001
    return Experiment(0.001, command * np.sin(ticks), np.zeros((300, 1)), (output,))


def test_only_a_rig_that_may_render_a_wall_is_asked_for_one():
    """Breaks where a free decay, a slow loop, a velocity or a servo is held against a wall."""
    angle = Output("position", 0)
    assert may_render(MOTOR, [experiment(1.0, angle)])
    assert not may_render(MOTOR, [experiment(0.0, angle)])
    assert not may_render(MOTOR, [experiment(1.0, Output("velocity", 0))])
    assert not may_render(MOTOR.with_interface(period=0.02), [experiment(1.0, angle)])
    servo = make_physics("position_servo", "m1", stiffness=1.0, damping=0.1, back_emf=0.0)
    assert not may_render(MOTOR.with_physics(servo), [experiment(1.0, angle)])
