"""A report stays below 3 MB, whatever it shows."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sampled import Sampled

from zwidth.diagnosis.answer.events import Course, Event
from zwidth.diagnosis.answer.result import Diagnosis, Estimate
from zwidth.diagnosis_report import Commands, save_report
from zwidth.figures.events import STEPS, coarse

LARGEST = 3_000_000  # bytes
COMMANDS = Commands("zwidth diagnose bench.csv", "zwidth explore bench")
ONE = Estimate(1.0, 0.5, 1.5, "N m")


def course(ticks: int) -> Course:
    """A noisy push with one high reading."""
    t = np.linspace(0.0, 0.001 * ticks, ticks)
    force = np.sin(3.0 * t) + 0.1 * np.random.default_rng(0).standard_normal(ticks)
    force[ticks // 3] = -9.0
    return Course(t, force, force - 0.1, force + 0.1, np.cos(9.0 * t), "N m", "rad")


def touch(gained: float) -> Event:
    return Event(
        "touch", "m1", "bench.csv", 1.0, (0.9, 1.1), 2.0, (1.9, 2.1), ONE, ONE, ONE, None, None, (),
        gained, 2, course(3000),
    )  # fmt: skip


def written(found: Diagnosis, path: Path, drawn: dict[str, str] | None = None) -> str:
    return save_report(found, ["bench.csv"], COMMANDS, path, drawn=drawn).read_text("utf-8")


def test_the_report_of_the_sample_is_small(sampled: Sampled, tmp_path: Path):
    """Mutation: a picture of every sample, or each picture twice more."""
    (report,) = (sampled.folder / "runs").glob("*.diagnosis.html")
    assert report.stat().st_size < LARGEST / 3
    assert "left out" not in report.read_text("utf-8")


def test_a_report_of_many_events_keeps_the_pictures_of_the_largest(
    sampled: Sampled, tmp_path: Path
):
    """Mutations: the first events; no count of the others; a later report that shows fewer."""
    events = tuple(touch(float(gained)) for gained in range(40))
    found, drawn = replace(sampled.found, events=events), dict[str, str]()
    page = written(found, tmp_path / "r.html", drawn)
    assert LARGEST / 2 < (tmp_path / "r.html").stat().st_size < LARGEST
    shown = [i for i in range(1, 41) if drawn[f"event {i}"]]
    assert 5 <= len(shown) < 40
    assert shown == list(range(41 - len(shown), 41))
    assert page.count('alt="Force and motion over time around the event"') == len(shown)
    left = re.search(r"pictures of the smallest events \((\d+)\) are left out", page)
    assert left is not None
    assert int(left[1]) == 40 - len(shown)
    assert page.count("a touch") >= 40 or page.count("hand") >= 40  # each has its sentence
    assert written(found, tmp_path / "again.html", drawn) == page


def test_few_events_have_all_their_pictures(sampled: Sampled, tmp_path: Path):
    page = written(replace(sampled.found, events=(touch(1.0), touch(2.0))), tmp_path / "r.html")
    assert page.count('alt="Force and motion over time around the event"') == 2
    assert "are left out" not in page


@pytest.mark.parametrize("ticks", [50, STEPS, STEPS + 1, 20_000])
def test_the_course_in_a_picture_keeps_the_peak_and_the_band(ticks: int):
    """Mutations: every k-th sample; the mean of each step; a short course changed."""
    whole = course(ticks)
    drawn = coarse(whole)
    assert drawn.times.size <= STEPS
    assert drawn.force.min() == -9.0
    assert (drawn.lower.min(), drawn.upper.max()) == (whole.lower.min(), whole.upper.max())
    assert (drawn.lower <= drawn.force).all()
    assert (drawn.upper >= drawn.force).all()
    if ticks <= STEPS:
        assert np.array_equal(drawn.force, whole.force)
        assert np.array_equal(drawn.times, whole.times)
