"""The longer horizon beside the next sample: what it prefers, and what it may not lose."""

from dataclasses import replace

import numpy as np
import pytest
from fitting_examples import drive, recording

from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import as_far_as
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection import search as searching
from zwidth.diagnosis.selection import searched
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import Hypothesis, independent, judged, settled
from zwidth.diagnosis.selection.search import Moves, Search, search
from zwidth.diagnosis.selection.slower import FAR_S, Slower
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

FRICTION = make_physics("coulomb_friction", "m1", level=0.03)
LAG = make_physics("actuator_lag", "command", time_constant=1e-3)


@pytest.fixture(scope="module")
def rubbed() -> list[Experiment]:
    """Two masses with Coulomb friction of 0.03 N m at the motor."""
    return [recording(drive().with_physics(FRICTION), 3000, 1)]


def fitted(experiments: list[Experiment], *physics: Physics) -> Hypothesis:
    model = Model(drive())
    for p in physics:
        model = model.with_effect(p, dict(p.values))
    return settled(judged(experiments, model, np.zeros(len(model.parameters))))


def cheaper(h: Hypothesis, by: float) -> Hypothesis:
    """The same, as if the next sample liked it better."""
    return replace(h, cost=replace(h.cost, misfit=h.cost.misfit - by))


def test_what_explains_more_over_the_horizon_comes_first(rubbed: list[Experiment]) -> None:
    """However much more the next sample says of the other. Mutation: the order as it is."""
    rubs, lags = fitted(rubbed, FRICTION), cheaper(fitted(rubbed, LAG), 1e6)
    assert Slower(fitted(rubbed)).first([lags, rubs])[0] is rubs
    assert Slower(fitted(rubbed)).first([rubs, lags])[0] is rubs


def test_what_is_as_good_over_the_horizon_stays_in_its_place(rubbed: list[Experiment]) -> None:
    """Mutation: the least of all, by however little."""
    rubs = fitted(rubbed, FRICTION)
    both = fitted(rubbed, FRICTION, LAG)
    assert Slower(fitted(rubbed)).first([rubs, both])[0] is rubs
    assert Slower(fitted(rubbed)).first([both, rubs])[0] is both


def test_what_the_next_sample_drops_is_looked_at_if_it_explains_more(
    rubbed: list[Experiment],
) -> None:
    """Mutation: nothing beside what is likely."""
    rubs, lags = fitted(rubbed, FRICTION), fitted(rubbed, LAG)
    assert Slower(fitted(rubbed)).ahead_of([lags], [rubs]) == [rubs]
    assert Slower(fitted(rubbed)).ahead_of([rubs], [lags]) == []


def test_a_search_on_other_recordings_goes_on_from_its_answer(rubbed: list[Experiment]) -> None:
    """A limit that only the rest of a recording reaches is found beside the friction.

    Mutations: all but the refit forgotten; nothing added.
    """
    limit = make_physics("saturation", "command", limit=0.12)
    whole = recording(drive().with_physics(FRICTION, limit), 3000, 1)
    plain, rubs = fitted([whole.part(0, 1500)]), fitted([whole.part(0, 1500)], FRICTION)
    found = Search(plain, rubs, replace(QUICK, effects=2), silent)
    for h in (plain, rubs):
        found.keep(h)
    again = searched.searched_through(searched.as_found(drive(), found), [whole])
    assert again.problem.experiments[0].ticks == 3000
    assert again.tried.best.labels == {"coulomb_friction@m1", "saturation@command"}


def test_an_exchange_does_not_lose_what_the_horizon_needs(
    rubbed: list[Experiment], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lag that costs less in the next sample takes no friction's place.

    Mutation: `needs` says no.
    """
    plain, rubs, lags = (fitted(rubbed, *those) for those in ((), (FRICTION,), (LAG,)))
    monkeypatch.setattr(searching, "_instead", lambda _: iter([[cheaper(lags, 1e6)]]))
    for slower, stays in ((Slower(fitted(rubbed)), True), (None, False)):
        found = Search(plain, rubs, QUICK, silent, slower=slower)
        searching._exchanged(found)
        assert (found.best is rubs) is stays


def test_a_search_goes_on_from_what_another_found(rubbed: list[Experiment]) -> None:
    """Where it is believed over nothing: a lag that explains nothing is not.

    Mutation: it begins with nothing.
    """
    nothing = Moves((), (), (), (), lambda _: lambda *_: iter(()))
    for physics, stays in ((FRICTION, {"coulomb_friction@m1"}), (LAG, set[str]())):
        far = as_far_as(FAR_S, rubbed)
        near = fitted(rubbed, physics)
        begun = independent(judged(rubbed, near.model, near.x, far), FAR_S)
        found = search(drive(), rubbed, QUICK, silent, nothing, begun.family, begun)
        assert found.best.labels == stays


def test_what_physics_forbids_leaves_its_room_to_what_comes_near(
    rubbed: list[Experiment], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And to nothing that is far from it. Mutations: no second try; all that was judged."""
    plain = fitted(rubbed)
    wrong = fitted(rubbed, FRICTION)
    forbidden = wrong.labels
    monkeypatch.setattr(
        Hypothesis, "against_physics", property(lambda h: "x" if h.labels == forbidden else "")
    )
    monkeypatch.setattr(searching, "settled", lambda h, turns=3: h)
    lags = fitted(rubbed, LAG)
    for behind, stands in ((50.0, [lags.labels]), (1e4, [])):
        there = cheaper(lags, lags.cost.total - wrong.cost.total - behind)
        found = Search(plain, plain, replace(QUICK, ended=1), silent)
        monkeypatch.setattr(searching, "_comes_near", lambda *_: True)
        finished = searching._to_their_end(found, [wrong, there], 1, set())
        assert [h.labels for h in finished] == stands
