"""Results are written whole or not at all."""

import math
from pathlib import Path

import pytest

from zwidth.errors import Status, explain
from zwidth.files.protection import RECORDS
from zwidth.files.whole import check_folder, json_text, replacing, write_text


def test_folders_are_made_and_no_draft_stays(tmp_path: Path):
    file = write_text(tmp_path / "a" / "b.txt", "one\n")
    write_text(file, "two µ\n")
    assert file.read_text(encoding="utf-8") == "two µ\n"
    assert {entry.name for entry in file.parent.iterdir()} == {"b.txt", RECORDS}
    assert [entry.name for entry in (file.parent / RECORDS).iterdir()] == ["b.txt.json"]


def test_what_stood_there_survives_an_error(tmp_path: Path):
    """Mutation: open the target itself instead of a draft."""
    file = write_text(tmp_path / "result", "old")
    with pytest.raises(KeyboardInterrupt), replacing(file) as stream:  # noqa: PT012
        stream.write(b"half of the new")
        raise KeyboardInterrupt
    assert file.read_text() == "old"
    assert {entry.name for entry in tmp_path.iterdir()} == {"result", RECORDS}


def test_a_link_stays_a_link(tmp_path: Path):
    """Mutation: leave out `resolve`, and the link becomes a file."""
    file = write_text(tmp_path / "file", "old")
    link = tmp_path / "link"
    link.symlink_to(file)
    write_text(link, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_is_the_machines_failure():
    with pytest.raises(OSError, match="No space") as caught:
        write_text(Path("/dev/full"), "text")
    assert explain(caught.value) == (
        Status.FAILED,
        "/dev/full: No space left on device; what is finished is kept, make room and give the same"
        " command again",
    )


def test_a_folder_in_the_way_is_bad_input(tmp_path: Path):
    (tmp_path / "file").touch()
    for path in (tmp_path, tmp_path / "file" / "result"):
        with pytest.raises(OSError) as caught:  # noqa: PT011
            write_text(path, "text")
        status, sentence = explain(caught.value)
        assert status == Status.BAD_INPUT
        assert sentence.startswith(str(path))


def test_json_has_no_nan():
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_text({"x": math.nan})


def test_a_folder_that_can_be_written_to_is_left_as_it_was(tmp_path: Path):
    """Mutation: the folders that the trial made are not removed."""
    check_folder(tmp_path / "a" / "b")
    check_folder(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_an_error_and_leaves_nothing(tmp_path: Path):
    """Mutation: permissions asked (os.access) instead of tried."""
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError):
        check_folder(tmp_path / "file" / "out")
    if Path("/proc/self").exists():
        with pytest.raises(OSError, match="/proc/zwidth"):
            check_folder(Path("/proc/zwidth"))
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
