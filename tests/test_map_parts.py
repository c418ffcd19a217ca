"""A map is kept in parts: interrupted at any moment it ends the same, bit for bit."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from map_examples import COARSE, LEVELS, plane, same

from zwidth.stability import fate_map
from zwidth.stability.fate_map import FateMap, make_map, save_map
from zwidth.stability.plane import Axis

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fate_map, "CHUNK", 32)


@pytest.fixture(scope="module")
def whole() -> FateMap:
    """Return the map made at one go, in memory."""
    return make_map(plane(), COARSE, LEVELS)


def test_a_folder_changes_nothing_and_is_read_again(tmp_path: Path, whole: FateMap) -> None:
    """Mutation: parts read without a look at their points, after one of them was removed."""
    assert same(make_map(plane(), COARSE, LEVELS, tmp_path), whole)
    stamps = {p: p.stat().st_mtime_ns for p in tmp_path.glob("part-*")}
    assert len(stamps) > 1
    assert same(make_map(plane(), COARSE, LEVELS, tmp_path), whole)
    assert {p: p.stat().st_mtime_ns for p in tmp_path.glob("part-*")} == stamps


@pytest.mark.parametrize(
    "damage", ["missing", "empty", "cut", "flipped", "noise", "another part", "one value for all"]
)
def test_a_damaged_part_is_run_again(tmp_path: Path, whole: FateMap, damage: str) -> None:
    """Mutation: `zipfile.BadZipFile` left out of `UNREADABLE`, or shapes not looked at."""
    make_map(plane(), COARSE, LEVELS, tmp_path)
    part = sorted(tmp_path.glob("part-*.npz"))[1]
    content = bytearray(part.read_bytes())
    if damage == "missing":
        part.unlink()
    elif damage == "one value for all":
        with np.load(part) as whole_part:
            values = {name: values[:1] for name, values in whole_part.items()}
            np.savez(part, **values | {"points": whole_part["points"]})
    else:
        content[len(content) // 2] ^= 0x10
        part.write_bytes(
            {
                "empty": b"",
                "cut": bytes(content[: len(content) // 3]),
                "flipped": bytes(content),
                "noise": bytes(range(256)) * 20,
                "another part": sorted(tmp_path.glob("part-*.npz"))[0].read_bytes(),
            }[damage]
        )
    assert same(make_map(plane(), COARSE, LEVELS, tmp_path), whole)


def test_killed_at_any_moment_it_ends_the_same(tmp_path: Path, whole: FateMap) -> None:
    """kill -9 again and again, at moments that fall anywhere; at the end not one bit differs.

    No single mutation breaks it: parts are written whole, and damaged ones are run again.
    """
    code = (
        "import sys; from pathlib import Path; sys.path[:0] = ['.', 'tests'];"
        "import map_examples as t; from zwidth.stability import fate_map; fate_map.CHUNK = 16;"
        "print('ready', flush=True);"
        "fate_map.make_map(t.plane(), t.COARSE, t.LEVELS, Path(sys.argv[1]))"
    )
    for wait in (0.0, 0.02):
        child = subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, stdout=subprocess.PIPE
        )
        with child:
            assert child.stdout is not None
            child.stdout.readline()
            count = len(list(tmp_path.glob("part-*.npz")))
            while len(list(tmp_path.glob("part-*.npz"))) == count and child.poll() is None:
                time.sleep(0.005)
            time.sleep(wait)
            child.send_signal(signal.SIGKILL)
    left = list(tmp_path.glob("part-*.npz"))
    assert left, "nothing was kept"
    fate_map.CHUNK = 16
    finished = make_map(plane(), COARSE, LEVELS, tmp_path)
    assert same(finished, whole)
    files = [
        save_map(m, tmp_path / f"{n}.nc").read_bytes() for n, m in (("a", finished), ("b", whole))
    ]
    assert files[0] == files[1]


def test_threads_change_nothing(whole: FateMap) -> None:
    assert same(make_map(plane(), COARSE, LEVELS, workers=3), whole)


def test_parts_without_a_description_are_somebody_elses(tmp_path: Path) -> None:
    """Mutation: the description is written wherever there is none."""
    (tmp_path / "part-00000.npz").write_text("mine")
    with pytest.raises(ValueError, match=r"holds parts, but no plane\.json; choose another folder"):
        make_map(plane(), 3, 0, tmp_path)
    assert (tmp_path / "part-00000.npz").read_text() == "mine"


def test_a_folder_of_another_map_is_refused(tmp_path: Path) -> None:
    make_map(plane(), 3, 0, tmp_path)
    for other in (replace(plane(), one_sided=True), replace(plane(), x=Axis("B", 0.0, 0.1))):
        with pytest.raises(ValueError, match="holds a map of another plane; choose another folder"):
            make_map(other, 3, 0, tmp_path)
    with pytest.raises(ValueError, match="another plane"):
        make_map(plane(), 5, 0, tmp_path)


def test_a_folder_of_another_version_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_map(plane(), 3, 0, tmp_path)
    monkeypatch.setattr(fate_map, "cache_folder", lambda: Path("elsewhere"))
    with pytest.raises(ValueError, match="another version of the program"):
        make_map(plane(), 3, 0, tmp_path)


def test_a_damaged_description_is_refused(tmp_path: Path) -> None:
    (tmp_path / "plane.json").write_text("[1, 2", encoding="utf-8")
    with pytest.raises(ValueError, match=r"plane\.json is damaged; remove"):
        make_map(plane(), 3, 0, tmp_path)


@pytest.mark.skipif(os.name != "posix", reason="limits of a process are POSIX")
def test_a_full_disk_leaves_whole_parts(tmp_path: Path, whole: FateMap) -> None:
    """A file that may not grow stands for a full disk: one error, no half a part, and it resumes.

    Mutation: what was written of the draft left behind (`unlink` removed).
    """
    import resource

    make_map(plane(), COARSE, LEVELS, tmp_path)
    parts = sorted(tmp_path.glob("part-*.npz"))
    for part in parts[2:]:
        part.unlink()
    size, hard = 1000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        with pytest.raises(OSError, match=r"part-00002\.npz"):
            make_map(plane(), COARSE, LEVELS, tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    kept = [tmp_path / ".lock", *parts[:2], tmp_path / "plane.json"]
    assert sorted(tmp_path.glob("*")) == kept
    assert same(make_map(plane(), COARSE, LEVELS, tmp_path), whole)
