"""What the first page shows is what the program says of the sample that it ships."""

import csv
import html
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sampled import SAMPLE, Sampled
from test_narrow_terminal import ESCAPES, WIDE, Terminal

from zwidth.api.given import trace_of
from zwidth.console import Console
from zwidth.diagnose_files import _say
from zwidth.diagnosis.answer.result import Diagnosis, Estimate, Verdict
from zwidth.diagnosis_report import Commands, assumptions, save_report
from zwidth.figures.diagnosis import force_error_figure
from zwidth.sim.chain import make_chain
from zwidth.sim.device_file import device_from_text
from zwidth.sim.readable import with_unit

ROOT = Path(__file__).parent.parent
MOST_BYTES = 3_000_000  # of a report, so that it can be sent by mail
AGAIN = Commands("zwidth diagnose bench.csv", "zwidth explore a --compare b", "runs/b.toml", "a")


def report(found: Diagnosis, folder: Path, commands: Commands = AGAIN) -> str:
    return save_report(found, ["bench.csv"], commands, folder / "r.html").read_text("utf-8")


def test_the_report_of_the_sample_is_one_small_file(sampled: Sampled, tmp_path: Path) -> None:
    """Mutations: a picture of every sample; anything that is fetched from elsewhere."""
    text = report(sampled.found, tmp_path)
    assert len(text.encode()) < MOST_BYTES
    assert "What failed" not in text
    links = re.findall(r'(?:src|srcset|href)="([^"]{1,40})', text)
    assert len(links) > 10
    assert all(link.startswith(("#", "data:image/svg+xml;base64,")) for link in links)


def test_the_report_says_each_thing_once(sampled: Sampled, tmp_path: Path) -> None:
    """Mutations: where the refit failed, beside effects that explain it; curves beside a picture
    of the same; a start that is said to be measured; two lengths of free runs without a word.
    """
    text = report(sampled.found, tmp_path)
    assert 'id="where"' not in text
    assert 'href="#where"' not in text
    assert sampled.found.located.sentence not in html.unescape(text)
    assert "from the state that it estimates itself at the beginning" in text
    assert "from the measured state" not in text
    assert "in free runs over 0.05 s, where the effect shows most clearly" in text
    assert "runs at the top of this report last 0.5 s" in text
    # On the screen the curves stand for the picture; in print, the picture for the curves.
    assert '<figure class="still">' in text
    assert ".live .still { display: none; }" in text
    assert re.search(r"@media print \{.*\.interactive[^}]*\{ display: none; \}", text, re.DOTALL)
    assert '<div class="interactive" hidden>' in text


def test_the_report_holds_the_improved_device(sampled: Sampled, tmp_path: Path) -> None:
    """Mutations: another device; a text that its escapes change; a device that was not written."""
    text = report(sampled.found, tmp_path)
    (shown,) = re.findall(r'<pre id="improved-text"[^>]*>(.*?)</pre>', text, re.DOTALL)
    assert device_from_text(html.unescape(shown)) == sampled.found.device
    assert text.count(AGAIN.explore) == 1
    none = report(sampled.found, tmp_path, replace(AGAIN, improved=""))
    assert "improved-text" not in none
    assert none.count(AGAIN.explore) == 1


def test_a_report_without_effects_says_where_the_error_lies(
    sampled: Sampled, tmp_path: Path
) -> None:
    """Mutations: the section left out of every report; a legend with effects that are not there."""
    none = replace(sampled.found, findings=(), verdict=Verdict.UNKNOWN_PHYSICS)
    text = report(none, tmp_path)
    assert '<h2 id="where">' in text
    assert '<a href="#where">' in text
    assert "with the found effects" not in text


def test_the_answer_on_the_first_page_is_the_programs(sampled: Sampled) -> None:
    """Mutation: a search in which a ripple of one turn stands for a pendulum."""
    found = sampled.found
    names = sorted(f"{f.effect} at {f.at}" for f in found.findings)
    assert names == ["gravity_pendulum at m1", "stribeck_friction at m1"]
    assert found.verdict.value == "identified"
    page = (ROOT / "README.md").read_text()
    assert all(value in page for value in ("gravity pendulum at the motor", "Stribeck friction at"))


def test_the_output_on_the_first_pages_is_what_the_command_prints(
    sampled: Sampled, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In README and tutorial, but for the last digits. Mutation: one column more in a table."""
    screen = Terminal()
    monkeypatch.setenv("COLUMNS", str(WIDE))
    monkeypatch.setattr(sys, "stdout", screen)
    _say(Console(), sampled.found, ())
    printed = ESCAPES.sub("", screen.getvalue()).splitlines()
    assert max(map(len, printed)) <= WIDE
    forms = [form(line) for line in printed]
    readme = (ROOT / "README.md").read_text("utf-8")
    tutorial = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
    answer = tutorial[tutorial.index("## 3.") : tutorial.index("## 5.")]
    (block,) = re.findall(r"```text\n(.*?)```", readme, re.DOTALL)
    indented = [line[4:] for line in answer.splitlines() if line.startswith("    ")]
    for shown in (block.splitlines(), indented):
        lines = [line for line in shown if line]
        assert len(lines) > 10
        assert [line for line in lines if form(line) not in forms] == []


def test_a_force_error_too_large_for_its_panel_is_left_out_and_said(sampled: Sampled) -> None:
    """The refit lacks 64 times as much. Mutation: all are drawn, and only slashes are seen."""
    force, lacks = force_error_figure(sampled.found.force_errors[0]).axes
    labels = [str(line.get_label()) for line in force.lines]
    assert [label.endswith(", not shown below") for label in labels] == [False, True, True, False]
    assert len(lacks.lines) == 2  # the found effects, and zero


def form(line: str) -> str:
    """A line with 0 for each number, and one space for several."""
    return re.sub(r"-?\d[\d.]*", "0", " ".join(line.split()))


def test_its_columns_as_arrays_are_the_recording_of_its_file(sampled: Sampled) -> None:
    """As Python may give them. Mutation: degrees of a dict of arrays taken for radians."""
    with SAMPLE.open() as file:
        rows = list(csv.DictReader(file))
    arrays = trace_of({name: np.array([float(row[name]) for row in rows]) for name in rows[0]})
    whole = trace_of(sampled.folder / "runs" / "bench.recording.toml")
    for name in ("command", "position_m1"):
        np.testing.assert_allclose(arrays[name], whole[name], rtol=1e-12)


def test_where_a_spring_rests_is_told_with_the_force_that_would_look_the_same(sampled: Sampled):
    """Of -0.3 rms motions on 0.5 N m/rad. Mutations: the offset in rms motions; q0 / k."""
    found, swing = sampled.found, sampled.found.experiments[0].swing
    chain = found.device.chain
    sprung = found.device.with_chain(make_chain(chain.masses, chain.ground_dampers, 0.5))
    rest = Estimate(-0.3, -0.31, -0.29, "rms motions")

    def told(rest: Estimate) -> list[str]:
        spring = Estimate(0.5, 0.4, 0.6, "N m/rad")
        refit = found.linear_refit | {"k0": (0.5, spring), "origin": (0.0, rest)}
        every = assumptions(replace(found, device=sprung, linear_refit=refit), AGAIN)
        return [line for line in every if "rest position" in line]

    (line,) = told(rest)
    assert with_unit(-0.3 * swing, "rad", 3) in line
    assert f"a constant force of {with_unit(-0.15 * swing, 'N m', 3)} would look the same" in line
    assert not told(replace(rest, upper=0.01))
