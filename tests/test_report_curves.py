"""Curves of a report: their numbers, what a browser makes of them, and how a report is found."""

import base64
import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zwidth import cli
from zwidth.diagnosis.answer.whole_run import WholeRun
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


def numbers(text: str) -> Any:
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_curves_are_the_run_in_a_unit_that_fits():
    """Mutations: the simulated run for its error, which a 32-bit float does not hold; radians."""
    (curve,) = curves_of([run()], LINES)
    assert (curve["unit"], curve["begins"], curve["period"]) == ("mrad", 2.0, 0.001)
    assert numbers(curve["measured"]) == pytest.approx(1e3 * MEASURED, abs=1e-6)
    before, after = curve["runs"]
    assert before["colour"] == "#999999"
    assert numbers(after["error"]) == pytest.approx(np.full(N, 1e-6), rel=1e-3)
    assert np.isinf(numbers(before["error"])[3000:]).all()


def test_long_runs_stay_below_three_megabytes():
    """Mutation: every sample whatever the length."""
    curves = curves_of([run(500_000), run(500_000)], LINES)
    assert sum(numbers(c["measured"]).size for c in curves) * 3 <= MOST
    assert curves[0]["period"] == pytest.approx(0.001 * 25)
    assert curves[0]["name"].endswith("one of 25 samples")
    assert len(json.dumps(curves)) + sum(map(len, program().values())) < 0.9e6


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
    assert "is not a whole report" in capsys.readouterr().err
