"""The longer horizon is asked wherever the next sample's answer is not known to hold."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import zwidth.diagnosis.selection.searched as module
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.adequacy import Adequacy, Ahead
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.searched import Searched, searched
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.run import simulate

CART = Device(
    "cart", "", False, make_chain([0.8], [3.0], 0.0, [], []), Interface(period=0.01, delay=0.0)
)
RUNS = Ahead(0.5, 1.0, 1.0, 2.0, 0.0, 0.1)  # that err as far as noise makes them
STANDS = Adequacy((RUNS,), 0.9, 10.0, False, module.TELLING)


def moved() -> Experiment:
    random = np.random.default_rng(3)
    command = np.repeat(random.standard_normal(80), 5)
    run = simulate(CART, recorded(command), duration=4.0)
    measured = run.trace["position_m1"] + 1e-4 * random.standard_normal(command.size)
    return Experiment(0.01, command, measured[:, None], (Output("position", 0),))


@pytest.mark.parametrize(
    ("how", "asked"),
    [
        (None, True),
        (replace(STANDS, ahead=(replace(RUNS, error=3.0),)), True),
        (replace(STANDS, runs=module.TELLING - 1), True),
        (STANDS, False),
    ],
)
def test_it_is_asked_where_nothing_is_foretold_refused_or_shown_by_enough_runs(
    how: Adequacy | None, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a friction damper no rehearsal stayed finite, and the next sample's answer stood.

    Mutation: what nothing is foretold of returned as it is.
    """
    far: list[Searched] = []

    def looked(_: Device, found: Searched, __: Any) -> Searched:
        far.append(found)
        return found

    monkeypatch.setattr(module, "holds", lambda *_: how)
    monkeypatch.setattr(module, "farther", looked)
    found = searched(CART, [moved()], silent, QUICK)
    assert bool(far) is asked
    assert found.held is (how is not None and how.sound)


@pytest.mark.parametrize(("gain", "doubtful"), [(1.0, False), (5.0, True), (-1.0, False)])
def test_two_at_once_are_asked_where_one_more_gains_beyond_chance(
    gain: float, doubtful: bool
) -> None:
    """Of three effects that are not there, the best gains 2 ln 3 = 2.2 by chance.

    Mutation: whatever costs less.
    """

    def tried(misfit: float, *labels: str) -> Any:
        cost = SimpleNamespace(misfit=misfit, total=misfit - 1.0 if len(labels) > 1 else misfit)
        return SimpleNamespace(labels=frozenset(labels), cost=cost)

    best = tried(0.0, "a@m1")
    more = [tried(-gain, "a@m1", "b@m1"), *(tried(9.0, "a@m1", x) for x in ("c@m1", "d@m1"))]
    near: Any = SimpleNamespace(best=best, tried={h.labels: h for h in (best, *more)})
    assert module._doubtful(near) is doubtful  # pyright: ignore[reportPrivateUsage]
