"""`zwidth map`: what it writes, what it refuses, and that it goes on where it was stopped."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from zwidth.cli import run

SMALL = ["--seconds", "0.5", "--coarse", "5", "--levels", "1"]


def test_it_writes_map_pictures_and_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sizes of oscillations in rad, in encoder steps and N m; the same again from what is kept."""
    import xarray

    arguments = ["map", "phantom_1_0", "--encoder-step", "1e-4", *SMALL, "--out", str(tmp_path)]
    assert run([*arguments, "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["axes"] == ["B", "K"]
    assert said["lattice"] == 81
    cycle = said["fates"]["felt"]
    assert cycle["encoder_steps"] == pytest.approx([a / 1e-4 for a in cycle["amplitude"]])
    assert [t["x"] for t in said["transitions"]] == pytest.approx(
        np.linspace(0.0, 0.1196, 9), rel=1e-3
    )
    with xarray.open_dataset(tmp_path / "map.nc", engine="scipy") as data:
        assert int(data["run"].sum()) == said["runs"]
    first = {name: (tmp_path / name).read_bytes() for name in ("map.nc", "map.png", "map.svg")}
    assert first["map.png"].startswith(b"\x89PNG")
    assert run([*arguments, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out) == said
    assert {name: (tmp_path / name).read_bytes() for name in ("map.nc", "map.png")} == {
        name: first[name] for name in ("map.nc", "map.png")
    }


@pytest.mark.parametrize(
    "axes",
    [
        ("K", "B"), ("delay", "K"), ("encoder_step", "K"), ("command_limit", "B"),
        ("amplitude", "encoder_step"), ("friction", "K"), ("encoder_step", "command_limit"),
    ],
)  # fmt: skip
def test_any_two_quantities_have_ranges_of_their_own(
    axes: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["map", "phantom_1_0", "--axes", *axes, "--seconds", "0.2", "--coarse", "3"]
    arguments += ["--levels", "0", "--substeps", "2", "--json", "-", "--out", str(tmp_path)]
    assert run(arguments) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["axes"] == list(axes)
    assert said["runs"] == 9


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--axes", "K", "Q"], "'Q' is not one of 'K', 'B'"),
        (["--axes", "K"], "is not one of"),
        (["--axes", "K", "K"], "both axes are K; choose two different"),
        (["--x-range", "0.1", "0.05"], "axis B goes from 0.1 to 0.05; give two finite numbers"),
        (["--y-range", "1", "1"], "axis K goes from 1 to 1"),
        (["--x-range", "nan", "1"], "nan is not allowed"),
        (["--x-range", "0", "inf"], "inf is not allowed"),
        (["--x-range", "-1", "1"], "-1 is not allowed; give 0 or more"),
        (["--y-range", "0", "10"], "axis K begins at 0; it must begin above 0"),
        (["--x-range", "0", "1", "--log", "B"], "axis B begins at 0; it must begin above 0"),
        (["--log", "delay"], "--log delay has no use while delay is not an axis"),
        (["--log", "Z"], "is not one of"),
        (["--stiffness", "3"], "--stiffness has no use while K is an axis"),
        (["--damping", "3"], "--damping has no use while B is an axis"),
        (["--axes", "delay", "K", "--delay-ms", "3"], "--delay-ms has no use while delay"),
        (["--axes", "amplitude", "K", "--start", "3"], "--start has no use while amplitude"),
        (["--axes", "friction", "K", "--friction", "0"], "--friction has no use while friction"),
        (["--axes", "delay", "amplitude", "--stiffness", "0"], "0 is not allowed"),
        (["--axes", "K", "delay", "--damping", "-1"], "-1 is not allowed"),
        (["--delay-ms", "-2"], "-2 is not allowed"),
        (["--delay-ms", "1e9"], "delay"),
        (["--encoder-step", "nan"], "nan is not allowed"),
        (["--command-limit", "0"], "give a number above 0"),
        (["--friction", "-1"], "-1 is not allowed"),
        (["--friction", "x"], "x is not allowed"),
        (["--start", "0"], "give a number above 0"),
        (["--seconds", "0"], "give a number above 0"),
        (["--seconds", "1e-3"], "too short to be judged; give at least 64 ticks"),
        (["--substeps", "0"], "1<=x<=1000"),
        (["--perceptible", "nan"], "nan is not allowed"),
        (["--coarse", "2"], "3<=x<=513"),
        (["--levels", "9"], "0<=x<=8"),
        (["--coarse", "513", "--levels", "8"], "at most 2049 are possible"),
        (["--out", __file__], "is a file"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every option: exit status 2, one line that names it, nothing written."""
    out = [] if "--out" in arguments else ["--out", str(tmp_path / "out")]
    assert run(["map", "phantom_1_0", *arguments, *out]) == 2
    error = capsys.readouterr().err.strip()
    assert says in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_unknown_devices_are_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["map", "fantom"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_another_map_in_the_folder_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["map", "phantom_1_0", *SMALL, "--out", str(tmp_path)]
    assert run(arguments) == 0
    capsys.readouterr()
    assert run([*arguments, "--perceptible", "0.02"]) == 2
    assert "holds a map of another plane; choose another folder" in capsys.readouterr().err


# The command, which waits after its first part for a word that never comes.
WAITING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs ignore it
from zwidth.cli import main
from zwidth.jobs.store import PartStore
write = PartStore.write
def written(self, number, arrays):
    write(self, number, arrays)
    print("a part is written", flush=True)
    sys.stdin.readline()
PartStore.write = written
sys.argv[0] = "zwidth"
main()
"""


@pytest.mark.parametrize("options", [["--felt-force", "1e-4"], ["--lever", "10"]])
def test_what_is_felt_is_asked_as_of_a_boundary(options: list[str], tmp_path: Path) -> None:
    """Dither under steps of 10 urad is not felt, unless a hand is as fine, or as far out.

    Mutation: the lever left out of the perception.
    """
    found = tmp_path / "map.json"
    asked = "--encoder-step 1e-5 --x-range 0.03 0.05 --y-range 8 12 --coarse 3 --levels 0"
    arguments = ["map", "phantom_1_0", *asked.split(), "--json", str(found)]
    shares: list[float] = []
    for more in ([], options):
        assert run([*arguments, *more, "--out", str(tmp_path / f"{len(more)}")]) == 0
        shares.append(json.loads(found.read_text())["fates"]["felt"]["share"])
    assert shares == [0.0, 1.0]


@pytest.mark.skipif(os.name != "posix", reason="signals as a shell sends them are POSIX")
def test_interrupted_it_keeps_its_parts_and_goes_on(tmp_path: Path) -> None:
    """Ctrl-C: status 130, one line, whole parts; then the rest, without the first parts again.

    The signal comes while the command stands behind its first part, however fast the machine is.
    Mutations: `KeyboardInterrupt` caught in `make_map`; parts read as if none were there.
    """
    arguments = ["map", "phantom_1_0", "--encoder-step", "1e-4"]
    arguments += ["--seconds", "0.5", "--coarse", "33", "--levels", "0", "--out", str(tmp_path)]
    with subprocess.Popen(
        [sys.executable, "-c", WAITING, *arguments], cwd=Path(__file__).parents[1], text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as child:  # fmt: skip
        assert child.stdout is not None
        written = (line == "a part is written\n" for line in child.stdout)
        assert any(written)  # not the first line where kernels are compiled first
        child.send_signal(signal.SIGINT)
        _, error = child.communicate(timeout=120)
    assert child.returncode == 130, error
    assert "results finished before, if any, are kept" in error
    assert "Traceback" not in error
    parts = tmp_path / "parts"
    kept = {p: p.stat().st_mtime_ns for p in parts.glob("part-*.npz")}
    assert len(kept) == 1
    assert not (tmp_path / "map.nc").exists()
    assert run(arguments) == 0
    now = {p: p.stat().st_mtime_ns for p in parts.glob("part-*.npz")}
    assert len(now) > 1
    assert kept.items() <= now.items()
