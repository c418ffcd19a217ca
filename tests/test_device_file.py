import math
import os
import stat
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zwidth.files.protection import RECORDS
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device, DeviceError, warnings_of
from zwidth.sim.device_file import (
    device_from_text,
    device_to_text,
    load_device,
    model_hash,
    save_device,
    shipped_devices,
)
from zwidth.sim.interface import Interface
from zwidth.sim.modal import ModalModel, Mode
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

PHANTOM = load_device("phantom_1_0")
TEXT = device_to_text(PHANTOM)
CHAIN_TEXT = """
name = "two masses"
rotary = false
[chain]
masses = [1.5, 2]
ground_dampers = [0.1, 0.0]
link_springs = [300.0]
link_dampers = [0.2]
"""


def friction(level: float = 0.02, at: str = "m1") -> Physics:
    return make_physics("coulomb_friction", at, level=level)


# The shipped device


def test_the_shipped_device_is_table_i() -> None:
    assert "phantom_1_0" in shipped_devices()
    assert PHANTOM.rotary
    assert PHANTOM.source == "Table I"
    assert PHANTOM.modal == ModalModel(
        1.168e-3, 0.00584, (Mode(479.166, 83, 417.612, 80), Mode(1159.31, 352, 546.626, 90))
    )
    assert PHANTOM.interface == Interface(period=0.001, delay=0.002)
    assert PHANTOM.physics == ()


def test_table_i_warns_of_its_negative_damper() -> None:
    (warning,) = warnings_of(PHANTOM)
    assert warning.startswith("b1 (-0.0101 N m s/rad) is negative: no passive chain fits exactly")
    assert "'zwidth devices DEVICE --passive'" in warning
    assert warnings_of(device_from_text(CHAIN_TEXT)) == []


def test_every_shipped_device_loads_and_reads_back() -> None:
    for name in shipped_devices():
        device = load_device(name)
        assert device_from_text(device_to_text(device)) == device


# Round trips

numbers = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(1e-300, 1e300)
entries = st.sampled_from(
    [
        friction(),
        friction(0.1 + 0.2, "m2"),
        make_physics("cubic_stiffness", "link12", coefficient=-1e5 / 3.0),
        make_physics("actuator_lag", "command", time_constant=1e-3 / 7.0),
    ]
)


@st.composite
def devices(draw: st.DrawFn) -> Device:
    n = draw(st.integers(2, 4))

    def several(values: st.SearchStrategy[float], size: int) -> list[float]:
        return draw(st.lists(values, min_size=size, max_size=size))

    return Device(
        draw(st.text(st.characters(codec="utf-8"), min_size=1).filter(str.strip)),
        draw(st.text(st.characters(codec="utf-8"))),
        draw(st.booleans()),
        make_chain(
            several(positive, n),
            several(numbers, n),
            draw(st.floats(0.0, 1e300)),
            several(positive, n - 1),
            several(numbers, n - 1),
        ),
        Interface(
            draw(positive),
            draw(st.floats(0.0, 1e300)),
            draw(st.floats(0.0, 1e300)),
            draw(st.floats(0.0, 1e300)),
            draw(positive | st.just(math.inf)),
            draw(positive | st.just(math.inf)),
            draw(st.sampled_from(["nearest", "floor"])),
        ),
        tuple(draw(st.lists(entries, unique_by=lambda p: (p.effect.name, p.at)))),
    )


@settings(derandomize=True, max_examples=60, deadline=None)
@given(devices())
def test_text_reads_back_to_the_bit(device: Device) -> None:
    """Broken by: writing numbers with 16 digits."""
    again = device_from_text(device_to_text(device))
    assert again == device
    for a, b in zip(again.chain, device.chain, strict=True):
        assert np.asarray(a).tobytes() == np.asarray(b).tobytes()
    assert device_to_text(again) == device_to_text(device)


def test_a_modal_device_reads_back_to_the_bit() -> None:
    model = ModalModel(1e-3 / 3.0, 0.1 + 0.2, (Mode(1e3 / 7.0, 1 / 3, 1e3 / 9.0, 2 / 3),))
    device = PHANTOM.with_modal(model)
    assert device_from_text(device_to_text(device)).modal == model
    assert device_from_text(device_to_text(device)) == device


def test_saving_and_loading(tmp_path: Path) -> None:
    device = PHANTOM.with_physics(friction()).with_interface(command_limit=0.8)
    path = tmp_path / "with friction.toml"
    save_device(device, path)
    assert load_device(path) == load_device(str(path)) == device
    assert set(os.listdir(tmp_path)) == {path.name, RECORDS}
    assert stat.S_IMODE(path.stat().st_mode) & 0o400


def test_a_failed_save_leaves_the_earlier_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Broken by: writing to the path itself."""
    path = tmp_path / "device.toml"
    save_device(PHANTOM, path)
    before = path.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(DeviceError, match=r"cannot be written: No space left"):
        save_device(PHANTOM.rigid(), path)
    assert path.read_bytes() == before
    assert set(os.listdir(tmp_path)) == {path.name, RECORDS}


def test_a_folder_is_made_where_it_can_be(tmp_path: Path) -> None:
    save_device(PHANTOM, tmp_path / "new" / "x.toml")
    assert load_device(tmp_path / "new" / "x.toml") == PHANTOM
    with pytest.raises(
        DeviceError, match=r"y\.toml' cannot be written: (Not a directory|File exists)"
    ):
        save_device(PHANTOM, tmp_path / "new" / "x.toml" / "y.toml")


def test_the_hash_is_of_the_content() -> None:
    other = PHANTOM.with_interface(delay=math.nextafter(0.002, 1.0))
    assert model_hash(PHANTOM) == model_hash(load_device("phantom_1_0"))
    assert model_hash(PHANTOM) != model_hash(other)
    assert model_hash(PHANTOM.with_interface(delay=0)) == model_hash(
        PHANTOM.with_interface(delay=0.0)
    )


# Reading


def test_a_linear_chain_with_defaults() -> None:
    device = device_from_text(CHAIN_TEXT)
    assert not device.rotary
    assert device.source == ""
    assert device.interface == Interface()
    assert device.chain.ground_spring == 0.0
    assert device.chain.masses.tolist() == [1.5, 2.0]


def test_a_linear_modal_device() -> None:
    text = 'name = "cart"\nrotary = false\n[modal]\nm_kg = 2\nb_ns_per_m = 0.5\n'
    device = device_from_text(text)
    assert device.modal == ModalModel(2.0, 0.5)
    assert "m_kg = 2.0" in device_to_text(device)


def test_effects_of_the_interface_are_merged_into_it() -> None:
    """Steps and limits replace, delays add."""
    text = TEXT + "".join(
        f'\n[[physics]]\neffect = "{effect}"\nat = "{at}"\n{parameter} = {value}\n'
        for effect, at, parameter, value in (
            ("loop_delay", "clock", "delay", 0.0005),
            ("encoder_step", "sensor", "step", 1e-5),
            ("command_step", "command", "step", 1e-3),
            ("saturation", "command", "limit", 0.5),
            ("coulomb_friction", "m1", "level", 0.02),
        )
    )
    device = device_from_text(text)
    assert device.interface == Interface(0.001, 0.002 + 0.0005, 1e-5, 1e-3, 0.5)
    assert device.physics == (friction(),)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("delay_s", "dealy_s", "unknown key 'interface.dealy_s'; did you mean 'delay_s'?"),
        ("m_kgm2", "m_kg", "unknown key 'modal.m_kg'; did you mean 'm_kgm2'?"),
        ("m_kgm2 = 0.001168", "m_kgm2 =", "this is not TOML: Invalid value (at line 7, column 9)"),
        ("0.001168", "nan", "modal.m_kgm2 is nan; it must be > 0"),
        ("0.001168", "0", "modal.m_kgm2 is 0; it must be > 0"),
        ("0.001168", '"a"', "modal.m_kgm2 is 'a'; it must be a number"),
        ("0.001168", "true", "modal.m_kgm2 is True; it must be a number"),
        ("0.001168", "1" + 400 * "0", "modal.m_kgm2 is too large"),
        ("1159.31", "inf", "modal.mode[1].omega_rad_s is inf; it must be > 0 and finite"),
        ("b_nms_per_rad = 0.00584\n", "", "modal.b_nms_per_rad is missing; add it"),
        ("[[modal.mode]]", "[modal.mode]", "this is not TOML"),
        ("[modal]", "[[modal]]", "modal is [{"),
        ("delay_s = 0.002", "delay_s = -0.002", "interface.delay_s is -0.002; it must be >= 0"),
        ('"nearest"', '"up"', "interface.encoder_rounding is up; it must be 'nearest'"),
        ("schema = 1", "schema = 2", "schema is 2; this version reads 1"),
        ("rotary = true", "rotary = 1", "rotary is 1; it must be true or false"),
        ("rotary = true\n", "", "rotary is missing; add it"),
        ("[interface]", "[chain]\n[interface]", "both [modal] and [chain] are in the file"),
        ('"PHANToM 1.0, phi axis"', '" "', "name is empty"),
    ],
)
def test_a_bad_file_says_what_to_change(old: str, new: str, sentence: str) -> None:
    assert old in TEXT
    with pytest.raises(DeviceError) as error:
        device_from_text(TEXT.replace(old, new), "my.toml")
    assert str(error.value).startswith(f"my.toml: {sentence}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("masses = [1.5, 2]", "masses = [0.0, 2]", "chain.masses contains 0; only values > 0"),
        ("masses = [1.5, 2]", "masses = [-1, 2]", "chain.masses contains -1; only values > 0"),
        ("masses = [1.5, 2]", "masses = [nan, 2]", "chain.masses contains nan; only finite"),
        ("masses = [1.5, 2]", "masses = 1", "chain.masses is 1; it must be a list of numbers"),
        ("masses = [1.5, 2]", 'masses = ["a"]', "chain.masses[0] is 'a'; it must be a number"),
        ("link_springs = [300.0]", "", "chain.link_springs has 0 entries; 2 masses need 1"),
        ("[chain]", "[chain]\nground_spring = -1", "chain.ground_spring is -1; it must be >= 0"),
        ("[chain]", "[chian]", "unknown key 'chian'; did you mean 'chain'?"),
    ],
)
def test_a_bad_chain_says_what_to_change(old: str, new: str, sentence: str) -> None:
    with pytest.raises(DeviceError) as error:
        device_from_text(CHAIN_TEXT.replace(old, new))
    assert str(error.value).startswith(f"device: {sentence}")


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "[1.5, 2]",
            "[1e300, 2]",
            "chain.masses contains 1e+300; the allowed range is 1e-18 to 1e+12",
        ),
        (
            "[1.5, 2]",
            "[1e-300, 2]",
            "chain.masses contains 1e-300; the allowed range is 1e-18 to 1e+12",
        ),
        ("[300.0]", "[1e20]", "chain.link_springs contains 1e+20; the allowed range is"),
        ("[0.2]", "[-1e20]", "chain.link_dampers contains -1e+20; the allowed range is 0 to 1e+12"),
        ("[chain]", "[interface]\nperiod_s = 1e-12\n[chain]", "interface.period_s is 1e-12; it"),
        ("[chain]", "[interface]\ncommand_gain = 1e30\n[chain]", "interface.command_gain is 1e+30"),
    ],
)
def test_a_size_that_cannot_be_simulated_is_refused(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    """A period of 1 ps filled the memory, and a mass of 1e300 kg became "infs or NaNs"."""
    path = tmp_path / "d.toml"
    path.write_text(CHAIN_TEXT.replace(old, new))
    with pytest.raises(DeviceError) as error:
        load_device(path)
    assert str(error.value).startswith(f"{path}: {sentence}")


@pytest.mark.parametrize(
    ("entry", "sentence"),
    [
        ('effect = "coulomb_fricton"', "physics[0].effect is 'coulomb_fricton'; did you mean"),
        ('effect = "coulomb_friction"\nat = "m7"\nlevel = 1', "physics[0]: coulomb_friction.at"),
        ('effect = "coulomb_friction"\nat = "m4"\nlevel = 1', "coulomb_friction@m4 has no place"),
        ('effect = "coulomb_friction"\nat = "m1"\nlevl = 1', "unknown key 'physics[0].levl'"),
        ('effect = "coulomb_friction"\nat = "m1"', "physics[0].level is missing; add it"),
        (
            'effect = "coulomb_friction"\nat = "m1"\nlevel = -1',
            "physics[0]: coulomb_friction.level",
        ),
        ('at = "m1"', "physics[0].effect is missing; add it"),
        ('effect = "coulomb_friction"\nat = "m3"\nlevel = 1', "coulomb_friction@m3 has no place"),
        (
            'effect = "cubic_stiffness"\nat = "link23"\ncoefficient = 1',
            "cubic_stiffness@link23 has",
        ),
    ],
)
def test_a_bad_effect_says_what_to_change(entry: str, sentence: str) -> None:
    with pytest.raises(DeviceError) as error:
        device_from_text(f"{CHAIN_TEXT}\n[[physics]]\n{entry}\n")
    assert str(error.value).startswith(f"device: {sentence}")


def test_an_effect_twice_at_one_place_is_refused() -> None:
    entry = '\n[[physics]]\neffect = "loop_delay"\nat = "clock"\ndelay = 0.001\n'
    with pytest.raises(DeviceError, match=r"physics\[1\] repeats loop_delay@clock"):
        device_from_text(CHAIN_TEXT + entry + entry)


def test_a_device_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="neither a file nor a shipped device; did you mean"):
        load_device("phantom_1_1")
    with pytest.raises(DeviceError, match="is a folder; give a device file in it"):
        load_device(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(DeviceError, match="cannot be read as text"):
        load_device(tmp_path / "binary.toml")
