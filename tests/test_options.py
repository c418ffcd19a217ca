"""Lists of numbers after one flag, and the sentence that refuses a wrong one."""

from importlib import import_module
from pathlib import Path

import click
import pytest

from zwidth import cli, options
from zwidth.errors import Status, explain
from zwidth.options import ManyNumbers, Quantities, Quantity, spread


@click.command(cls=ManyNumbers)
@click.argument("device")
@click.option("--delay-ms", cls=Quantities, type=Quantity("ms"))
@click.option("--damping", cls=Quantities, type=Quantity("N m s/rad"), rising=True)
@click.option("--seed", type=int, default=0)
def command(**values: object) -> dict[str, object]:
    """Return what was understood."""
    return values


def understood(line: str) -> dict[str, object]:
    return command.main(line.split(), standalone_mode=False)


@pytest.mark.parametrize(
    "line",
    [
        "phantom --delay-ms 2 4 8 --damping 0 0.03 --seed 1",
        "--delay-ms 2 4 8 phantom --damping 0 .03 --seed=1",
        "--damping 0 3e-2 --seed 1 --delay-ms 2 4 8 phantom",
        "--delay-ms=2 4 --delay-ms 8 --damping=0 +0.03 --seed 1 -- phantom",
    ],
)
def test_lists_stand_anywhere(line: str):
    assert understood(line) == {
        "device": "phantom",
        "delay_ms": (2.0, 4.0, 8.0),
        "damping": (0.0, 0.03),
        "seed": 1,
    }


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("d --delay-ms -1", "'--delay-ms': -1 is not allowed; give 0 or more [ms]"),
        ("d --delay-ms 2 nan", "'--delay-ms': nan is not allowed; give 0 or more [ms]"),
        ("d --delay-ms 2 inf", "'--delay-ms': inf is not allowed; give 0 or more [ms]"),
        ("d --delay-ms 2 4x", "'--delay-ms': 4x is not allowed; give 0 or more [ms]"),
        ("d --delay-ms 2,4", "'--delay-ms': 2,4 is not allowed; give 0 or more [ms]"),
        ("d --delay-ms 2 2", "'--delay-ms': 2 is given twice; give each number once"),
        ("d --damping 0.1 0", "'--damping': 0 follows 0.1; give the numbers in rising order"),
    ],
)
def test_wrong_numbers_are_refused_with_what_is_allowed(line: str, sentence: str):
    with pytest.raises(click.UsageError) as caught:
        understood(line)
    assert explain(caught.value) == (Status.BAD_INPUT, f"invalid value for {sentence}")


def test_a_flag_without_numbers_is_refused():
    with pytest.raises(click.UsageError, match="requires an argument"):
        understood("d --delay-ms")


def test_a_quantity_above_a_bound_excludes_it():
    with pytest.raises(click.BadParameter, match=r"0 is not allowed; give a number above 0 \[s\]"):
        Quantity("s", above=True).convert("0", None, None)
    assert Quantity("s").convert("0", None, None) == 0.0


def test_other_options_keep_their_words():
    assert spread(["--x", "1", "2", "--y", "3", "4"], {"--x"}) == [
        *("--x", "1", "--x", "2", "--y", "3", "4")
    ]


COMMANDS_WITH_OUT = [
    ["paper"],
    ["boundary", "phantom_1_0"],
    ["map", "phantom_1_0"],
    ["simulate", "wall.toml"],
    ["identify", "recording.toml"],
    ["relay", "phantom_1_0"],
    ["diagnose", "recording.toml", "--device", "phantom_1_0"],
]


@pytest.mark.parametrize("line", COMMANDS_WITH_OUT, ids=lambda line: line[0])
def test_a_folder_that_cannot_be_written_to_is_refused_before_anything_is_done(
    line: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Mutation: `--out` without its callback computes first, or blames the missing recording."""
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "out"
    assert cli.run([*line, "--out", str(out)]) == Status.BAD_INPUT
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"error: invalid value for '--out': {out} cannot be written to")
    assert said.err.count("\n") == 1


def test_every_command_that_writes_a_folder_asks_for_it_in_one_way():
    """Mutation: an `--out` of a command's own."""
    for name in cli.COMMANDS:
        command = import_module(f"zwidth.commands.{name}").command
        for option in command.params:
            if "--out" in option.opts and option.metavar == "DIR":  # of some it is a file
                assert option.callback is options._writable, name  # pyright: ignore[reportPrivateUsage]
