"""Drives by their data sheets: against the equations of the winding, integrated."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from zwidth.controllers.recorded import recorded
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.drive import Drive
from zwidth.sim.interface import Interface
from zwidth.sim.run import simulate

R, KT, GEAR, SUPPLY, INERTIA, DAMPER = 2.1, 0.02, 12.0, 9.0, 3e-3, 1e-3
AXIS = Device("axis", "", True, make_chain([INERTIA], [DAMPER]), Interface(period=0.001))
FILE = f"""
schema = 1
name = "axis"
rotary = true
[chain]
masses = [{INERTIA}]
ground_dampers = [{DAMPER}]
[drive]
"""


def from_file(drive: str) -> Device:
    return device_from_text(FILE + drive)


def speed_of(device: Device, command: np.ndarray) -> np.ndarray:
    seconds = command.size * device.interface.period
    return simulate(device, recorded(command), duration=seconds, substeps=4).trace["velocity_m1"]


def test_a_voltage_spins_the_axis_up_to_where_the_back_emf_holds_it() -> None:
    device = Drive("voltage", KT, R, gear=GEAR, supply_v=SUPPLY).on(AXIS)
    volts = np.full(4000, 6.0)
    back = GEAR**2 * KT**2 / R
    at_rest = GEAR * KT * 6.0 / R
    t = 0.001 * np.arange(4000)
    rate = (DAMPER + back) / INERTIA
    truth = at_rest / (DAMPER + back) * (1.0 - np.exp(-rate * t))
    np.testing.assert_allclose(speed_of(device, volts), truth, rtol=1e-9, atol=1e-9)


def test_a_supply_limits_the_voltage_and_so_the_speed() -> None:
    device = Drive("voltage", KT, R, gear=GEAR, supply_v=SUPPLY).on(AXIS)
    limited, whole = (speed_of(device, np.full(3000, u)) for u in (50.0, SUPPLY))
    np.testing.assert_allclose(limited, whole, rtol=1e-12)


def test_a_duty_is_a_voltage_of_the_supply() -> None:
    volts = Drive("voltage", KT, R, gear=GEAR, supply_v=SUPPLY).on(AXIS)
    duty = Drive("duty", KT, R, gear=GEAR, supply_v=SUPPLY).on(AXIS)
    share = np.sin(0.02 * np.arange(3000)) * 1.5  # clipped at one
    np.testing.assert_allclose(speed_of(duty, share), speed_of(volts, SUPPLY * share), rtol=1e-9)


def test_an_inductance_lags_as_the_winding_does() -> None:
    """The winding's own equation, whose lag is on the back-EMF as well: 2.4 % at L / R = 3 ms."""
    inductance = 3e-3 * R
    device = Drive("voltage", KT, R, gear=GEAR, inductance_h=inductance).on(AXIS)
    k = np.arange(2000)
    command = 3.0 * np.sin(2.0 * math.pi * 3.0 * 0.001 * k)

    def winding(t: float, y: np.ndarray) -> list[float]:
        u = command[min(int(t / 0.001 + 1e-9), command.size - 1)]
        return [
            (u - R * y[0] - KT * GEAR * y[1]) / inductance,
            (GEAR * KT * y[0] - DAMPER * y[1]) / INERTIA,
        ]

    truth = solve_ivp(winding, (0.0, 2.0), [0.0, 0.0], t_eval=0.001 * k, max_step=2.5e-4).y[1]
    error = speed_of(device, command) - truth
    assert np.sqrt(np.mean(error**2)) < 0.03 * np.sqrt(np.mean(truth**2))
    none = speed_of(Drive("voltage", KT, R, gear=GEAR).on(AXIS), command) - truth
    assert np.sqrt(np.mean(none**2)) > 1.9 * np.sqrt(np.mean(error**2))


def test_a_current_loop_is_a_gain_a_lag_and_a_limit() -> None:
    device = from_file('kind = "current"\nmotor_constant = 0.06\nbandwidth_hz = 100\nlimit_a = 3.0')
    assert device.interface.command_gain == 0.06
    assert device.interface.command_limit == pytest.approx(0.18)
    assert device.chain.ground_dampers[0] == DAMPER
    (lag,) = device.physics
    assert lag.values["time_constant"] == pytest.approx(1.0 / (2.0 * math.pi * 100.0))


def test_what_follows_from_a_drive_is_what_is_written() -> None:
    device = from_file(
        f'kind = "voltage"\nmotor_constant = {KT}\nresistance_ohm = {R}\ngear = {GEAR}'
    )
    assert device_from_text(device_to_text(device)) == device
    assert "drive" not in device_to_text(device)
    assert device == Drive("voltage", KT, R, gear=GEAR).on(AXIS)


@pytest.mark.parametrize(
    ("drive", "says"),
    [
        ('kind = "volt"', "drive.kind is 'volt'.*voltage"),
        ('kind = "voltage"\nmotor_constant = 0.1', "drive.resistance_ohm is missing"),
        (
            'kind = "voltage"\nmotor_constant = 0.1\nresistance_ohm = 0.0',
            "drive.resistance_ohm is 0; it must be a finite number above 0",
        ),
        ('kind = "current"\nmotor_constant = 0.1\nsupply_v = 3', "give both, or neither"),
        ('kind = "current"\nmotor_constant = 0.1\ninductance_h = 3', "unknown key 'drive.ind"),
        (
            'kind = "duty"\nmotor_constant = 0.1\nresistance_ohm = 1.0\nsupply_v = inf',
            "drive.supply_v is inf",
        ),
    ],
)
def test_what_a_drive_cannot_be_is_said(drive: str, says: str) -> None:
    with pytest.raises(DeviceError, match=says):
        from_file(drive)
