"""The command line: what it says, its exit status, and that nothing it meets is a traceback."""

import errno
import importlib
import io
import json
import os
import shlex
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import click
import pytest
from click.testing import CliRunner

from zwidth import cli
from zwidth.console import Column, Console, wrapped
from zwidth.errors import Status
from zwidth.planning import plan as planning
from zwidth.sim.device_file import load_device

HEAVY = {"numpy", "scipy", "numba", "matplotlib", "rich", "mcap"}


def python(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a fresh interpreter, as a user's shell does."""
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | environment,
        timeout=300,
    )


def substitute(monkeypatch: pytest.MonkeyPatch, body: Callable[[], None]) -> None:
    """Let `body` be what ``zwidth devices`` does."""
    commands = {"zwidth.commands.devices": click.Command("devices", callback=body)}

    def load(module: str) -> SimpleNamespace:
        return SimpleNamespace(command=commands[module])

    monkeypatch.setattr(cli, "import_module", load)


def test_help_waits_for_no_heavy_import():
    """Help in under half a second follows from what it does not import; no clock in a test.

    Mutation: import a command module at the top of zwidth/cli.py.
    """
    code = (
        "import sys; from zwidth.cli import run; run(['--help']);"
        "print('\\n', *{name.partition('.')[0] for name in sys.modules})"
    )
    done = python("-c", code)
    assert done.returncode == 0, done.stderr
    assert not HEAVY & set(done.stdout.splitlines()[-1].split())
    assert all(name in done.stdout for name in cli.COMMANDS)


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_help_says_of_each_command_what_the_command_says(name: str):
    command = importlib.import_module(f"zwidth.commands.{name}").command
    assert command.name == name
    assert command.help.splitlines()[0] == cli.COMMANDS[name]


def test_every_command_file_is_a_command():
    files = Path(cli.__file__).with_name("commands").glob("[!_]*.py")
    assert {file.stem for file in files} == set(cli.COMMANDS)


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("device", "no such command 'device'; did you mean 'devices'?"),
        ("qwertz", "no such command 'qwertz'; see 'zwidth --help'"),
        ("devices --pasive", "no such option '--pasive'; did you mean '--passive'?"),
        ("devices --save x", "--passive and --out need a DEVICE; give its name or file; see"),
        ("devices phantom_1", "'phantom_1' is neither a file nor a shipped device; did you mean"),
        ("devices a b", "got unexpected extra argument (b); see 'zwidth devices --help'"),
    ],
)
def test_bad_input_is_one_sentence(line: str, sentence: str, capsys: pytest.CaptureFixture[str]):
    assert cli.run(line.split()) == Status.BAD_INPUT
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"error: {sentence}")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (ValueError("level is\n  -1."), 2, "level is -1"),
        (FileNotFoundError(errno.ENOENT, "No such file", "a.toml"), 2, "a.toml: No such file"),
        (PermissionError(errno.EACCES, "Permission denied", "a"), 1, "a: Permission denied"),
        (OSError(errno.ENOSPC, "No space left on device"), 1, "No space left on device"),
        (MemoryError(), 1, "out of memory; ask for fewer runs at once or shorter ones"),
        (KeyboardInterrupt(), 130, "interrupted; results finished before, if any, are kept"),
        (
            ZeroDivisionError("division"),
            1,
            "internal error, ZeroDivisionError: division"
            " (set ZWIDTH_DEBUG=1 to see where, and report it)",
        ),
    ],
)
def test_every_error_is_one_sentence_and_a_status(
    error: BaseException,
    status: int,
    sentence: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    def fails() -> None:
        raise error

    substitute(monkeypatch, fails)
    monkeypatch.delenv("ZWIDTH_DEBUG", raising=False)
    assert cli.run(["devices"]) == status
    assert capsys.readouterr().err.lstrip() == f"error: {sentence}\n"
    monkeypatch.setenv("ZWIDTH_DEBUG", "1")
    with pytest.raises((type(error), click.Abort)):
        cli.run(["devices"])


def test_warnings_are_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    def warns() -> None:
        warnings.showwarning(UserWarning("two\nlines"), UserWarning, "file", 1)

    substitute(monkeypatch, warns)
    assert cli.run(["devices"]) == Status.DONE
    assert capsys.readouterr().err == "warning: two lines\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_under_standard_output_is_one_sentence():
    """Mutation: leave out `_silence`, and the interpreter adds a complaint of its own."""
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "zwidth", "--help"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            env={key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"},
            timeout=300,
        )
    assert (done.returncode, done.stderr) == (1, "error: No space left on device\n")


def test_devices_are_listed(capsys: pytest.CaptureFixture[str]):
    assert cli.run(["devices", "--json", "-"]) == Status.DONE
    out, err = capsys.readouterr()
    assert {"device": "phantom_1_0", "name": "PHANToM 1.0, phi axis"} in json.loads(out)["devices"]
    assert "phantom_1_0" in err


def test_a_device_is_described(capsys: pytest.CaptureFixture[str]):
    assert cli.run(["devices", "phantom_1_0"]) == Status.DONE
    out, err = capsys.readouterr()
    assert err.startswith("warning: b1 (-0.0101 N m s/rad) is negative")
    assert err.count("\n") == 1
    for number in ("0.000197241", "217.201", "76.262", "86.998", "delay 2 ms"):
        assert number in out


def test_the_nearest_passive_chain_is_saved_as_a_device(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    saved = tmp_path / "new" / "passive.toml"
    json_file = tmp_path / "passive.json"
    line = ["devices", "phantom_1_0", "--passive", "--save", str(saved), "--json", str(json_file)]
    assert cli.run(line) == Status.DONE
    assert capsys.readouterr().err == ""
    chain = load_device(saved).chain
    assert min(chain.ground_dampers) >= 0.0
    result = json.loads(json_file.read_text())
    assert result["chain"]["masses"] == chain.masses.tolist()
    assert 0.0 < result["distance"] < 0.05
    assert result["warnings"] == []


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_help_shows_an_example_that_the_command_understands(name: str):
    """Mutation: an option of an example renamed; a command without one."""
    done = CliRunner().invoke(cli.zwidth, [name, "--help"], terminal_width=80)
    line = cli.EXAMPLES[name]
    assert f"Example:\n  {line}" in "\n".join(row[2:] for row in done.output.splitlines())
    program, word, *arguments = shlex.split(line)
    assert (program, word) == ("zwidth", name)
    command = cli.zwidth.get_command(click.Context(cli.zwidth), name)
    assert command is not None
    command.make_context(name, arguments)
    assert max(map(len, done.output.splitlines())) <= 80


CHAIN = ("plan", "simulate", "replay", "identify")  # each takes what the one before it wrote
QUICK = ("convert", "devices", "export", "effects", "conceal", "relay", "boundary")


@pytest.mark.parametrize("names", [CHAIN, *((name,) for name in QUICK)], ids="-".join)
def test_examples_of_the_help_run(names: tuple[str, ...], tmp_path: Path,
                                  monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """In an empty folder beside the sample; a plan there compares three effects.

    Mutations: `plan` without --noise; 4000 samples.
    """
    folder = tmp_path / "docs" / "sample"
    folder.mkdir(parents=True)
    sample = Path(__file__).parents[1] / "docs" / "sample" / "bench.csv"
    if not sample.is_file():
        pytest.skip("not a clone: the wheel has no documentation")
    (folder / sample.name).write_bytes(sample.read_bytes())
    monkeypatch.chdir(tmp_path)
    every = planning._typical
    monkeypatch.setattr(planning, "_typical", lambda *asked: every(*asked)[:3])
    for name in names:
        assert cli.run(shlex.split(cli.EXAMPLES[name])[1:]) == Status.DONE, name


class Terminal(io.StringIO):
    """A terminal of 40 columns, as far as is asked of one."""

    def isatty(self) -> bool:
        return True


def test_a_narrow_terminal_cuts_off_nothing(monkeypatch: pytest.MonkeyPatch):
    """Mutations: rich's ellipsis in the place of folding; the column of empty units kept."""
    monkeypatch.setenv("COLUMNS", "40")
    screen = Terminal()
    monkeypatch.setattr(sys, "stdout", screen)
    columns = [Column("signal", False), Column("unit", False), Column("least"), Column("most")]
    rows = [["torque_of_the_motor", "", "-0.00123456", "0.00123456"]]
    Console().table("", columns, rows)
    shown = screen.getvalue()
    assert "torque_of_the_motor" in shown
    assert "\u2026" not in shown
    assert "unit" not in shown


def test_a_table_that_does_not_fit_breaks_no_word(monkeypatch: pytest.MonkeyPatch):
    """Its rows stand one below the other. Mutation: rich folds "oscillates" into "osci llat es"."""
    monkeypatch.setenv("COLUMNS", "40")
    screen = Terminal()
    monkeypatch.setattr(sys, "stdout", screen)
    columns = [Column(f"condition {i}") for i in range(6)]
    Console().table("", columns, [["oscillates", "", *["diverging"] * 4]] * 2)
    shown = screen.getvalue()
    assert shown.count("oscillates") == 2
    assert shown.count("condition 5  diverging") == 2
    assert "condition 1" not in shown
    assert max(map(len, shown.split("\n"))) <= 40


def test_words_are_wrapped_on_a_terminal_and_nowhere_else(monkeypatch: pytest.MonkeyPatch):
    """Mutation: paths broken, or lines for programs."""
    monkeypatch.setenv("COLUMNS", "40")
    text = "it was written as runs/a-long-folder-of-mine/recording.toml and can be corrected there"
    lines = wrapped(text, Terminal()).split("\n")
    assert " ".join(lines) == text
    assert max(map(len, lines)) <= 41
    assert "runs/a-long-folder-of-mine/recording.toml" in "\n".join(lines)
    assert wrapped(text, io.StringIO()) == text
