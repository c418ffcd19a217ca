"""What happened once, before a search and after it: one search, and at most one that goes on.

An event bends every fit, and a search takes it for physics: of a hand on a mass with dry friction
it named four effects, in ten times the time. So what stands out of chance under the device file
alone is asked for before anything is searched (`time.events`, one pass), and the recordings that
are searched are cut there. The answer of that search sees them as they are once more, whole: an
event in the held-out data would spoil what they judge. What happens under it is fitted, its force
is known from then on in every prediction and free run, and a slip is taken off the reading. What
the search had tried is fitted anew to that; where the best of it has the names it had, and free
runs hold, these stand, else the search goes on from there.

Names come first. What was cut out before the search, or lies in held-out data, the search has not
seen (an amplifier that meets its limit once looks like a force that acts for a while). So it is
asked whether one effect more explains it: then nothing happened.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.model.own_values import first_x, varying
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.selection.search import Search, fitted, searched_on
from zwidth.diagnosis.selection.searched import Searched, as_found, holds, runs_freer
from zwidth.diagnosis.settings import EVENTS
from zwidth.diagnosis.time.events import Peak, happenings, highest
from zwidth.diagnosis.time.force import Happened, with_events


def every_recording(taken: Taken) -> tuple[Experiment, ...]:
    """Return all that was recorded, whole: what happens in it counts its ticks."""
    return (*taken.whole, *(() if taken.whole_unopened else taken.judge_by))


def before_search(taken: Taken) -> Taken:
    """Return recordings without what stands out before anything is searched, or as they are.

    Only where that is seen without a fit is anything fitted. A recording is cut where a force acts
    that is not known: fitted under a device without its physics, it would hide some of that. As
    they are where cuts leave less than half.
    """
    model = Model(taken.device, varying=varying(taken.device, taken.fit_on))
    try:
        plain = judged(taken.fit_on, model, first_x(model, taken.fit_on))
        if highest(every_recording(taken), plain) is None:
            return taken
        known = [one for one in _happened(taken, settled(plain)) if _in_fit(one, taken)]
    except NoObserver:
        return taken
    there = known_in(taken, [one for one in known if one.source.lasting])
    parts = tuple(
        part
        for i, e in enumerate(there.fit_on)
        for part in _between(e, [o for o in known if o.recording == i and not o.source.lasting])
    )
    left = sum(part.ticks for part in parts) / sum(e.ticks for e in taken.fit_on)
    return replace(there, fit_on=parts) if known and left > 0.5 else taken


def _between(e: Experiment, known: Sequence[Happened]) -> Iterator[Experiment]:
    """Yield the parts of a recording beside forces, each long enough to observe; all of it."""
    first = 0
    for one in (*known, None):
        beside = 0 if one is None else (one.last - one.first) // 3
        last = e.ticks if one is None else min(one.first - beside, e.ticks)
        if (first, last) == (0, e.ticks):
            yield e
            return
        if last - first >= 6 * SETTLING:
            yield e.part(first, last)
        first = e.ticks if one is None else one.last + beside


def knowing(
    taken: Taken, seen: Taken, found: Searched, say: Say
) -> tuple[Taken, Searched, tuple[Happened, ...]]:
    """Return recordings that know what happened in them, the answer then, and what happened.

    taken: as recorded; seen: as they were searched (`before_search`). The recordings as they are
    where nothing happened, or none of it can be followed.
    """
    with suppress(NoObserver):
        return _knowing(taken, seen, found, say)
    return taken, found, ()


def _knowing(
    taken: Taken, seen: Taken, found: Searched, say: Say
) -> tuple[Taken, Searched, tuple[Happened, ...]]:
    peak, cut = peak_of(taken, found), seen is not taken
    later = peak is not None and taken.whole_unopened and not _in_fit(peak, taken)
    named: Search | None = None
    if peak is not None and (later or cut):
        say("something may have happened: asking whether one effect explains it")
        named = _with_a_name(found.tried, taken, taken.whole if later else taken.fit_on)
    if named is not None and not later:
        return taken, _searched_on(found, named, say), ()
    # Named only with what was held out: what a second look makes of that is its own matter.
    nothing = peak is None or named is not None
    known = () if nothing else _happened(taken, found.tried.best)
    for one in known:
        e = every_recording(taken)[one.recording]
        say(f"something happened at {e.begins + one.first * e.period:.3g} s")
    there = known_in(taken, known) if known else taken
    if cut or any(_in_fit(one, taken) for one in known):
        found = _anew(found, there.fit_on, say)
    return there, found, known


def _in_fit(one: Happened | Peak, taken: Taken) -> bool:
    """Whether what begins at a tick of all that was recorded is in what is fitted."""
    own = one.recording
    return own < len(taken.whole) and one.first < taken.fit_on[own].ticks


def peak_of(taken: Taken, found: Searched) -> Peak | None:
    """Return what stands out most of chance, None where nothing does.

    An answer that was chosen for its free runs leaves what the next sample shows and names (a
    ripple, how friction sets in), which would seem to happen at each turn: both are asked.
    """
    every = every_recording(taken)
    if found.near is not None and highest(every, found.near) is None:
        return None
    return highest(every, found.tried.best)


def _with_a_name(before: Search, taken: Taken, recordings: Sequence[Experiment]) -> Search | None:
    """The search with one effect more that explains what seems to happen; None where none does."""

    def again(h: Hypothesis) -> Hypothesis:
        return settled(judged(recordings, h.model, h.x, h.family, None, h.prices))

    search = _begun(before, again(before.best))
    moves, effort = search.moves.adding, search.effort
    proposals = [p for move in moves for p in move(search.best, effort)]
    for h in fitted(search, proposals, effort.ended):
        if search.ahead(h, search.best) and highest(every_recording(taken), h) is None:
            search.plain, search.best = again(before.plain), h
            search.keep(search.plain)
            return search
    return None


def _begun(before: Search, best: Hypothesis) -> Search:
    """A search that has tried nothing yet but one hypothesis."""
    new = replace(before, best=best, tried={}, grown=set(), looked=set(), exchanged=set())
    new.keep(best)
    return new


def _happened(taken: Taken, best: Hypothesis) -> tuple[Happened, ...]:
    """What happens as a hypothesis sees it; a force that acts until the end may be a change."""
    every = every_recording(taken)
    if highest(every, best) is None:
        return ()
    seen = happenings(every, best, lambda known: known_in(taken, known).fit_on)
    return tuple(one for one in seen if one.source.lasting or _ends(one, every[one.recording]))


def _ends(one: Happened, e: Experiment) -> bool:
    return e.ticks - one.last >= EVENTS.ended * (one.last - one.first)


def known_in(taken: Taken, known: Sequence[Happened]) -> Taken:
    """Return recordings, whole and in their parts, that know of events."""
    there = with_events(every_recording(taken), known)
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
    return replace(part, measured=whole.measured[cut], force=force)


def _anew(found: Searched, experiments: Sequence[Experiment], say: Say) -> Searched:
    """What was found, on recordings of which it was not known before what happened in them.

    An event spoils free runs, for which an answer over a longer horizon was asked: that of the next
    sample is fitted anew first, and stands where its free runs hold now.
    """
    far = found.beside if found.near is not None else None
    near = far or found
    tried = _fitted_anew(near.tried, experiments)
    first = _held(tried)
    if tried.best.labels != near.tried.best.labels or (near.held and not first.held):
        return _searched_on(found, tried, say)
    if first.held or far is None:
        return replace(first, far=found.far)
    second = as_found(tried.plain.model.nominal, _fitted_anew(found.tried, experiments))
    if runs_freer(second, first, experiments):
        return replace(second, far=True, near=tried.best, beside=first)
    return replace(first, far=True, beside=second)


def _searched_on(found: Searched, tried: Search, say: Say) -> Searched:
    say(f"searching on from {tried.best.model.label}, knowing what happened")
    searched_on(tried)
    return replace(_held(tried), far=found.far)


def _held(tried: Search) -> Searched:
    """An answer, and whether its free runs hold."""
    device = tried.plain.model.nominal
    found = as_found(device, tried)
    sound = attempt("search", "how far ahead it holds", partial(holds, device, found))
    return replace(found, held=sound is not None and sound.sound)


def _fitted_anew(before: Search, experiments: Sequence[Experiment]) -> Search:
    """What was tried, on other recordings: the cheapest of it are fitted to them."""
    every: list[Hypothesis] = []
    for h in before.tried.values():
        with suppress(NoObserver):
            every.append(judged(experiments, h.model, h.x, h.family, None, h.prices))
    order = sorted(every, key=lambda h: h.cost.total)
    kept = {before.plain.labels, before.best.labels}
    asked = [h for i, h in enumerate(order) if i < before.effort.near or h.labels in kept]
    fits = (attempt("events", h.model.label, partial(settled, h)) for h in asked)
    done = [h for h in fits if h is not None and not h.against_physics]
    plain = next(h for h in done if h.labels == before.plain.labels)
    found = replace(_begun(before, plain), plain=plain)
    for h in sorted(done, key=lambda h: (len(h.model.effects), h.cost.total)):
        found.keep(h)
        if found.ahead(h, found.best):
            found.best = h
    return found
