"""What a link gives way, and the force in it, as outputs beside a mass's own motion."""

from dataclasses import replace

import numpy as np
import pytest

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import innovations
from zwidth.diagnosis.noise.steady import steady, steady_gains
from zwidth.diagnosis.recording.experiment import ExperimentError, experiment
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate
from zwidth.sim.trace import Trace

T, SPRING = 0.002, 800.0
ELASTIC = Device(
    "series elastic", "", False, make_chain([0.4, 0.9], [0.5, 1.5], 60.0, [SPRING], [0.3]),
    Interface(period=T),
)  # fmt: skip
NOISE = 1e-6


def rig(first: str, device: Device = ELASTIC) -> Trace:
    """A motion of m1 beside the deflection of the link and its force."""
    random = np.random.default_rng(3)
    command = np.repeat(random.normal(0.0, 4.0, 400), 10)
    run = simulate(device, recorded(command), duration=command.size * T, substeps=8).trace
    away = run["position_m1"] - run["position_m2"] + NOISE * random.standard_normal(len(run))
    own = run[first] + NOISE * random.standard_normal(len(run))
    return Trace(
        run.t,
        {"command": run["command"], "position_link12": away, "force_link12": SPRING * away,
         first: own},
        {"command": "N", "position_link12": "m", "force_link12": "N",
         first: "m" if first.startswith("position") else "m/s"}, "recorded", {},
    )  # fmt: skip


def without(trace: Trace, *names: str) -> Trace:
    return trace.with_channels({k: v for k, v in trace.channels.items() if k not in names})


@pytest.mark.parametrize("first", ["position_m1", "velocity_m1"])
def test_the_true_device_foretells_what_its_link_gives_way(first: str) -> None:
    """Mutation that breaks it: the deflection with its sign turned, in the kernel or the gain."""
    taken = experiment(without(rig(first), "force_link12"), ELASTIC)
    assert [o.name for o in taken.outputs] == [first, "position_link12"]
    observer = steady(ELASTIC, taken, 1e-6)
    left = innovations(ELASTIC, taken, observer.gain)[2000:]  # the start is forgotten
    moved = np.std(taken.measured, axis=0)
    assert np.std(left[:, 1]) < 2.0 * NOISE + 1e-4 * moved[1]
    assert np.std(left[:, 0]) < 2.0 * NOISE + 1e-3 * moved[0]


def test_gains_of_many_devices_are_those_of_each() -> None:
    taken = experiment(without(rig("position_m1"), "force_link12"), ELASTIC)
    other = ELASTIC.with_chain(make_chain([0.5, 0.8], [0.5, 1.5], 60.0, [700.0], [0.3]))
    each = steady_gains([ELASTIC, other], taken, 0.01)
    for device, gain in zip([ELASTIC, other], each, strict=True):
        np.testing.assert_allclose(gain, steady(device, taken, 0.01).gain, rtol=1e-6, atol=1e-9)


def test_a_force_in_a_link_is_what_it_gives_way() -> None:
    trace = rig("velocity_m1")
    by_force = experiment(without(trace, "position_link12"), ELASTIC)
    by_stretch = experiment(without(trace, "force_link12"), ELASTIC)
    assert by_force.outputs == by_stretch.outputs
    np.testing.assert_allclose(by_force.measured, by_stretch.measured, rtol=1e-12)
    assert any(
        "is taken as the deflection of link12, with the 800 N/m" in n for n in by_force.notes
    )


def test_a_fit_finds_friction_behind_a_link_whose_deflection_is_read() -> None:
    """From masses and a link 20 % off. Mutation: the gain's row of the second mass left out."""
    device = ELASTIC.with_physics(make_physics("coulomb_friction", "m2", level=0.5))
    taken = experiment(without(rig("velocity_m1", device), "force_link12"), ELASTIC)
    guessed = ELASTIC.with_chain(make_chain([0.48, 1.0], [0.5, 1.5], 60.0, [700.0], [0.3]))
    model = Model(guessed).with_effect(
        make_physics("coulomb_friction", "m2", level=0.4), {"level": 0.2}
    )
    found = settled(judged([taken], model, np.zeros(len(model.parameters))))
    assert model.effects_at(found.x)[0].values["level"] == pytest.approx(0.5, rel=0.05)
    assert model.build(found.x).chain.link_springs[0] == pytest.approx(SPRING, rel=0.02)


def test_a_deflection_alone_is_refused() -> None:
    trace = without(rig("position_m1"), "position_m1")
    with pytest.raises(ExperimentError, match="also needs the position or velocity of a mass"):
        experiment(trace, ELASTIC)


def test_a_link_that_the_device_has_not_is_left_out() -> None:
    trace = rig("position_m1")
    single = replace(ELASTIC, chain=make_chain([1.3], [2.0], 60.0))
    taken = experiment(trace, single)
    assert [o.name for o in taken.outputs] == ["position_m1"]
    assert any("position_link12, which is left out" in note for note in taken.notes)
