"""What is wrong with a page or a picture in a browser: errors, emptiness, texts that overlap."""

import base64
import io
import os
import re
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from matplotlib import rc_context

from zwidth.figures.style import STYLE

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from playwright.sync_api import Browser, Page

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
SVG = re.compile(r"data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)")
FEWEST_LINES = 20  # axes and ticks alone are as many
BROKEN = """() => [
    ...[...document.images].filter(i => !(i.complete && i.naturalWidth > 20))
        .map(i => `no picture: ${i.src.slice(0, 99)}`),
    ...(document.documentElement.scrollWidth > window.innerWidth ? ["wider than the window"] : []),
]"""
CUT_OFF = """() => [...document.querySelectorAll("svg text")].filter(t => {
    const own = t.getBoundingClientRect(), whole = t.ownerSVGElement.getBoundingClientRect()
    return own.width > 0 && (own.left < whole.left - 1 || own.right > whole.right + 1
        || own.top < whole.top - 1 || own.bottom > whole.bottom + 1)
}).map(t => `"${t.textContent.trim().slice(0, 60)}" is cut off`)"""
# Boxes of texts, a line each; two overlap where they share a fifth of the smaller one.
OVERLAPS = """root => {
    const boxes = [], range = document.createRange()
    const texts = document.createTreeWalker(document.querySelector(root), NodeFilter.SHOW_TEXT)
    for (let node; node = texts.nextNode();) {
        const of = node.parentElement
        if (!node.data.trim()) continue
        if (!of.checkVisibility({visibilityProperty: true, opacityProperty: true})) continue
        if (of.closest("title, style, script, defs, .headerlink")) continue
        range.selectNodeContents(node)
        const words = node.data.trim().slice(0, 40)
        for (const r of range.getClientRects())
            if (r.width > 1 && r.height > 1)
                boxes.push({of, words, x: r.x, y: r.y, r: r.right, b: r.bottom})
    }
    boxes.sort((a, b) => a.y - b.y)
    const found = []
    boxes.forEach((one, i) => {
        for (let j = i + 1; j < boxes.length && boxes[j].y < one.b; j++) {
            const two = boxes[j]
            if (one.of === two.of) continue
            const width = Math.min(one.r, two.r) - Math.max(one.x, two.x)
            const height = Math.min(one.b, two.b) - Math.max(one.y, two.y)
            const least = Math.min(...[one, two].map(t => (t.r - t.x) * (t.b - t.y)))
            if (width > 0 && height > 0 && width * height > 0.2 * least)
                found.push(`"${one.words}" lies on "${two.words}"`)
        }
    })
    return found
}"""


@contextmanager
def chromium() -> "Generator[Browser]":
    """A browser without a screen; skips the test where there is none."""
    reason = "the dev extra brings playwright"
    sync_api = pytest.importorskip("playwright.sync_api", reason=reason)
    named = os.environ.get("ZWIDTH_CHROMIUM")
    path = named or next((found for name in NAMES if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("no Chromium here: apt-get install chromium, or name one in ZWIDTH_CHROMIUM")
    with sync_api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


def listened(page: "Page") -> list[str]:
    """What the console of a page complains of from now on."""
    wrong: list[str] = []
    page.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda e: wrong.append(str(e)))
    return wrong


def faults(page: "Page", root: str = "body") -> list[str]:
    """What is wrong with the page that is open; root: where its texts are looked at."""
    return [*page.evaluate(BROKEN), *page.evaluate(OVERLAPS, root)]


def faults_of_picture(page: "Page", svg: str) -> list[str]:
    """What is wrong with a picture: texts that overlap or are cut off, or hardly a line in it."""
    page.set_content(f"<body>{svg}</body>")
    lines = page.evaluate("() => document.querySelectorAll('path, use, polyline').length")
    wrong = page.evaluate(OVERLAPS, "body") + page.evaluate(CUT_OFF)
    return wrong + ([] if lines > FEWEST_LINES else ["it is empty"])


def faults_of_figure(page: "Page", figure: "Figure") -> list[str]:
    """The same of a picture that is not in a file yet."""
    stream = io.StringIO()
    with rc_context(STYLE):
        figure.savefig(stream, format="svg")
    return faults_of_picture(page, stream.getvalue())


def faults_of_report(page: "Page", report: Path) -> list[str]:
    """What is wrong with a report, and with each of the pictures inside it."""
    wrong = listened(page)
    page.goto(report.as_uri(), wait_until="load")
    wrong += faults(page)
    pictures = SVG.findall(report.read_text(encoding="utf-8"))
    for i, picture in enumerate(pictures):
        found = faults_of_picture(page, base64.b64decode(picture).decode())
        wrong += [f"picture {i + 1}: {fault}" for fault in found]
    return wrong if pictures else [*wrong, "a report without a picture"]
