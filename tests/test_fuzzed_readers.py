"""Every reader answers damaged, cut and huge files with numbers or with one sentence.

A few seconds of what `tests/fuzz_readers.py` does for hours.
"""

from pathlib import Path

import fuzz_readers as fuzz
import numpy as np
import pytest

from zwidth.logs.open_source import open_source

DAMAGED = 15  # copies of each good file


@pytest.fixture(scope="module")
def kinds(tmp_path_factory: pytest.TempPathFactory) -> list[fuzz.Kind]:
    return fuzz.kinds(tmp_path_factory.mktemp("good"), "")


def findings(kind: fuzz.Kind, copies: list[bytes], folder: Path) -> list[str]:
    found = []
    for data in copies:
        path = folder / kind.file
        path.write_bytes(data)
        verdict, said = fuzz.answer(kind, path)
        if verdict == "finding":
            found.append(f"{kind.name}, {len(data)} bytes: {said}")
    return found


def test_the_good_files_are_read(kinds: list[fuzz.Kind], tmp_path: Path) -> None:
    """Mutation: a reader that refuses all."""
    for kind in kinds:
        path = tmp_path / kind.file
        path.write_bytes(kind.data)
        if kind.read is fuzz.look_and_draft:  # an array without names is read, and not guessed at
            assert open_source(path).signals, kind.name
        else:
            assert fuzz.answer(kind, path)[0] == "read", kind.name


def test_damaged_files(kinds: list[fuzz.Kind], tmp_path: Path) -> None:
    """Mutation: an exception of a library that a reader lets through."""
    found: list[str] = []
    for i, kind in enumerate(kinds):
        random = np.random.default_rng([7, i])
        others = [kinds[int(random.integers(len(kinds)))].data for _ in range(DAMAGED)]
        copies = [fuzz.damaged(random, kind.data, other) for other in others]
        found += findings(kind, copies, tmp_path)
    assert not found, found[0]


def test_cut_files(kinds: list[fuzz.Kind], tmp_path: Path) -> None:
    """Empty, at the first bytes, and somewhere. Mutation: a reader that counts on an end."""
    found: list[str] = []
    for kind in kinds:
        size = len(kind.data)
        cuts = [0, 1, 7, size // 3, size - 1]
        found += findings(kind, [kind.data[:cut] for cut in cuts], tmp_path)
    assert not found, found[0]


def test_lengths_that_are_huge(kinds: list[fuzz.Kind], tmp_path: Path) -> None:
    """Where a length may stand, one of 2 to 16 EiB. Mutation: room made before it is checked."""
    found: list[str] = []
    for i, kind in enumerate(kinds):
        random = np.random.default_rng([11, i])
        copies = []
        for at in random.integers(0, max(1, len(kind.data) - 8), 3).tolist():
            for width in (4, 8):
                data = bytearray(kind.data)
                data[at : at + width] = b"\xff" * (width - 1) + b"\x7f"
                copies.append(bytes(data))
        found += findings(kind, copies, tmp_path)
    assert not found, found[0]
