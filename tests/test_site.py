"""The documentation is a site: built with warnings as errors, every page sound in a browser."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from page_checks import chromium, faults, faults_of_picture, listened

pytest.importorskip("mkdocs", reason="the dev extra brings mkdocs-material")

ROOT = Path(__file__).parents[1]
COLOURED = 0.1  # by how much the colours of a pixel differ that is no grey


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not (ROOT / "mkdocs.yml").is_file():
        pytest.skip("not a clone: the wheel has no documentation")
    made = tmp_path_factory.mktemp("site")
    words = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--quiet",
        "--site-dir",
        str(made),
    ]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr + done.stdout
    return made


def test_every_page_is_in_the_navigation_and_every_link_leads_somewhere(site: Path) -> None:
    """Mutation that breaks it: a page left out of mkdocs.yml, a link to no file."""
    pages = {p.relative_to(ROOT / "docs").with_suffix("") for p in (ROOT / "docs").rglob("*.md")}
    built = {p.relative_to(site).with_suffix("") for p in site.rglob("*.html")}
    plain = {p.with_name("index") if p.name == "README" else p for p in pages}
    assert plain <= built


def test_no_page_fetches_anything_from_elsewhere(site: Path) -> None:
    front = (site / "index.html").read_text()
    for line in front.splitlines():
        if "<script" in line or "<link" in line:
            assert 'src="http' not in line
            assert 'href="https://fonts' not in line


def test_every_page_is_sound_in_a_browser(site: Path) -> None:
    """On a desk and on a phone: no error, no picture missing, no text on another, nothing wider.

    Mutation: a table that is not let to scroll, a heading pushed up onto the one above it.
    """
    wrong: list[str] = []
    with chromium() as browser:
        page = browser.new_page()
        said = listened(page)
        for file in sorted(site.rglob("*.html")):
            if file.name == "404.html":
                continue
            for width in (1300, 390):
                page.set_viewport_size({"width": width, "height": 900})
                if width == 1300:
                    page.goto(file.as_uri(), wait_until="load")
                found = faults(page, "article")
                wrong += [f"{file.relative_to(site)} at {width} pixels: {w}" for w in found]
    assert wrong + said == []


def test_no_picture_of_a_page_is_empty(site: Path) -> None:
    """Mutation: a picture of axes without a line, which is white for all but their frame."""
    for file in sorted(p for p in site.rglob("*.png") if "assets" not in p.parts):
        pixels = imread(file)[..., :3]
        shown = np.ptp(pixels, axis=2) > COLOURED if pixels.ndim == 3 else pixels < 1.0
        assert shown.mean() > 2e-4, file.name


def test_what_overlaps_is_seen() -> None:
    """Mutation: boxes held against those below alone, or of one element only."""
    text = "<p style='position:absolute;top:{}px'>{}</p>"
    with chromium() as browser:
        page = browser.new_page()
        page.set_content(text.format(10, "hello world") + text.format(14, "another"))
        assert faults(page) == ['"hello world" lies on "another"']
        page.set_content(text.format(10, "hello world") + text.format(60, "another"))
        assert faults(page) == []
        assert faults_of_picture(page, "<svg><path d='M0 0 L9 9'/></svg>") == ["it is empty"]


def test_the_search_works_from_a_folder(site: Path) -> None:
    """Where a browser allows no worker. Mutation: the plugin `offline` or its script taken out."""
    with chromium() as browser:
        page = browser.new_page()
        page.goto((site / "machines" / "index.html").as_uri(), wait_until="load")
        page.keyboard.press("/")
        page.locator(".md-search__input").press_sequentially("backlash")
        page.wait_for_selector(".md-search-result__link[href*='reference/effects/backlash']")
