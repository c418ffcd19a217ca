"""Nothing a user made is written over: the rule itself, and the functions of Python."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from log_examples import example

from zwidth.controllers.wall import wall
from zwidth.files import protection
from zwidth.files.protection import RECORDS, Protected, check, command, reading
from zwidth.files.whole import write_text
from zwidth.logs.mcap_writer import write_log
from zwidth.scenarios.logged_run import logged_run
from zwidth.scenarios.scenario import Scenario
from zwidth.sim.device_file import load_device, save_device
from zwidth.stability.fate_map import make_map, save_map
from zwidth.stability.judging import Trial
from zwidth.stability.plane import Axis, Plane

PHANTOM = load_device("phantom_1_0")
MINE = "mine\n"


def written(file: Path, text: str, by: str = "zwidth one", force: bool = False) -> None:
    """Let a command write a file, as the command line does."""
    with command(by):
        if force:
            protection.force()
        check(file)
        write_text(file, text)


def test_an_earlier_result_of_the_same_command_is_replaced(tmp_path: Path):
    """Mutation: the record of what is written left out."""
    for text in ("first", "second", "third"):
        written(tmp_path / "x", text)
        assert (tmp_path / "x").read_text() == text


@pytest.mark.parametrize(
    ("by", "edit", "words"),
    [
        ("zwidth one", "mine", "was edited since 'zwidth one' wrote it; give another name, move"),
        (
            "zwidth two",
            None,
            "was not written by 'zwidth two'; give another name, move it away, or",
        ),
    ],
)
def test_what_was_edited_and_what_another_command_wrote_stays(
    tmp_path: Path, by: str, edit: str | None, words: str
):
    """Mutations: the sum not looked at; the writer's name not looked at."""
    file = tmp_path / "x"
    written(file, "result")
    if edit is not None:
        file.write_text(edit)
    with pytest.raises(Protected, match=f"^{file} {words}"):
        written(file, "new", by)
    assert file.read_text() == (edit or "result")
    written(file, "new", by, force=True)
    assert file.read_text() == "new"


@pytest.mark.parametrize("record", ["", "null", "[]", '{"by": "zwidth one"}', '{"sha256": 3}'])
def test_without_a_record_that_can_be_read_a_file_is_the_users(tmp_path: Path, record: str):
    """Mutation: KeyError or TypeError let through."""
    written(tmp_path / "x", "result")
    (tmp_path / RECORDS / "x.json").write_text(record)
    with pytest.raises(Protected, match="was not written by 'zwidth one'"):
        written(tmp_path / "x", "new")


def test_an_empty_file_holds_nothing_to_protect(tmp_path: Path):
    """But an empty input stays. Mutations: sizes not looked at; looked at before the inputs."""
    file = tmp_path / "x"
    file.touch()
    written(file, "result")
    assert file.read_text() == "result"
    written(file, "another")
    assert file.read_text() == "another"
    (tmp_path / "input").touch()
    with pytest.raises(Protected, match="input is an input"), command("zwidth one"):
        check(reading(tmp_path / "input"))
    file.write_text("\n")
    with pytest.raises(Protected, match="was edited since"):
        written(file, "new")


def test_a_file_that_force_has_replaced_is_protected_when_it_is_back(tmp_path: Path):
    """Mutation: whatever is replaced counts as an earlier result."""
    file = tmp_path / "x"
    file.write_text(MINE)
    written(file, "result", force=True)
    file.write_text(MINE)
    with pytest.raises(Protected, match="was edited since"):
        written(file, "new")


def test_a_result_is_known_whenever_the_program_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Killed after the record is written and before the result takes its place.

    Mutation: the record holds the sum of the new result alone.
    """
    file, put = tmp_path / "x", Path.replace
    written(file, "first")

    def killed(self: Path, target: Path) -> Path:
        if target == file:
            raise KeyboardInterrupt
        return put(self, target)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            written(file, "second")
    assert file.read_text() == "first"
    written(file, "third")
    assert file.read_text() == "third"


def test_a_record_that_cannot_be_written_loses_no_result(tmp_path: Path):
    """Mutation: OSError of the record let through."""
    (tmp_path / RECORDS).write_text("a file in the way")
    written(tmp_path / "x", "result")
    assert (tmp_path / "x").read_text() == "result"
    with pytest.raises(Protected):
        written(tmp_path / "x", "new")


def spellings(file: Path) -> dict[str, Path]:
    """Return other names of a file, made beside it."""
    folder = file.parent
    (folder / "a").mkdir()
    (folder / "soft").symlink_to(file)
    (folder / "folder").symlink_to(folder, target_is_directory=True)
    os.link(file, folder / "hard")
    return {
        "symlink": folder / "soft",
        "folder": folder / "folder" / file.name,
        "hard link": folder / "hard",
        "detour": folder / "." / "a" / ".." / file.name,
        "relative": Path(os.path.relpath(file)),
    }


@pytest.mark.parametrize("name", ["symlink", "folder", "hard link", "detour", "relative"])
def test_an_input_is_the_same_file_by_every_name(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
):
    """Mutation: paths compared in place of device and inode (the hard link is replaced)."""
    file = tmp_path / "x"
    file.write_text(MINE)
    other = spellings(file)[name]
    for read, write in ((file, other), (other, file)):
        with command("zwidth one"):
            protection.force()
            assert reading(read) == read
            with pytest.raises(Protected, match=f"^{write} is an input; give another file"):
                check(write)
    assert file.read_text() == MINE


def test_an_input_is_not_reached_by_way_of_a_folder_that_is_not_there(tmp_path: Path):
    """`gone/../x` cannot be read, but it is `x` that would be written once `gone` is made.

    Mutation: the path as it was given in place of `place` in `Writer.objection`.
    """
    file = tmp_path / "x"
    file.write_text(MINE)
    with command("zwidth one"):
        protection.force()
        reading(file)
        with pytest.raises(Protected, match="is an input; give another file"):
            check(tmp_path / "gone" / ".." / "x")
    assert file.read_text() == MINE


def test_a_refusal_when_the_work_is_done_loses_nothing(tmp_path: Path):
    """The user's file stays, the result stands beside it, other results are written.

    Mutation: `put` raises at once within a command, too.
    """
    x, y = tmp_path / "x.toml", tmp_path / "y.toml"

    def work() -> None:
        with command("zwidth one"):
            check(x, y)
            x.write_text(MINE)  # while the command was at work
            write_text(x, "result")
            write_text(y, "another")

    with pytest.raises(Protected, match=r"x\.toml was not written by .* is in x-2\.toml instead$"):
        work()
    assert [p.read_text() for p in (x, y)] == [MINE, "another"]
    assert (tmp_path / "x-2.toml").read_text() == "result"


def test_a_late_refusal_is_said_beside_another_error(tmp_path: Path):
    """Mutation: the sentences forgotten when the command fails."""

    def work() -> None:
        with command("zwidth one"):
            (tmp_path / "x").write_text(MINE)
            write_text(tmp_path / "x", "result")
            raise KeyboardInterrupt

    with pytest.warns(UserWarning, match="is in x-2"), pytest.raises(KeyboardInterrupt):
        work()


def test_two_results_of_one_name_are_refused(tmp_path: Path):
    """Mutation: paths compared as they are spelled."""
    (tmp_path / "a").mkdir()
    with pytest.raises(Protected, match="would be written twice"):
        check(tmp_path / "x", tmp_path / "y", tmp_path / "a" / ".." / "x")
    check(Path(os.devnull), Path(os.devnull))


def test_what_is_no_plain_file_is_not_protected():
    """Mutation: `is_file` left out of `objection`."""
    with command("zwidth one"):
        reading(Path(os.devnull))
        check(Path(os.devnull))
        write_text(Path(os.devnull), "gone")


def _map(path: Path, **options: Any) -> None:
    trial = Trial(1e-3, 1.0, 1.0, 0.125)
    plane = Plane(PHANTOM, Axis("B", 0.0, 0.12), Axis("K", 1.0, 50.0), trial=trial)
    save_map(make_map(plane, 3, 0), path, **options)


def _run(path: Path, **options: Any) -> None:
    logged_run(Scenario(PHANTOM, wall(5.0, 0.01), 0.05), path, epoch_ns=0, **options)


FUNCTIONS: dict[str, Callable[..., None]] = {
    "save_device": lambda path, **options: save_device(PHANTOM, path, **options),
    "write_log": lambda path, **options: write_log(path, example(3), epoch_ns=0, **options),
    "logged_run": _run,
    "save_map": _map,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_write_over_their_own_results_and_others_when_told(name: str, tmp_path: Path):
    """Mutations: `overwrite` not handed on; the function's own name not used."""
    file, write = tmp_path / "x.mcap", FUNCTIONS[name]
    file.write_text(MINE)
    with pytest.raises(Protected, match=f"was not written by 'zwidth.{name}'.*overwrite=True"):
        write(file)
    assert file.read_text() == MINE
    write(file, overwrite=True)
    write(file)
    file.write_bytes(file.read_bytes() + b"\n")
    with pytest.raises(Protected, match=f"was edited since 'zwidth.{name}' wrote it"):
        write(file)
    assert json.loads((tmp_path / RECORDS / "x.mcap.json").read_text())["by"] == f"zwidth.{name}"


def test_a_device_that_was_loaded_is_not_saved_over_its_file(tmp_path: Path):
    """Mutation: an existing file refused only where it was not read."""
    file = tmp_path / "mine.toml"
    save_device(PHANTOM, tmp_path / "first.toml")
    file.write_bytes((tmp_path / "first.toml").read_bytes())
    with pytest.raises(Protected):
        save_device(load_device(file).rigid(), file)
    assert load_device(file) == PHANTOM
