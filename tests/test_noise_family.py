"""All models of the noise at once: each what it is by itself, and the likeliest of them."""

import numpy as np
import pytest
from fitting_examples import drive, play, recording

from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import NEXT_SAMPLE, Family, likeliest, noises
from zwidth.diagnosis.noise.gaps import Changing, steadily
from zwidth.diagnosis.noise.settle import prepared_for
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.sim.physics import make_physics

FRICTION = make_physics("coulomb_friction", "m1", level=0.02)


def model_of(*physics: object) -> Model:
    effects = tuple(p for p in physics if hasattr(p, "effect"))
    return Model(drive(), effects, tuple({} for _ in effects))  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("physics", [(), (FRICTION,), (play(0.01), FRICTION)])
def test_each_of_the_family_is_what_it_is_by_itself(physics: tuple[object, ...]) -> None:
    """Gain, beginning and cost of two recordings. Mutations: one beginning for all; no scale."""
    truth = drive().with_physics(FRICTION)
    recordings = [recording(truth, 900, 3, (0, 1)), recording(truth, 700, 4, (0, 1))]
    model, ratios = model_of(*physics), np.array([1e-3, 1e-1, 10.0])
    x = np.zeros(len(model.parameters))
    found = noises(recordings, model, x, Family(tuple(ratios.tolist())))
    assert [n.observer.ratio for n in found] == ratios.tolist()
    for noise in found:
        alone = prepared_for(recordings, model, x, Family((noise.observer.ratio,)))
        assert np.allclose(steadily(noise.observer.gain), steadily(alone.observer.gain), rtol=1e-6)
        own = noise.problem(recordings)
        assert noise.cost == pytest.approx(own.observer.cost(own.weighted(model, x)), abs=1e-6)
        # Other substeps in ticks that turn, as for a search: half a unit of some 10 000.
        expected = alone.observer.cost(alone.weighted(model, x))
        if isinstance(alone.observer.gain, Changing):  # with play, along the motion
            assert expected < noise.cost + 1e-6
        else:
            assert noise.cost == pytest.approx(expected, rel=2e-3)


def test_what_scatters_by_its_encoder_alone_is_believed_and_what_is_pushed_is_not() -> None:
    """Mutation: the largest cost in place of the least."""
    truth, model = drive().with_physics(FRICTION), model_of(FRICTION)
    x = np.zeros(len(model.parameters))
    calm = recording(truth, 1500, 3)
    random = np.random.default_rng(1)
    pushed = recording(truth, 1500, 3, push=0.02 * random.standard_normal(1500))
    quiet, shaken = (likeliest([e], model, x).observer.ratio for e in (calm, pushed))
    assert quiet < 1e-2
    assert shaken > 1e2 * quiet


def test_where_nothing_follows_it_says_so() -> None:
    model = model_of()
    made = recording(drive(), 600, 3)
    x = np.zeros(len(model.parameters))
    x[[p.name for p in model.parameters].index("b1")] = -25.0
    with pytest.raises(NoObserver, match="linear"):
        likeliest([made], model, x)


def test_a_ratio_beyond_the_family_is_near_its_end() -> None:
    """An observer that trusts the device a thousand times more; mutation: no ratio at all."""
    for ratio, end in ((1e-13, 0), (1e10, -1)):
        near = NEXT_SAMPLE.near(ratio).ratios
        assert NEXT_SAMPLE.ratios[end] in near
        assert len(near) == 3
    assert Family((1e-3,)).near(1e3).ratios == (1e-3,)
