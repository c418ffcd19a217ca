"""Real recordings: the physics that their publishers found, found again.

The whole diagnosis of the haptic paddle takes minutes: its page in docs/machines is made by hand.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.intake.gate import examine
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, experiment, stretches
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.evidence import believed
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against, judged, settled
from zwidth.logs.recording import read_recording
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics

TOMLS = Path(__file__).parent / "recordings"
SHARED = Path(__file__).parents[1].parent / "shared" / "recordings"


def recording(name: str, device: Device, to_s: float) -> Experiment:
    if not (SHARED / name).is_dir():
        pytest.skip(
            f"the recording {name} is not ours to distribute, and is not beside the project"
        )
    trace = read_recording(TOMLS / f"{name}.toml", SHARED / name)
    cut = trace.between(float(trace.t[0]), to_s)
    return experiment(cut, device, name)


@pytest.mark.truth
def test_emps_lacks_friction_and_an_offset():
    """Published: 20.3935 N and 3.16 N, beside 95.1 kg and 203.5 N s/m, which the device file knows.

    The offset may show as friction that differs by direction: what brakes at 0.1 m/s is the same.
    A level that changes counts as its mean, since the published ones are those of a law that stays.
    Mutation that breaks it: no search over a longer horizon (friction of 8 N beside a hysteresis).
    """
    device = Device("EMPS", "", False, make_chain([95.1089], [203.5034]), Interface(period=1e-3))
    found = diagnose(device, [recording("emps", device, 10.0)], effort=QUICK)
    first = found.findings[0]
    assert first.effect in ("coulomb_friction", "directional_friction")
    assert first.at == "m1"
    lately = {c.parameter: 0.5 * (c.after.value - c.before.value) for c in found.changes}
    braking = [_brakes(found.device, v, lately) for v in (0.1, -0.1)]
    assert np.mean(np.abs(braking)) == pytest.approx(20.3935 + 203.5034 * 0.1, rel=0.03)
    assert np.abs(np.sum(braking)) / 2.0 == pytest.approx(3.16, rel=0.3)
    assert found.free_run.after < 0.15 * found.free_run.refit


def _brakes(device: Device, velocity: float, lately: dict[str, float]) -> float:
    """The force [N] that brakes a mass that moves at a velocity, with its sign.

    lately: by how much more a parameter is at the end than in the mean.
    """
    force = device.chain.ground_dampers[0] * velocity
    side = "plus" if velocity > 0.0 else "minus"
    for p in device.physics:
        if p.effect.name == "coulomb_friction":
            force += np.sign(velocity) * (p.values["level"] - lately.get("level", 0.0))
        elif p.effect.name == "constant_force":
            force -= p.values["level"]
        elif p.effect.name == "directional_friction":
            force += np.sign(velocity) * (
                p.values[f"level_{side}"] - lately.get(f"level_{side}", 0.0)
            )
            force += velocity * p.values[f"viscous_{side}"]
    return float(force)


@pytest.mark.truth
def test_silverbox_lacks_a_cubic_spring():
    """Published: k3/k1 = 3.99 1/V^2, and half a millivolt is left of 55.

    Mutations that break it: the command taken as held; no search over a longer horizon.
    """
    w = 2.0 * np.pi * 68.3
    chain = make_chain([1.0 / w**2], [2.0 * 0.0486 / w], 1.0)
    device = Device("Silverbox", "", False, chain, Interface(period=0.0016384))
    found = diagnose(device, [recording("silverbox", device, 15.0)], effort=QUICK)
    first = found.findings[0]
    assert (first.effect, first.at) == ("cubic_stiffness", "ground")
    ratio = first.parameters["coefficient"].value / found.device.chain.ground_spring
    assert ratio == pytest.approx(3.99, rel=0.02)
    assert found.free_run.after < 0.15 * found.free_run.refit


def test_the_sign_of_the_haptic_paddle_is_inverted():
    """Mutation that breaks it: correlation with the position instead of the velocity."""
    chain = make_chain([7e-4], [1e-3])
    device = Device("paddle", "", True, chain, Interface(period=0.005))
    e = recording("ethz_haptic_paddle", device, 80.0)
    assert [f.kind for f in examine(device, [e]) if f.wrong] == ["command_sign"]
    turned = replace(e, command=-e.command)
    assert not [f for f in examine(device, [turned]) if f.wrong]


def test_the_friction_of_a_servo_motor_rises_with_speed():
    """It creeps under half of what brakes it in sliding: no two levels and dampers say that.

    By least squares of the torque less inertia over samples: 29.2 mN m, less 25.3 exp(-|v| / 0.11
    rad/s), 3.5 mN m more backwards. Mutation: the curve of Stribeck, which cannot rise.
    """
    device, recorded = by_its_page("lugre_motor", "LuGre_J_2")
    both = {"level_plus": 0.026, "level_minus": 0.031, "viscous_plus": 2e-4, "viscous_minus": 2e-4}
    by_direction = fitted(device, recorded, ("directional_friction", "m1", both))
    rising = fitted(
        device, recorded,
        ("rising_friction", "m1", {"level": 0.029, "static_level": 0.01, "velocity": 0.2}),
        ("constant_force", "m1", {"level": 0.003}),
    )  # fmt: skip
    assert believed(rising.cost, by_direction.cost)
    found, _ = (p.values for p in rising.model.effects_at(rising.x))
    assert found["level"] == pytest.approx(0.029, rel=0.1)
    assert found["static_level"] < 0.6 * found["level"]


@pytest.mark.truth
def test_the_friction_of_the_paddle_yields_before_it_slides():
    """Likelier than Coulomb friction by 25 sigma; a second that yields adds nothing a sample ahead.

    Published: stiction of 12.9 and 16.9 mN m, and no motion below 8. Mutations: bristles that do
    not bend (the cost of Coulomb friction); the price of three numbers left out.
    """
    device, recorded = by_its_page("ethz_haptic_paddle", "position_time_sinusoid")
    turned = [replace(e, command=-e.command) for e in recorded]  # its sign is inverted
    weight = ("gravity_pendulum", "m1", {"level": 0.05, "angle": 0.023})
    rubs = ("presliding_friction", "m1", {"level": 0.0114, "stiffness": 11.4})
    softer = ("hysteresis", "ground", {"stiffness": 0.1, "level": 0.003, "shape": 10.0})
    stiff = fitted(device, turned, ("coulomb_friction", "m1", {"level": 0.0105}), weight)
    bends = fitted(device, turned, rubs, weight)
    more = fitted(device, turned, rubs, weight, softer)
    assert against(bends, stiff).sigma > 15.0
    assert not believed(more.cost, bends.cost, against(more, bends).phi)
    level = bends.model.effects_at(bends.x)[0].values["level"]
    assert 0.008 < level < 0.0169


def by_its_page(name: str, stem: str) -> tuple[Device, list[Experiment]]:
    """Return the device and the recording of a machine by the files of its page."""
    page = Path(__file__).parents[1] / "docs" / "machines" / name
    if not (SHARED / name).is_dir():
        pytest.skip(f"{name} is not ours to distribute, and is not beside the project")
    device = load_device(page / "device.toml")
    return device, stretches(read_recording(page / f"{stem}.toml", SHARED / name), device, name)


def fitted(
    device: Device, recorded: list[Experiment], *laws: tuple[str, str, dict[str, float]]
) -> Hypothesis:
    """Return the device with laws begun at values, fitted to recordings."""
    model = Model(device)
    for law, at, values in laws:
        model = model.with_effect(make_physics(law, at, **values), values)
    return settled(judged(recorded, model, np.zeros(len(model.parameters))))
