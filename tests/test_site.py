"""The documentation is a site: built with warnings as errors, every page sound in a browser."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mkdocs", reason="the dev extra brings mkdocs-material")

ROOT = Path(__file__).parents[1]
NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
BROKEN = """() => [
    ...[...document.images].filter(i => !(i.complete && i.naturalWidth > 20)).map(i => i.src),
    ...(document.documentElement.scrollWidth > window.innerWidth ? ["wider than the window"] : []),
]"""


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
    """No error in the console, no picture missing, nothing wider than a laptop's window."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="the dev extra brings playwright")
    named = os.environ.get("ZWIDTH_CHROMIUM")
    path = named or next((found for name in NAMES if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("no Chromium here: apt-get install chromium, or name one in ZWIDTH_CHROMIUM")
    wrong: list[str] = []
    with sync_api.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        page = chromium.new_page(viewport={"width": 1300, "height": 900})
        page.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda e: wrong.append(str(e)))
        for file in sorted(site.rglob("*.html")):
            if file.name != "404.html":
                page.goto(file.as_uri(), wait_until="load")
                wrong += [f"{file.name}: {w}" for w in page.evaluate(BROKEN)]
        chromium.close()
    assert not wrong
