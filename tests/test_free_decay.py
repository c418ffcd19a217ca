"""A device that was let go: no command at all, and what brakes it is told all the same."""

import numpy as np
import pytest

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.result import Verdict
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.recording.experiment import Experiment, experiment
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate
from zwidth.sim.trace import Trace

PERIOD, SECONDS = 0.005, 6.0
CART = Device(
    "cart on a spring", "", False, make_chain([0.755], [1.5], 300.0), Interface(period=PERIOD)
)


def let_go(device: Device, command: bool) -> Trace:
    ticks = round(SECONDS / PERIOD)
    run = simulate(
        device, recorded(np.zeros(ticks)), duration=SECONDS, start=Start(0.03), substeps=20
    )
    q = run.trace["position_m1"]
    y = q + 2e-5 * np.random.default_rng(3).standard_normal(q.size)
    channels = {"position_m1": y} | ({"command": np.zeros(q.size)} if command else {})
    return Trace(run.trace.t, channels, {"position_m1": "m", "command": "N"}, "recorded")


@pytest.mark.parametrize("command", [True, False])
def test_a_recording_without_a_command_is_taken_as_a_free_motion(command: bool) -> None:
    e = experiment(let_go(CART, command), CART, "swing")
    assert np.ptp(e.command) == 0.0
    assert any("free motion" in note or "nothing drives" in note for note in e.notes)


def test_what_drives_a_swing_is_the_force_of_its_spring() -> None:
    e = experiment(let_go(CART, True), CART)
    sizes = sizes_of(CART, [e])
    assert not sizes.driven
    held = 300.0 * float(np.std(e.measured))
    assert sizes.force == pytest.approx(held, rel=0.1)


def found(device: Device) -> tuple[Verdict, dict[str, object], Experiment]:
    e = experiment(let_go(device, True), CART)
    answer = diagnose(CART, [e], effort=QUICK)
    assert not answer.errors
    return answer.verdict, {f"{f.effect}@{f.at}": f.parameters for f in answer.findings}, e


def test_dry_friction_is_told_from_a_decay_by_its_straight_envelope() -> None:
    """From rest to rest the amplitude falls by 4 F / k a period, whatever the mass."""
    verdict, findings, _ = found(
        CART.with_physics(make_physics("coulomb_friction", "m1", level=0.12))
    )
    assert list(findings) == ["coulomb_friction@m1"]
    level = findings["coulomb_friction@m1"]["level"]  # pyright: ignore
    assert level.value == pytest.approx(0.12, rel=0.05)  # motion alone tells no scale of forces
    assert level.lower < 0.12 < level.upper
    assert verdict in (Verdict.IDENTIFIED, Verdict.CONFUSABLE)


def test_a_viscous_decay_lacks_nothing() -> None:
    verdict, findings, _ = found(CART)
    assert verdict in (Verdict.NOTHING_MISSING, Verdict.LINEAR_PARAMETERS)
    assert not findings
