"""Events that happened once: excluded from the search for physics, reported in the answer.

An event distorts every fit, and a search would mistake it for physics. So a search sets apart
(`events.set_apart`) a part of the recording that chance does not explain, if it explains more than
the next effect. The answer is then computed from the complete recordings: an event in held-out data
would spoil the judgement, although no parameter is fitted to it. The force of the event is fitted,
and included from then on in every prediction and free run; a slip is subtracted from the reading.
The hypotheses of the search are fitted again with it. If the best of them has the same effects, and
its free runs are adequate, these remain the answer; otherwise the search continues from there.

Named effects have precedence. A lost command of the answer acts like a hit of one sample, so lost
commands are looked for in the complete recordings first. The search has not seen the parts set
apart or held out, and there an amplifier that reaches its limit once looks like a force that acts
for a while. So first one more effect is tried; if it explains the apparent event, no event
happened.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

from zwidth.diagnosis.answer.events import Event, all_said
from zwidth.diagnosis.answer.stands import knowing_losses
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.learning.event_force import Happened
from zwidth.diagnosis.learning.events import Peak, happenings, highest, with_events
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.selection.search import Search, explaining, searched_on
from zwidth.diagnosis.selection.searched import (
    Searched,
    as_found,
    begun_on,
    fitted_anew,
    held,
    runs_freer,
)
from zwidth.diagnosis.settings import PURSUIT

ENDED = 0.1  # of a force's duration: least time recorded after its end


def knowing_events(
    taken: Taken, found: Searched, say: Say
) -> tuple[Taken, Searched, tuple[Event, ...]]:
    """Return recordings with their events, the answer for these, and the events.

    Recordings and answer are unchanged if nothing happened, or if the search was interrupted.
    """
    if found.interrupted:
        return taken, found, ()
    try:
        asked = partial(_known, taken, found, say)
        there, found, known = attempt("events", "", asked) or (taken, found, ())
        every = _every(_with_losses(taken, found))
        said_of = partial(all_said, every, found.tried.best, known)
        events = attempt("events", "what they brought", said_of) or ()
    except KeyboardInterrupt:
        say("interrupted: judging the result so far; press Ctrl-C again to quit")
        return taken, replace(found, tried=replace(found.tried, interrupted=True)), ()
    for event in events:
        say(event.sentence)
    return there, found, events


def _known(taken: Taken, found: Searched, say: Say) -> tuple[Taken, Searched, tuple[Happened, ...]]:
    """Recordings with their events, the answer for these, and the events."""
    given = taken
    with suppress(NoObserver):
        taken = _with_losses(taken, found)
        peak, apart = _peak(_every(taken), found), found.tried.apart > 0
        later = peak is not None and taken.whole_unopened and _goes_beyond(peak, taken)
        known = () if peak is None else _happened(taken, found.tried.best)
        named: Search | None = None
        shown = False
        if (apart and peak is not None) or (later and known):
            say("possible one-time event: checking whether an effect explains it instead")
            named = _with_a_name(found.tried, taken, taken.whole if later else taken.fit_on)
        if named is not None:
            if not later:
                return taken, _searched_on(found, named, say), ()
            # An effect that only held-out data show is left to the search of all recorded data.
            known, shown = (), True
        for one in known:
            e = _every(taken)[one.recording]
            say(f"one-time event found at {e.begins + one.first * e.period:.3g} s")
        there = _with(taken, known) if known or apart else given
        if apart or any(_in_fit(one, taken) for one in known):
            found = _anew(found, there.fit_on, say)
        return there, replace(found, later=True) if shown else found, known
    return given, found, ()


def _with_losses(taken: Taken, found: Searched) -> Taken:
    """Recordings, complete and in their parts, with the commands that the answer calls lost."""
    if not found.final.model.has("dropped_samples"):
        return taken
    every = attempt("events", "lost commands", partial(knowing_losses, found, _every(taken)))
    if every is None:
        return taken
    whole, others = every[: len(taken.whole)], every[len(taken.whole) :]
    return _with(replace(taken, whole=tuple(whole), judge_by=tuple(others) or taken.judge_by), ())


def _every(taken: Taken) -> tuple[Experiment, ...]:
    """All recorded data, complete, in which the ticks of an event are counted."""
    return (*taken.whole, *(() if taken.whole_unopened else taken.judge_by))


def _in_fit(one: Happened, taken: Taken) -> bool:
    """Whether an event at a tick of all recorded data begins in the fitted part."""
    own = one.recording
    return own < len(taken.whole) and one.first < taken.fit_on[own].ticks


def _goes_beyond(peak: Peak, taken: Taken) -> bool:
    """Whether a stretch of all recorded data ends after the part that the search has seen."""
    own = peak.recording
    return own >= len(taken.whole) or peak.last > taken.fit_on[own].ticks


def _peak(every: Sequence[Experiment], found: Searched) -> Peak | None:
    """The stretch that differs most from chance, None if none does.

    Named effects have precedence: an answer chosen for its free runs lacks effects that only
    one-step errors show (a ripple, the onset of friction), and would seem to have an event at each
    reversal.
    """
    if found.near is not None and highest(every, found.near) is None:
        return None
    return highest(every, found.tried.best)


def _with_a_name(before: Search, taken: Taken, recordings: Sequence[Experiment]) -> Search | None:
    """The search with one more effect that explains the apparent event; None if none does."""

    def again(h: Hypothesis) -> Hypothesis:
        return settled(judged(recordings, h.model, h.x, h.family, None, h.prices))

    best, beside = again(before.best), before.best
    # Cost of the event beyond that of ordinary noise there; `Search` set it apart because of it.
    explained = best.cost.misfit - beside.cost.misfit * best.samples / beside.samples
    least = PURSUIT.rival_share * explained if before.apart else PURSUIT.no_sign
    search = begun_on(before, again(before.plain), best)
    named = explaining(search, least, lambda h: highest(_every(taken), h) is None)
    if named is None:
        return None
    search.best = named
    return search


def _happened(taken: Taken, best: Hypothesis) -> tuple[Happened, ...]:
    """Events according to a hypothesis; a force that acts until the end may be a change."""
    every = _every(taken)
    if highest(every, best) is None:
        return ()
    seen = happenings(every, best, lambda known: _with(taken, known).fit_on)
    return tuple(one for one in seen if one.source.lasting or _ends(one, every[one.recording]))


def _ends(one: Happened, e: Experiment) -> bool:
    """Whether a force clearly ends: one that acts until the last sample may be a change."""
    return e.ticks - one.last >= ENDED * (one.last - one.first)


def _with(taken: Taken, known: Sequence[Happened]) -> Taken:
    """Recordings, complete and in their parts, with their events."""
    there = with_events(_every(taken), known)
    whole, others = there[: len(taken.whole)], there[len(taken.whole) :]
    if not taken.whole_unopened:
        return replace(taken, whole=tuple(whole), fit_on=tuple(whole), judge_by=tuple(others))
    fit_on: list[Experiment] = []
    judge_by: list[Experiment] = []
    for e, first, rest in zip(whole, taken.fit_on, taken.judge_by, strict=True):
        cut = first.ticks
        fit_on.append(_part(first, e, slice(0, cut)))
        judge_by.append(replace(_part(rest, e, slice(cut, e.ticks)), before=fit_on[-1]))
    return replace(taken, whole=tuple(whole), fit_on=tuple(fit_on), judge_by=tuple(judge_by))


def _part(part: Experiment, whole: Experiment, cut: slice) -> Experiment:
    force = None if whole.force is None else whole.force[cut]
    dropped = None if whole.dropped is None else whole.dropped[cut]
    return replace(part, measured=whole.measured[cut], force=force, dropped=dropped)


def _anew(found: Searched, experiments: Sequence[Experiment], say: Say) -> Searched:
    """The result of the search, fitted again to recordings with their events.

    Because the event spoiled free runs, an answer over a longer horizon may have been tried. So the
    answer by one-step errors is fitted again first, and kept if its free runs are now adequate.
    """
    far = found.beside if found.near is not None else None
    near = far or found
    tried = fitted_anew(near.tried, experiments)
    first = held(tried)
    if tried.best.labels != near.tried.best.labels or (near.held and not first.held):
        return _searched_on(found, tried, say)
    if first.held or far is None:
        return replace(first, far=found.far)
    second = as_found(tried.plain.model.nominal, fitted_anew(found.tried, experiments))
    if runs_freer(second, first, experiments):
        return replace(second, far=True, near=tried.best, beside=first)
    return replace(first, far=True, beside=second)


def _searched_on(found: Searched, tried: Search, say: Say) -> Searched:
    say(f"one-time events have been checked; the search continues from {tried.best.model.label}")
    searched_on(tried)
    return replace(held(tried), far=found.far)
