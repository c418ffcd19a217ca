"""Curves of a report: their numbers, what a browser makes of them, and how a report is found."""

import base64
import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes

from zwidth import cli
from zwidth.diagnosis.answer.result import Residuals
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.figures.diagnosis import residual_figure, run_lines, whole_run_figure
from zwidth.figures.narrow import WIDTH, narrow_bytes
from zwidth.figures.style import HELD_OUT
from zwidth.report_curves import MOST, curves_of, program

LINES = {
    "before": ("device file", "0.6", ":"),  # a grey of matplotlib
    "after": ('with </script> & "what" was found', "#004488", "-"),
}
N = 4000
T = 0.001 * np.arange(N)
MEASURED = 3e-3 * np.sin(5.0 * T)


def run(ticks: int = N) -> WholeRun:
    measured = np.resize(MEASURED, ticks)
    runaway = np.where(np.arange(ticks) < 3000, 2.0 * measured, np.inf)
    simulated = {"before": runaway, "after": measured + 1e-9, "other": measured}
    return WholeRun("bench", "position_m1", "rad", 2.0, 0.001, measured, simulated, True)


def quick() -> WholeRun:
    """A motion of too many swings for the width of a page."""
    motion = 1e-3 * np.sin(300.0 * T)
    simulated = dict.fromkeys(("before", "refit", "after"), motion)
    return replace(run(), measured=motion, simulated=simulated)


TINT = [int(HELD_OUT[i : i + 2], 16) for i in (1, 3, 5)]
NOISE = np.random.default_rng(1).normal(size=(3000, 1))
WHITE = Residuals(0.001, NOISE, NOISE)


def numbers(text: str) -> Any:
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_curves_are_the_run_in_a_unit_that_fits():
    """Mutations: the simulated run for its error, which a 32-bit float does not hold; radians."""
    (curve,) = curves_of([run()], LINES)
    assert (curve["unit"], curve["begins"], curve["period"]) == ("mrad", 2.0, 0.001)
    assert numbers(curve["measured"]) == pytest.approx(1e3 * MEASURED, abs=1e-6)
    before, after = curve["runs"]
    assert before["colour"] == "#999999"
    assert after["rms"].startswith("error 1 nrad rms")
    assert before["rms"] == "runs away"
    assert numbers(after["error"]) == pytest.approx(np.full(N, 1e-6), rel=1e-3)
    assert np.isinf(numbers(before["error"])[3000:]).all()
    assert curve["under"]["width"] > 3.0 * 1.5  # of the lines that lie on it


def test_a_run_that_was_not_fitted_is_tinted_and_says_so():
    """As in the picture. Mutations: every run tinted; a tint without a word."""
    held, fitted = curves_of([run(), replace(run(), held_out=False)], LINES)
    assert held["ground"]["colour"] == HELD_OUT
    assert held["name"].endswith(", kept out of the fit (tinted)")
    assert fitted["ground"] is None
    assert fitted["name"].endswith(", part of the fit")


def test_curves_are_seen_on_a_dark_ground():
    """Against the dark paper of a report. Mutation: the colours of the light one."""
    (curve,) = curves_of([run()], run_lines(True, run()))
    for line in curve["runs"]:
        assert contrast(line["dark"], "#17191c") > 5.0
        assert line["label"] == "device file" or line["dark"] != line["colour"]
        assert contrast(line["dark"], curve["ground"]["dark"]) > 4.5
    assert contrast(curve["under"]["dark"], curve["ground"]["dark"]) > 3.0


def contrast(one: str, other: str) -> float:
    """The ratio of the luminances of two colours, as WCAG defines it."""
    lights: list[float] = []
    for colour in (one, other):
        c = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
        linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
        lights.append(float(linear @ [0.2126, 0.7152, 0.0722]))
    return (max(lights) + 0.05) / (min(lights) + 0.05)


def test_long_runs_stay_below_three_megabytes():
    """Mutation: every sample whatever the length."""
    curves = curves_of([run(500_000), run(500_000)], LINES)
    assert sum(numbers(c["measured"]).size for c in curves) * 3 <= MOST
    assert curves[0]["period"] == pytest.approx(0.001 * 25)
    assert curves[0]["name"].endswith("one of 25 samples")
    assert len(json.dumps(curves)) + sum(map(len, program().values())) < 0.9e6


def test_labels_of_two_columns_do_not_meet():
    """'8.0' of the whole run and '6.750' of its close look. Mutation: ticks up to the edges."""
    for begins in np.linspace(4.81, 4.85, 11).tolist():
        figure = whole_run_figure(replace(quick(), begins=begins))
        figure.canvas.draw()
        whole, close = figure.axes[2:]  # the panels below, which hold the labels of time
        assert seen(close)
        assert max(box.x1 for box in seen(whole)) + 2.0 < min(box.x0 for box in seen(close))


def seen(axes: Axes) -> list[Any]:
    """Where the labels of time stand that lie in a panel."""
    low, high = axes.get_xlim()
    ticks = zip(axes.get_xticklabels(), axes.get_xticks(), strict=True)
    return [label.get_window_extent() for label, at in ticks if low <= at <= high]


def test_a_residual_without_findings_has_no_line_for_them():
    """Mutation: a legend with the found effects although there are none."""
    for named, count in ((True, 3), (False, 2)):
        (legend,) = residual_figure(WHITE, named).legends
        labels = [text.get_text() for text in legend.get_texts()]
        assert len(labels) == count
        assert any("effects" in label for label in labels) == named


def test_a_picture_for_a_phone_has_its_panels_under_one_another():
    """Mutations: the wide picture made small; a legend beside its axes that is cut off."""
    figure = whole_run_figure(quick())
    svg = narrow_bytes(figure).decode()
    wide = float(re.findall(r'width="([\d.]+)pt"', svg)[0])
    assert wide == pytest.approx(72.0 * WIDTH)
    both = residual_figure(WHITE)
    narrow_bytes(both)
    above, below = (axes.get_position() for axes in both.axes)
    assert above.y0 > below.y1
    assert above.x0 == pytest.approx(below.x0)


def test_a_browser_draws_and_zooms_them(tmp_path: Path):
    """Mutations: a script that fails; curves that are not zoomed together; a name not escaped."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    path = os.environ.get("ZWIDTH_CHROMIUM") or shutil.which("chromium")
    if path is None:
        pytest.skip("no Chromium here: apt-get install chromium, or name one in ZWIDTH_CHROMIUM")
    from jinja2 import Environment

    text = """<body><div hidden><div id="curves"></div></div><style>{{ p.style }}</style>
    <script type="application/json" id="curves-data">{{ curves | tojson }}</script>
    <script>{{ p.library }}</script><script>{{ p.script }}</script></body>"""
    page_file = tmp_path / "r.html"
    made = (
        Environment(autoescape=True)
        .from_string(text)
        .render(curves=curves_of([run()], LINES), p=program())
    )
    page_file.write_text(made, encoding="utf-8")
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 900, "height": 700})
        said: list[str] = []
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda asked: said.append(asked.url))
        page.goto(page_file.as_uri())
        assert said == [page_file.as_uri()]  # nothing else is fetched, and nothing fails
        assert page.locator("canvas").count() == 2
        tinted = """(c, tint) => {
          const p = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
          const same = (_, i) => tint.every((v, k) => p[4 * i + k] === v);
          return Array.from({length: p.length / 4}, same).filter(Boolean).length * 4 / p.length;
        }"""
        assert page.locator("canvas").first.evaluate(tinted, TINT) > 0.3
        legend = page.locator(".u-legend").first.inner_text()
        assert 'with </script> & "what" was found' in legend
        whole = page.locator("canvas").nth(1).screenshot()
        box = page.locator(".u-over").first.bounding_box()
        assert box is not None
        y = box["y"] + 0.5 * box["height"]
        page.mouse.move(box["x"] + 0.2 * box["width"], y)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.4 * box["width"], y, steps=5)
        page.mouse.up()
        page.wait_for_timeout(200)
        assert (
            page.locator("canvas").nth(1).screenshot() != whole
        )  # the error zooms with the motion
        page.screenshot(path=os.environ.get("ZWIDTH_PICTURE", str(tmp_path / "zoomed.png")))
        browser.close()


def test_the_report_is_found_and_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutations: the oldest of a folder; a path that is no address."""
    monkeypatch.chdir(tmp_path)
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)  # pyright: ignore[reportUnknownLambdaType, reportUnknownArgumentType, reportUnknownMemberType]
    assert cli.run(["report"]) == 2
    assert "runs is not a report" in capsys.readouterr().err
    Path("runs").mkdir()
    assert cli.run(["report"]) == 2
    assert "there is no report in runs; 'zwidth diagnose" in " ".join(
        capsys.readouterr().err.split()
    )
    for age, name in enumerate(("new", "old one")):
        file = Path("runs") / f"{name}.diagnosis.html"
        file.write_text(f"<title>Coulomb &amp; {name}</title></html>")
        os.utime(file, (1e9 - age, 1e9 - age))
    assert cli.run(["report", "--open", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["headline"] == "Coulomb & new"
    assert opened == [Path("runs/new.diagnosis.html").resolve().as_uri()]
    assert cli.run(["report", "data/old one.csv"]) == 0
    assert "Coulomb & old one" in capsys.readouterr().out
    assert cli.run(["report", "other.csv"]) == 2
    assert "other.csv is not a report" in capsys.readouterr().err
    Path("cut.diagnosis.html").write_text("<title>Coulomb")
    assert cli.run(["report", "cut.diagnosis.html"]) == 2
    assert "is not a complete report" in capsys.readouterr().err
