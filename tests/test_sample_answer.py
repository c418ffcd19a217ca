"""What the first page shows is what the program says of the sample that it ships."""

import csv
from pathlib import Path

import numpy as np

from zwidth import diagnose

ROOT = Path(__file__).parent.parent


def test_the_answer_on_the_first_page_is_the_programs() -> None:
    """Mutation: a search in which a ripple of one turn stands for a pendulum."""
    with (ROOT / "docs" / "sample" / "bench.csv").open() as file:
        rows = list(csv.DictReader(file))
    found = diagnose({name: np.array([float(row[name]) for row in rows]) for name in rows[0]})
    names = sorted(f"{f.effect} at {f.at}" for f in found.findings)
    assert names == ["gravity_pendulum at m1", "stribeck_friction at m1"]
    assert found.verdict.value == "identified"
    page = (ROOT / "README.md").read_text()
    assert all(value in page for value in ("gravity pendulum at the motor", "Stribeck friction at"))
