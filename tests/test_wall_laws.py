"""Passivity controllers, textures and damping regions: accounts, closed forms, theory."""

import math

import numpy as np
import pytest
from engine_examples import one_mass, phantom
from scipy.optimize import brentq
from scipy.special import j1

from zwidth.controllers.guarded import guarded
from zwidth.controllers.of_law import controller_of
from zwidth.controllers.region import region
from zwidth.controllers.texture import texture
from zwidth.controllers.wall import wall
from zwidth.sim.device import Device
from zwidth.sim.ensemble import walls
from zwidth.sim.growth import LIMIT_CYCLE
from zwidth.sim.law import Law
from zwidth.sim.run import Start, simulate
from zwidth.stability.bisection import Bracket, Trial, find_brackets, judge
from zwidth.stability.hand import Hand, with_hand
from zwidth.stability.linear import critical_stiffness, last_stable_damping
from zwidth.stability.passivity import passive_stiffness

T = 1e-3


def quick() -> Device:
    return one_mass(1e-3, 5e-3, delay=0.0)


def bracket(device: Device, damping: float, trial: Trial) -> Bracket:
    return find_brackets([device], [np.array([damping])], trial)[0][0]


@pytest.mark.parametrize("seconds", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("start", [Start(1e-3), Start(-1e-3, 0.2)])
def test_the_observer_has_the_account_of_the_ledger(seconds: float, start: Start) -> None:
    """E is what the wall held at the start less the work of its command, to 1e-12 of what moved.

    Mutations: y - y_{k-1} times this tick's push; the start's energy left out.
    """
    device, stiffness = phantom().with_interface(delay=0.0), 60.0
    law = guarded(stiffness, 0.01, 0.1, one_sided=isinstance(start.velocity, float) and False)
    run = simulate(device, law, duration=seconds, start=start, ledger=True)
    held = 0.5 * stiffness * 1e-6
    work = run.trace["work_wall"]
    assert run.memory.controller[1] == pytest.approx(
        held - run.ledger["wall"], abs=1e-12 * float(np.abs(work).max() + held)
    )


def test_a_guarded_wall_gives_no_more_than_it_holds() -> None:
    """Of an unstable wall, three times K_CR: plain it diverges, guarded it comes to rest.

    The wall's work never exceeds what it held by more than the last tick's prediction was wrong,
    5 %. Mutation: the controller's damping with the other sign.
    """
    device = quick()
    limit = critical_stiffness(device, 0.0).stiffness
    most = last_stable_damping(device)
    assert limit is not None
    assert most is not None
    plain = simulate(device, wall(3.0 * limit, 0.0), duration=2.0, start=Start(1e-3))
    law = guarded(3.0 * limit, 0.0, 0.5 * most)
    held = simulate(device, law, duration=2.0, start=Start(1e-3), ledger=True)
    assert np.abs(plain.trace["position_m1"][-100:]).max() > 1.0
    assert np.abs(held.trace["position_m1"][-100:]).max() < 1e-5
    assert held.trace["work_wall"].max() < 1.05 * 0.5 * 3.0 * limit * 1e-6


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_passivity_controller_gains_stiffness(share: float) -> None:
    """More than ten times K_CR without delay; the plain one is what linear theory says, 0.1 %.

    Mutation: `most` of 0 (1.0 times).
    """
    device = quick()
    limit = critical_stiffness(device, 0.0).stiffness
    most = last_stable_damping(device)
    assert limit is not None
    assert most is not None
    plain = bracket(device, 0.0, Trial(law=Law("guarded")))
    assert plain.stable == pytest.approx(limit, rel=1e-3)
    held = bracket(device, 0.0, Trial(law=Law("guarded", most_damping=share * most), limit_s=16.0))
    assert held.stable is not None
    assert held.stable > 10.0 * limit


def test_a_passive_wall_is_left_alone() -> None:
    """To the bit, with B = 2 K T: twice what a held spring gives is taken by its damper.

    Mutation: the controller acts at E + push v T < E.
    """
    device, stiffness = phantom().with_interface(delay=0.0), 5.0
    damping = 2.0 * stiffness * T
    runs = [
        simulate(device, law, duration=1.0, start=Start(1e-3))
        for law in (wall(stiffness, damping), guarded(stiffness, damping, 0.1))
    ]
    assert np.array_equal(runs[0].trace["position_m1"], runs[1].trace["position_m1"])


def test_a_small_motion_in_a_grating_is_one_on_a_spring_of_its_slope() -> None:
    """K_CR of the wall, 0.1 %: a start of a thousandth of the wavelength.

    Mutation: the grating not divided by its wave number.
    """
    limit = critical_stiffness(phantom(), 0.02).stiffness
    for share in (1.0, 0.4):
        found = bracket(phantom(), 0.02, Trial(start=1e-5, law=Law("texture", 1e-2, share)))
        assert found.stable == pytest.approx(limit, rel=1e-3)


@pytest.mark.parametrize("factor", [1.2, 1.5])
def test_above_its_slope_a_grating_oscillates_as_its_describing_function_says(
    factor: float,
) -> None:
    """Amplitude A with K 2 J1(k A)/(k A) = K_CR, within 5 %, at the ultimate frequency, 3 %.

    A sine's describing function over the first harmonic (A. Gelb, W. E. Vander Velde, Multiple-input
    describing functions, 1968). Mutation: J1 without its factor 2.
    """
    device, wavelength = phantom(), 1e-2
    point = critical_stiffness(device, 0.02)
    assert point.stiffness is not None
    growth = judge(
        device, walls(np.array([factor * point.stiffness]), 0.02, law=Law("texture", wavelength)),
        Trial(start=1e-4, limit_s=64.0),
    )  # fmt: skip
    assert growth.verdict[0] == LIMIT_CYCLE
    number = 2.0 * math.pi / wavelength
    phase = brentq(lambda x: 2.0 * j1(x) / x - 1.0 / factor, 1e-3, 3.0)
    assert growth.amplitude[0] == pytest.approx(phase / number, rel=0.05)
    assert growth.frequency[0] == pytest.approx(point.frequency_hz, rel=0.03)


def worst_hand(device: Device, damping: float, mass: float) -> tuple[Device, float]:
    """Return the device with the lossless hand of a mass that has the least K_CR, and that K."""
    hands = [Hand(mass, 0.0, k) for k in np.geomspace(1e-3, 10.0, 161) * mass * (math.pi / T) ** 2]
    held = [with_hand(device, hand, 1.0) for hand in (Hand(mass, 0.0, 0.0), *hands)]
    limits = [critical_stiffness(d, damping).stiffness or math.inf for d in held]
    least = int(np.argmin(limits))
    return held[least], limits[least]


@pytest.mark.parametrize("damping", [0.0, 1e-3, 2e-3, 4e-3])
def test_the_worst_lossless_hand_comes_down_to_the_passive_wall(damping: float) -> None:
    """b > K T/2 + B (Colgate and Schenkel): no hand is below it, the worst within 10 %, simulated.

    Mutation: the criterion with T in place of T/2.
    """
    b = 5e-3
    device = one_mass(1e-3, b, delay=0.0)
    bound = passive_stiffness(device, damping).stiffness
    assert bound == pytest.approx(2.0 * (b - damping) / T, rel=1e-6)
    held, least = worst_hand(device, damping, 0.05)
    assert bound <= least * (1.0 + 1e-9)
    assert least < 1.1 * bound
    found = bracket(held, damping, Trial(limit_s=256.0))
    assert found.stable is not None
    assert found.unstable is not None
    assert 0.999 * bound < found.stable < 1.1 * bound


def test_a_region_of_damping_alone_is_passive_below_the_devices_own() -> None:
    """B < b over all lossless hands, the worst within 10 %; alone the device bears far more.

    Mutation: the region's push with the sign of the spring only.
    """
    b = 5e-3
    device = one_mass(1e-3, b, delay=0.0)
    mass = 0.05
    hands = [Hand(mass, 0.0, k) for k in np.geomspace(1e-2, 4.0, 121) * mass * (math.pi / T) ** 2]
    limits = [last_stable_damping(with_hand(device, hand, 1.0)) or math.inf for hand in hands]
    least = min(limits)
    assert b <= least * (1.0 + 1e-9)
    assert least < 1.1 * b
    own = last_stable_damping(device)
    assert own is not None
    assert own > 100.0 * b
    held = with_hand(device, hands[int(np.argmin(limits))], 1.0)
    for share, grows in ((0.97, False), (1.03, True)):
        run = simulate(held, region(share * least), duration=40.0, start=Start(1e-3))
        x = np.abs(run.trace["position_m1"])
        assert (x[-1000:].max() > x[1000:2000].max()) == grows


def test_a_region_acts_inside_only_and_both_ways() -> None:
    """The command is -B v between its ends, zero outside. Mutation: pulling cut off."""
    device = one_mass(1e-3, 0.0, delay=0.0)
    run = simulate(device, region(2e-3, position=1e-3, width=2e-3), duration=0.4,
                   start=Start(0.0, 0.02))  # fmt: skip
    y, v, u = (run.trace[name] for name in ("encoder", "velocity_estimate", "command"))
    inside = (y > 1e-3) & (y < 3e-3)
    assert inside.any()
    assert (~inside).any()
    assert np.array_equal(u, np.where(inside, -2e-3 * v, 0.0))
    assert np.array_equal(run.trace["contact"] == 1.0, inside)


def test_a_texture_is_the_sum_that_it_is_said_to_be() -> None:
    """1e-12 of the force. Mutation: the share of the spring for that of the grating."""
    run = simulate(phantom(), texture(3.0, 2e-3, 0.01, 1e-4, 0.3), duration=0.2,
                   start=Start(2e-3))  # fmt: skip
    depth, number = run.trace["encoder"] - 1e-4, 2.0 * math.pi / 2e-3
    truth = -(
        3.0 * (0.7 * depth + 0.3 * np.sin(number * depth) / number)
        + 0.01 * run.trace["velocity_estimate"]
    )
    assert run.trace["command"] == pytest.approx(truth, abs=1e-12)


def test_what_a_law_does_not_take_is_said() -> None:
    for make, said in (
        (lambda: texture(1.0, 0.0), "wavelength is 0"),
        (lambda: texture(1.0, 1e-3, share=1.2), "share is 1.2"),
        (lambda: region(1.0, width=-1.0), "width is -1"),
        (lambda: guarded(1.0, 0.0, -1.0), "most_damping is -1"),
        (lambda: Law("texture"), "a texture needs one above 0"),
        (lambda: Law("textur"), "law.kind is 'textur'"),  # pyright: ignore[reportArgumentType]
    ):
        with pytest.raises(ValueError, match=said):
            make()
    assert controller_of(Law("region"), 1.0, 2.0).kind == "region"
