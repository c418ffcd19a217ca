"""Draw the pictures of docs/explore.md: `python docs/make_explore_pictures.py`.

Needs what the tests of the page need: zwidth[dev] and a Chromium (ZWIDTH_CHROMIUM names one).
"""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Page, sync_playwright

from zwidth.explore.view import View
from zwidth.sim.device_file import load_device, save_device
from zwidth.sim.physics import make_physics

HERE = Path(__file__).parent
SCREEN = (1366, 657)  # a laptop of 1366 x 768, less what its browser takes
NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = ["--no-sandbox", "--no-first-run", "--disable-background-networking"]
STEPS = View(encoder_step=1e-4, command_limit=0.5, damping=0.075, stiffness=25.0)
FOUND = View(device=1, damping=0.05, stiffness=27.0, time_range=(0.0, 1.0))


@contextmanager
def served(*arguments: str) -> Generator[str]:
    """Serve the page; yields its address."""
    command = [sys.executable, "-u", "-m", "zwidth", "explore", *arguments, "--no-browser"]
    with subprocess.Popen([*command, "--port", "0"], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        line = next(line for line in server.stdout if "http://" in line)
        try:
            yield line.split(": ")[1].split(" ")[0]
        finally:
            server.send_signal(signal.SIGINT)


def draw(page: Page, address: str, view: View, name: str) -> None:
    """Open a view, wait until it is finished, and save a screenshot."""
    page.goto(f"{address}?{view.query()}")
    page.get_by_text("161 \u00d7 161").wait_for(timeout=120_000)
    page.wait_for_timeout(1000)
    page.screenshot(path=HERE / name)
    print(f"wrote {HERE / name}")


def main() -> None:
    """Draw all pictures."""
    path = os.environ.get("ZWIDTH_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)))
    with sync_playwright() as driver, TemporaryDirectory() as folder:
        browser = driver.chromium.launch(executable_path=path, args=OPTIONS)
        page = browser.new_page(viewport={"width": SCREEN[0], "height": SCREEN[1]})
        nominal = load_device("phantom_1_0")
        found = nominal.with_physics(
            make_physics("coulomb_friction", "m1", level=2e-3),
            make_physics("encoder_step", "sensor", step=1e-4),
        )
        augmented = Path(folder) / "augmented.toml"
        save_device(replace(found, name="with friction and encoder steps"), augmented)
        with served("phantom_1_0") as address:
            draw(page, address, STEPS, "explore.png")
        with served("phantom_1_0", "--compare", str(augmented)) as address:
            draw(page, address, FOUND, "explore_compare.png")
        browser.close()


if __name__ == "__main__":
    main()
