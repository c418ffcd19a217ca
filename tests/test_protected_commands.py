"""No command writes over what a user made: every one of them, before it begins its work.

A command that is new has no entry in CASES, and fails here until it has one.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from zwidth import cli, console
from zwidth.controllers.excitation import noise
from zwidth.covariance import save_covariance
from zwidth.errors import Status
from zwidth.exam.conceal import conceal, orders
from zwidth.files.protection import RECORDS, command
from zwidth.files.whole import write_text
from zwidth.identification.output import position
from zwidth.jobs.executor import Local
from zwidth.scenarios.logged_run import logged_run
from zwidth.scenarios.scenario_file import load_scenario
from zwidth.sim.band import Band, OutputBand
from zwidth.sim.device_file import load_device, save_device

MINE = "mine\n"
DESCRIPTION = """file = "rec.csv"
period_s = 0.001
rotary = true
[input]
signal = "u"
[[output]]
signal = "q"
quantity = "position"
at = "m1"
"""
SCENARIO = """duration_s = 0.5
[device]
path = "dev.toml"
[controller]
kind = "wall"
stiffness = 5.0
damping = 0.01
[start]
position = 1e-3
"""
LAW = "def step(k, t, y, v, p, m):\n    return -y\n"


@dataclass(frozen=True)
class Case:
    """How a command is asked for results in the folder `o`.

    results: those whose names are known before the work; inputs: what it reads; work: what the
    command calls to begin it, in its own module where no other is named.
    """

    line: str
    results: tuple[str, ...]
    inputs: tuple[str, ...]
    work: str


NOTHING = "writes no file"
CASES: dict[str, Case | str] = {
    "paper": Case("--section fig_10 --out o", ("o/report.html",), (), "_computed"),
    "convert": Case("rec.toml o/x.csv", ("o/x.csv",), ("rec.toml", "rec.csv"), "_warnings"),
    "boundary": Case(
        "dev.toml --damping 0.01 --delay-ms 2 --tolerance 0.1 --limit-s 4 --out o",
        ("o/boundary.png", "o/boundary.svg", "o/top_2ms_stable.mcap", "o/top_2ms_unstable.mcap"),
        ("dev.toml",),
        "find_boundaries",
    ),
    "map": Case(
        "dev.toml --coarse 3 --levels 0 --seconds 1 --out o",
        ("o/map.nc", "o/map.png", "o/map.svg"),
        ("dev.toml",),
        "make_map",
    ),
    "sweep": Case(
        "dev.toml --values 20 80 --dampings 3 --rounds 0 --tolerance 0.1 --limit-s 4 --out o",
        ("o/best.toml", "o/sweep.png", "o/sweep.svg"),
        ("dev.toml",),
        "sweep",
    ),
    "explore": NOTHING,
    "mcp": NOTHING,
    "report": Case(
        "r.diagnosis.html --json o/x.json", ("o/x.json",), ("r.diagnosis.html",), "headline_of"
    ),
    "simulate": Case(
        "wall.toml --out o",
        ("o/wall.mcap", "o/wall.png"),
        ("wall.toml", "dev.toml"),
        "logged_run",
    ),
    "replay": Case("run.mcap --json o/x.json", ("o/x.json",), ("run.mcap",), "replay"),
    "diagnose": Case(
        "rec.toml --device dev.toml --out o",
        (
            *("o/rec.diagnosis.html", "o/rec.diagnosis.mcap", "o/rec.augmented.toml"),
            *("o/rec.next.toml", "o/rec.next.npy"),
        ),
        ("rec.toml", "rec.csv", "dev.toml"),
        "zwidth.diagnose_files.diagnose",
    ),
    "check": Case(
        "band.toml rec.toml --junit o/x.xml --json o/x.json",
        ("o/x.xml", "o/x.json"),
        ("band.toml", "rec.toml", "rec.csv"),
        "zwidth.checking.check",
    ),
    "watch": Case(
        "rec.toml --device dev.toml --json o/x.json --out o",
        ("o/x.json",),
        ("rec.toml", "rec.csv", "dev.toml"),
        "_followed",
    ),
    "plan": Case(
        "--device dev.toml --noise 1e-5 --seconds 2 --excitation wall.toml --out o",
        ("o/wall_plan.png", "o/wall_plan.svg", "o/wall.toml", "o/wall.npy"),
        ("dev.toml", "wall.toml"),
        "rehearse",
    ),
    "conceal": Case(
        "--count 1 --seconds 2 --json o/x.json --out o",
        (
            *("o/x.json", "o/recordings/r0001.csv"),
            *("o/recordings/r0001.toml", "o/recordings/r0001.device.toml"),
        ),
        (),
        "zwidth.exam.conceal.make",
    ),
    "exam": Case(
        "sealed --page o/page.md",
        (
            *("o/page.md", "o/page_confusion.png", "o/page_magnitude.svg", "sealed/exam.json"),
            *("sealed/exam.md", "sealed/exam_confusion.svg", "sealed/exam_magnitude.png"),
        ),
        tuple(
            f"sealed/{name}"
            for name in (
                *("recordings/r0001.csv", "recordings/r0001.toml", "recordings/r0001.device.toml"),
                "keys/r0001.json",
            )
        ),
        "executor",
    ),
    "identify": Case(
        "rec.toml --name my/rig --modes 2 --out o",
        ("o/my_rig.toml", "o/my_rig.covariance.json", "o/my_rig_bode.png", "o/my_rig_bode.svg"),
        ("rec.toml", "rec.csv"),
        "fit_response",
    ),
    "relay": Case(
        "dev.toml --delay-ms 8 --damping 0.08 --starts 0 --out o",
        ("o/relay.png", "o/relay.svg", "o/relay_boundary.png", "o/relay_boundary.svg"),
        ("dev.toml",),
        "relay_conditions",
    ),
    "effects": Case("coulomb_friction --json o/x.json", ("o/x.json",), (), "described"),
    "export": Case("dev.toml --to c --seconds 0.1 -o o/x.c", ("o/x.c",), ("dev.toml",), "exported"),
    "devices": Case("dev.toml --save o/x.toml", ("o/x.toml",), ("dev.toml",), "_chain_table"),
}
WRITING = [name for name in cli.COMMANDS if CASES.get(name) != NOTHING]
RESULTS = [
    (name, result)
    for name, case in CASES.items()
    if isinstance(case, Case)
    for result in case.results
]
INPUTS = [
    (name, file) for name, case in CASES.items() if isinstance(case, Case) for file in case.inputs
]
# Quick enough to be run to their end; `paper` knows the names of its pictures late.
KEPT = {"parts", "recordings", "keys"}  # folders that are taken up again
RUN = [name for name in WRITING if name not in ("paper", "diagnose", "watch", "exam")]


def case_of(name: str) -> Case:
    """Return the case of a command, which every one must have."""
    case = CASES.get(name)
    assert isinstance(case, Case), f"{name} has no case here: say what it writes"
    return case


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file of every kind that a command reads."""
    folder = tmp_path_factory.mktemp("inputs")
    device = load_device("phantom_1_0")
    save_device(device, folder / "dev.toml")
    assert device.modal is not None
    output = OutputBand("position_m1", 1.0, 1e-9, 1.0, 0.5)
    band = Band(0.4, 6, 1e-4, (output,), ("command_late",))  # as an exact response has it
    save_device(replace(device, band=band), folder / "band.toml")
    u = noise(duration=12.0)
    q = position(device.modal, 0.0, u, 0.001)
    np.savetxt(
        folder / "rec.csv", np.column_stack([u, q]), delimiter=",", header="u,q", comments=""
    )
    (folder / "rec.toml").write_text(DESCRIPTION)
    (folder / "wall.toml").write_text(SCENARIO)
    (folder / "r.diagnosis.html").write_text("<html><title>Friction is missing</title></html>")
    logged_run(load_scenario(folder / "wall.toml"), folder / "run.mcap", epoch_ns=0)
    conceal(folder / "sealed", orders(folder / "sealed", {"none": 1}, 0, 2.0), Local())
    shutil.rmtree(folder / RECORDS)  # now they are files like any other
    return folder


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the folder, which is the working folder."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[str]]:
    """Return what stops a command where its work begins, and the list of those that came so far."""

    def stop(name: str) -> list[str]:
        reached: list[str] = []

        def work(*_: object, **__: object) -> None:
            reached.append(name)
            raise KeyboardInterrupt

        module, _, function = case_of(name).work.rpartition(".")
        monkeypatch.setattr(f"{module or f'zwidth.commands.{name}'}.{function}", work)
        return reached

    return stop


def run(name: str, *more: str) -> int:
    return cli.run([name, *case_of(name).line.split(), *more])


def files(folder: Path) -> dict[Path, bytes]:
    """What stands in a folder, but for hidden files and folders."""
    found = (p for p in folder.rglob("*") if p.is_file())
    return {
        p: p.read_bytes()
        for p in found
        if not any(part.startswith(".") for part in p.relative_to(folder).parts)
    }


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_whatever_writes_has_a_case_and_can_be_forced(name: str):
    """Mutation: `force_option` left out of a command."""
    assert name in CASES, f"{name} is new: give it a case here"
    options = {
        word for p in import_module(f"zwidth.commands.{name}").command.params for word in p.opts
    }
    writes = bool(options & {"--out", "--json", "--save", "--page"})
    assert writes == (name in WRITING) == ("--force" in options)


@pytest.mark.parametrize(("name", "result"), RESULTS)
def test_a_file_of_the_users_stops_a_command_before_its_work(
    name: str,
    result: str,
    here: Path,
    begun: Callable[[str], list[str]],
    capsys: pytest.CaptureFixture[str],
):
    """Mutations: a name left out of `will_write`; no check at all where a result is written.

    With --force the work begins.
    """
    reached = begun(name)
    Path(result).parent.mkdir(parents=True, exist_ok=True)
    Path(result).write_text(MINE)
    before = files(here)
    assert run(name) == Status.BAD_INPUT
    said = capsys.readouterr().err.splitlines()[-1]
    assert f"{result} was not written by" in said
    assert said.endswith("move it away, or use --force")
    assert reached == []
    assert files(here) == before


@pytest.mark.parametrize("name", WRITING)
def test_force_and_earlier_results_let_a_command_begin(
    name: str, here: Path, begun: Callable[[str], list[str]]
):
    """Mutations: `--force` without effect; the record of another command taken, or of none."""
    reached = begun(name)
    for result in (results := case_of(name).results):
        Path(result).parent.mkdir(parents=True, exist_ok=True)
        Path(result).write_text(MINE)
    assert run(name, "--force") == Status.INTERRUPTED
    with command(f"zwidth {name}"):
        for result in results:
            Path(result).unlink()
            write_text(Path(result), "result")
    assert run(name) == Status.INTERRUPTED
    assert reached == [name, name]
    Path(results[0]).write_text("result, edited")
    assert run(name) == Status.BAD_INPUT


@pytest.mark.parametrize("how", ["itself", "symlink", "hard link"])
@pytest.mark.parametrize(("name", "file"), INPUTS)
def test_no_command_writes_over_its_inputs(
    name: str,
    file: str,
    how: str,
    here: Path,
    begun: Callable[[str], list[str]],
    capsys: pytest.CaptureFixture[str],
):
    """--force or not. Mutation: `reading` left out where a file of the kind is opened."""
    reached, target = begun(name), here / file
    if how == "symlink":
        (here / "link").symlink_to(target)
    elif how == "hard link":
        (here / "link").hardlink_to(target)
    target = target if how == "itself" else here / "link"
    before = files(here)
    assert run(name, "--json", str(target), "--force") == Status.BAD_INPUT
    said = capsys.readouterr().err.splitlines()[-1]
    why = "is what rec.toml describes" if file == "rec.csv" else "is an input"
    assert said == f"error: {target} {why}; give another file to write"
    assert reached == []
    assert files(here) == before


@pytest.mark.parametrize(
    ("name", "option", "file"),
    [
        ("boundary", "--covariance spread.json", "spread.json"),
        ("replay", "--controller law_of_mine:step", "law_of_mine.py"),
        ("diagnose", "--validate other.toml", "other.csv"),
    ],
)
def test_what_an_option_names_is_an_input_too(
    name: str, option: str, file: str, here: Path, capsys: pytest.CaptureFixture[str]
):
    """Mutation: `reading` left out for covariances, or for a control law of the user's own."""
    save_covariance(here / "spread.json", ["m"], np.eye(1))
    (here / "law_of_mine.py").write_text(LAW)
    shutil.copy("rec.csv", "other.csv")
    (here / "other.toml").write_text(DESCRIPTION.replace("rec.csv", "other.csv"))
    before = Path(file).read_bytes()
    assert run(name, *option.split(), "--json", file, "--force") == Status.BAD_INPUT
    assert capsys.readouterr().err.splitlines()[-1].endswith("; give another file to write")
    assert Path(file).read_bytes() == before


@pytest.mark.parametrize("name", RUN)
def test_what_is_written_was_named_before_and_a_rerun_replaces_it(
    name: str, here: Path, monkeypatch: pytest.MonkeyPatch
):
    """Mutations: a new result that is not in `will_write`, or does not go through `files`."""
    early: set[Path] = set()
    check = console.check

    def noted(*results: Path) -> None:
        early.update(path.resolve() for path in results)
        check(*results)

    monkeypatch.setattr(console, "check", noted)
    monkeypatch.setattr("zwidth.commands.plan.better_excitations", lambda _, found, *__: found)
    before = files(here)
    assert run(name) == Status.DONE
    new = files(here).keys() - before.keys()
    assert new
    assert {p for p in new if not KEPT & set(p.parts)} <= early
    assert run(name) == Status.DONE
    assert files(here).keys() - before.keys() == new
