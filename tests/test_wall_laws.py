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
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.ensemble import walls
from zwidth.sim.growth import LIMIT_CYCLE
from zwidth.sim.interface import Interface
from zwidth.sim.law import Law
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate
from zwidth.stability.bisection import Bracket, find_brackets
from zwidth.stability.judging import Trial, judge
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
    law = guarded(stiffness, 0.01, 0.1)
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

    The describing function of a sine (A. Gelb, W. E. Vander Velde, Multiple-input describing
    functions, 1968). Mutation: J1 without its factor 2.
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


def ladder(modes: int, mass: float, b: float) -> Device:
    """A mass on the damper b with a lossless hand that hangs at it: a line of masses and springs.

    Its impedance is zero at pi/T, 3 pi/T .. and infinite between, as that of an elastic rod that is
    clamped at its far end and that a wave crosses in T/2. Sampled at T, all these resonances stand
    at half the rate, one for each alias. From the far end of Z = H prod(s2 + z_i2) / (s prod(s2 +
    p_i2)) by Cauer's continued fraction.
    """
    zeros = (np.arange(modes) + 0.5) ** 2  # in units of (2 pi / T)^2
    poles = np.arange(1, modes) ** 2.0
    top, bottom = np.atleast_1d(np.poly(-zeros)), np.atleast_1d(np.poly(-poles))
    masses, springs = [], []
    scale = (2.0 * math.pi / T) ** 2
    while True:
        masses.append(top[0] / bottom[0])
        top = (top - masses[-1] * np.append(bottom, 0.0))[1:]
        if bottom.size == 1:
            springs.append(top[0] / bottom[0])
            break
        springs.append(top[0] / bottom[0])
        bottom = (bottom - top / springs[-1])[1:]
    m, k = mass * np.array(masses), mass * scale * np.array(springs)
    chain = make_chain(m.tolist(), [b] + [0.0] * (modes - 1), 0.0, k[:-1].tolist(),
                       [0.0] * (modes - 1))  # fmt: skip
    device = Device("ladder", "-", True, chain, Interface(delay=0.0))
    return device.with_physics(make_physics("ground_spring", f"m{modes}", stiffness=k[-1]))


@pytest.mark.parametrize("damping", [0.0, 1e-3, 2e-3, 4e-3])
def test_the_worst_lossless_hand_comes_down_to_the_passive_wall(damping: float) -> None:
    """b > K T/2 + B (Colgate and Schenkel): the worst hand stands above it, by 10 % of b.

    A rod of so many resonances has 8/pi2 sum 1/(2 n + 1)2 of the aliases' sum, 95 % for four, and
    b over that in place of b. Mutation: the criterion with T in place of T/2.
    """
    b = 5e-3
    bound = passive_stiffness(one_mass(1e-3, b, delay=0.0), damping).stiffness
    assert bound is not None
    assert bound == pytest.approx(2.0 * (b - damping) / T, rel=1e-6)
    device = ladder(4, 1e-4, b)
    part = 8.0 / math.pi**2 * sum(1.0 / (2 * n + 1) ** 2 for n in range(4))
    limit = critical_stiffness(device, damping).stiffness
    assert limit is not None
    assert limit == pytest.approx(2.0 * (b / part - damping) / T, rel=0.02)
    found = bracket(device, damping, Trial(limit_s=64.0))
    assert found.stable is not None
    assert found.stable == pytest.approx(limit, rel=2e-3)
    assert bound < found.stable
    assert found.stable + 2.0 * damping / T < 1.1 * 2.0 * b / T  # of b, which the bound is on


def test_a_region_of_damping_alone_is_passive_below_the_devices_own() -> None:
    """B < b (Colgate and Schenkel at K = 0): the worst hand within 6 %, simulated; alone far more.

    Mutation: the region's push with the sign of the spring only.
    """
    b = 5e-3
    held = ladder(4, 1e-4, b)
    last = last_stable_damping(held)
    assert last is not None
    assert b < last < 1.06 * b
    own = last_stable_damping(one_mass(1e-3, b, delay=0.0))
    assert own is not None
    assert own > 100.0 * b
    for share, grows in ((0.99, False), (1.01, True)):
        run = simulate(held, region(share * last), duration=40.0, start=Start(1e-3))
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
