"""What is counted in amperes and counts, since no scale is known, is written in them."""

from dataclasses import replace
from pathlib import Path

import pytest
from recording_examples import recorded, wave

import zwidth
from zwidth.diagnosis.answer.own_units import _called  # pyright: ignore[reportPrivateUsage]
from zwidth.diagnosis.answer.result import Estimate, Finding
from zwidth.logs.recording import unscaled
from zwidth.sim.readable import as_counted, counted_in, interval, with_unit

TOML = """
    file = "a.csv"
    time = "t"
    rotary = true
    [input]
    signal = "u"
    unit = "{unit}"
    {scale}
    [[output]]
    signal = "x"
    unit = "{of_x}"
    {counts}
    quantity = "position"
    at = "m1"
    """


def test_units_of_si_as_they_are_counted() -> None:
    """Mutations: counts in a denominator as many; lengths within the unit of a torque replaced."""
    units = ["N m", "rad", "rad/s", "N m s/rad", "N m/rad", "kg m2", "N m s2/rad2", "N m/rad3", "s"]
    with counted_in("A", "counts"):
        assert [as_counted(unit) for unit in units] == [
            "A", "counts", "counts/s", "A s/count", "A/count", "A s2/count", "A s2/count2",
            "A/count3", "s",
        ]  # fmt: skip
    with counted_in("", "counts"):
        assert [as_counted(unit) for unit in units[:6]] == [
            "N m", "counts", "counts/s", "N m s/count", "N m/count", "N m s2/count",
        ]  # fmt: skip
    with counted_in("V", ""):
        assert [as_counted(unit) for unit in units[:6]] == [
            "V", "rad", "rad/s", "V s/rad", "V/rad", "V s2/rad",
        ]  # fmt: skip
    with counted_in("A", ""):
        linear = ["N", "m", "m/s", "N s/m", "kg"]
        assert [as_counted(unit) for unit in linear] == ["A", "m", "m/s", "A s/m", "A s2/m"]
    assert [as_counted(unit) for unit in units] == units


def test_numbers_take_prefixes_of_what_they_are_counted_in() -> None:
    """Mutation: prefixes for counts."""
    with counted_in("A", "counts"):
        assert with_unit(0.4, "N m") == "400 mA"
        assert with_unit(0.35, "rad") == "0.35 counts"
        assert interval(0.4, 0.39, 0.41, "N m") == "400 mA (390 to 410)"
        assert (with_unit(1.0, "rad"), with_unit(-1.0, "rad/s")) == ("1 count", "-1 count/s")
        assert with_unit(1.0, "N m") == "1 A"
    assert with_unit(0.4, "N m") == "400 mN m"


def test_units_that_are_written_already_are_left_as_they_are() -> None:
    """Mutation: a unit that is counted is taken for one of SI once more."""
    units = ["N m", "rad", "rad/s", "N m s/rad", "N m/rad", "kg m2", "N m s2/rad2", "s", "", "1/s"]
    for scales in (("A", "counts"), ("V", ""), ("", "counts")):
        with counted_in(*scales):
            once = [as_counted(unit) for unit in units]
            assert [as_counted(unit) for unit in once] == once


def test_the_parts_of_an_answer_are_called_by_what_is_counted() -> None:
    """Estimates wherever they stand. Mutations: those within a tuple or a dict left; values
    changed."""
    level = Estimate(0.4, 0.39, 0.41, "N m")
    finding = Finding("coulomb_friction", "m1", {"level": level}, 67.0, ())
    refit = {"b1": (1.0, Estimate(2.0, 1.0, 3.0, "N m s/rad"))}
    with counted_in("A", "counts"):
        (found,), told = _called((finding,)), _called(refit)
    assert found == replace(finding, parameters={"level": replace(level, unit="A")})
    assert told["b1"] == (1.0, Estimate(2.0, 1.0, 3.0, "A s/count"))
    assert _called((finding,)) == (finding,)


def test_from_python_an_answer_counts_in_what_the_recording_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mutation: the scales of the recordings not asked."""
    t, u, x = wave(400)
    rows = "\n".join(f"{a!r},{b!r},{c!r}" for a, b, c in zip(
        t.tolist(), u.tolist(), x.tolist(), strict=True))  # fmt: skip
    (tmp_path / "a.csv").write_text(f"t,current_A,angle_rad\n{rows}\n")
    said: list[str] = []
    monkeypatch.setattr("zwidth.diagnosis.diagnose.diagnose", lambda *_: said.append(
        as_counted("N m")))  # fmt: skip
    monkeypatch.setattr("zwidth.api.diagnose.in_own_units", lambda found: found)
    with pytest.warns(UserWarning, match="assumed"):
        zwidth.diagnose(tmp_path / "a.csv", "phantom_1_0")
    assert said == ["A"]


@pytest.mark.parametrize(
    ("unit", "scale", "of_x", "counts", "said"),
    [
        ("A", "scale = 1.0", "counts", "scale = 1.0", ("A", "counts")),
        ("mA", "scale = 1.0", "rad", "", ("A", "")),
        ("V", "scale = 1.0", "counts", "counts_per_rev = 4096", ("V", "")),
        ("A", "scale = 0.05", "rad", "", ("", "")),
        ("Nm", "", "deg", "", ("", "")),
    ],
)
def test_a_recording_says_which_of_its_scales_are_not_known(
    tmp_path: Path, unit: str, scale: str, of_x: str, counts: str, said: tuple[str, str]
) -> None:
    """Mutations: a scale that is given left out of account; counts of a turn."""
    t, u, x = wave(200)
    rows = "\n".join(f"{a!r},{b!r},{c!r}" for a, b, c in zip(
        t.tolist(), u.tolist(), x.tolist(), strict=True))  # fmt: skip
    toml = TOML.format(unit=unit, scale=scale, of_x=of_x, counts=counts)
    assert unscaled([recorded(tmp_path, toml, a_csv=f"t,u,x\n{rows}\n".encode())]) == said
