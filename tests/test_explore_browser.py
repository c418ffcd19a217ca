"""`zwidth explore` in a real browser without a screen: Chromium, driven over its own protocol."""

import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

pytest.importorskip("bokeh", reason="needs the extra zwidth[explore]")
sync_api = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")

from playwright.sync_api import Browser, Page, expect  # noqa: E402

from zwidth.cli import run  # noqa: E402
from zwidth.scenarios.scenario_file import load_scenario  # noqa: E402
from zwidth.sim.device_file import load_device, save_device  # noqa: E402
from zwidth.sim.physics import make_physics  # noqa: E402

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
QUIET = (
    "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-sync",
    "--disable-component-update", "--disable-default-apps", "--disable-gpu", "--no-pings",
)  # fmt: skip
LAPTOP = {"width": 1366, "height": 657}  # what a browser leaves of 1366 x 768


@pytest.fixture(scope="module")
def browser() -> Generator[Browser]:
    named = os.environ.get("ZWIDTH_CHROMIUM")
    path = named or next((found for name in NAMES if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("no Chromium here: apt-get install chromium, or name one in ZWIDTH_CHROMIUM")
    with sync_api.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=path, args=list(QUIET))
        yield chromium
        chromium.close()


def interruptible() -> None:
    """Let Ctrl-C end a child: a shell's background jobs, and so their children, ignore it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def served(*arguments: str) -> Generator[str]:
    """The address of a page that the command serves."""
    command = [sys.executable, "-m", "zwidth", "explore", *arguments, "--no-browser", "--port", "0"]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with (
        tempfile.TemporaryFile("w+") as said,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=said, text=True, env=environment,
            preexec_fn=interruptible,
        ) as server,
    ):  # fmt: skip
        assert server.stdout is not None
        line = next((line for line in server.stdout if "http://" in line), "")
        try:
            yield line.split(": ")[1].split(" ")[0]
        finally:
            server.send_signal(signal.SIGINT)
            try:
                assert server.wait(120) == 0
            finally:
                server.kill()  # or leaving would wait forever
            said.seek(0)
            assert "Traceback" not in (text := said.read()), text


@pytest.fixture(scope="module")
def address() -> Generator[str]:
    with served("phantom_1_0") as url:
        yield url


def opened(browser: Browser, url: str) -> Page:
    """A page that has computed everything; any request that leaves this machine fails the test."""
    page = browser.new_page(viewport=LAPTOP)  # pyright: ignore[reportArgumentType]
    abroad: list[str] = []
    page.on("request", lambda r: abroad.append(r.url) if r.url.startswith("http") else None)
    page.on("pageerror", lambda error: pytest.fail(f"the page failed: {error}"))
    response = page.goto(url)
    assert response is not None
    assert response.ok, response.status
    finished(page)
    host = urlsplit(url).netloc
    assert {urlsplit(u).netloc for u in abroad} == {host}
    return page


def finished(page: Page) -> None:
    expect(page.get_by_text("161 \u00d7 161")).to_be_visible(timeout=60_000)


def query(page: Page) -> dict[str, str]:
    return {key: values[-1] for key, values in parse_qs(urlsplit(page.url).query).items()}


MAP = """() => {
  const data = Bokeh.documents[0].get_model_by_name("map").data
  return [Array.from(data.fate[0].data ?? data.fate[0]).join(""),
          Array.from(data.amplitude[0].data ?? data.amplitude[0]).join(" ")].join(";")
}"""
RUN = """() => Array.from(Bokeh.documents[0].get_model_by_name("run").data.position).join(" ")"""
WORDS = """() => Bokeh.documents[0].get_model_by_name("wall").html"""
PLACE = """([B, K]) => {
  const plane = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name("plane"))
  const box = plane.canvas_view.el.getBoundingClientRect()
  const {x_scale, y_scale} = plane.frame
  return [box.x + x_scale.compute(B), box.y + y_scale.compute(K)]
}"""


def test_a_view_is_changed_looked_at_and_saved(browser: Browser, address: str, tmp_path: Path):
    """By each slider but that of the delay, which another test moves."""
    page = opened(browser, address)
    assert "PHANToM 1.0" in page.title()
    for name, key in (
        ("Encoder step", "encoder_step"), ("Start amplitude", "start"),
        ("Friction at m1", "friction"), ("Command limit", "command_limit"),
    ):  # fmt: skip
        before = page.evaluate(MAP)
        slider = page.get_by_role("slider", name=name)
        if key in ("encoder_step", "friction"):
            slider.press("PageUp")
            slider.press("PageUp")
        slider.press("ArrowLeft" if key == "command_limit" else "ArrowRight")
        page.wait_for_function(f"location.search.includes('{key}=')")
        page.wait_for_function(f"before => ({MAP})() !== before", arg=before)
        finished(page)
    before, words = page.evaluate(RUN), page.evaluate(WORDS)
    x, y = page.evaluate(PLACE, [0.05, 40.0])
    page.mouse.click(x, y)
    page.wait_for_function(f"before => ({RUN})() !== before", arg=before)
    page.wait_for_function(f"before => ({WORDS})() !== before", arg=words)
    view = query(page)
    assert float(view["B"]) == pytest.approx(0.05, abs=2e-3)
    assert float(view["K"]) == pytest.approx(40.0, abs=0.5)

    with page.expect_download() as saving:
        page.get_by_role("link", name="log (MCAP)").click()
    saving.value.save_as(log := tmp_path / "run.mcap")
    assert run(["replay", str(log)]) == 0
    with page.expect_download() as saving:
        page.get_by_role("link", name="scenario").click()
    saving.value.save_as(file := tmp_path / "run.toml")
    scenario = load_scenario(file)
    assert scenario.controller.facts["stiffness"] == float(view["K"])
    assert scenario.device.interface.encoder_step == float(view["encoder_step"])
    setup = scenario.prepare()
    (trace, _, _), *_ = setup.blocks(setup.ticks)
    shown = np.array(page.evaluate(RUN).split(" "), dtype=np.float64)
    ran = trace["position_m1"]
    assert shown / np.abs(shown).max() == pytest.approx(ran / np.abs(ran).max(), rel=1e-12)

    other = opened(browser, page.url)  # the same address, sent to a colleague
    assert other.evaluate(MAP) == page.evaluate(MAP)
    assert other.evaluate(RUN) == page.evaluate(RUN)
    other.get_by_role("button", name="Amplitude").click()
    other.wait_for_function("location.search.includes('layer=amplitude')")
    assert "layer" not in query(page)  # two tabs do not know each other
    page.close()
    other.close()


FOCUS = """() => {
  let at = document.activeElement
  while (at?.shadowRoot?.activeElement) at = at.shadowRoot.activeElement
  return [at?.getAttribute("role") ?? at?.tagName, at?.getAttribute("aria-label")
          ?? at?.labels?.[0]?.textContent ?? at?.textContent ?? ""].join(" ").trim()
}"""
RECORDED = """() => Bokeh.documents[0].get_model_by_name("recorded").data.position.length"""


def test_a_laptop_shows_it_all_and_its_keyboard_reaches_it(
    browser: Browser, address: str, tmp_path: Path
):
    page = opened(browser, address + "?encoder_step=0.0001&command_limit=0.5")
    beyond = "[scrollWidth - innerWidth, scrollHeight - innerHeight]"
    assert max(page.evaluate(f"() => {{ with (document.documentElement) return {beyond} }}")) <= 0
    met = list[str]()
    while "BUTTON Frequency" not in met and len(met) < 60:
        page.keyboard.press("Tab")
        met.append(page.evaluate(FOCUS))
    wanted = [
        "slider Encoder step", "slider Command limit", "slider Delay", "slider Friction at m1",
        "slider Start amplitude", "BUTTON Reset the sliders to the device",
        "INPUT The wall only pushes", "INPUT K [N m/rad]", "INPUT B [N m s/rad]", "A log (MCAP)",
        "A scenario", "INPUT Recording to draw beside the run:", "BUTTON Outcome",
        "BUTTON Amplitude", "BUTTON Frequency",
    ]  # fmt: skip
    assert [one for one in met if one in wanted] == wanted

    page.keyboard.press("Enter")
    page.wait_for_function("location.search.includes('layer=frequency')")
    before = page.evaluate(RUN)
    page.get_by_label("K [N m/rad]").fill("33")
    page.keyboard.press("Enter")
    page.wait_for_function("location.search.includes('K=33')")
    page.wait_for_function(f"before => ({RUN})() !== before", arg=before)
    page.get_by_label("The wall only pushes").press("Space")
    page.wait_for_function("location.search.includes('one_sided=1')")

    with page.expect_download() as saving:
        page.get_by_role("link", name="log (MCAP)").click()
    saving.value.save_as(log := tmp_path / "run.mcap")
    chooser = page.get_by_label("Recording to draw")
    page.evaluate(DROP, ["wrong.csv", "a,b\n1,2\n"])
    expect(page.get_by_text("wrong.csv holds 1 sample, too few")).to_be_visible()
    assert page.evaluate(RECORDED) == 0
    chooser.set_input_files(log)
    page.wait_for_function(f"() => ({RECORDED})() > 0")
    expect(page.get_by_text("Beside: run.mcap")).to_be_visible()
    page.close()


@pytest.mark.parametrize("width", [420, 768, pytest.param(1024, marks=pytest.mark.truth)])
def test_a_phone_and_a_tablet_show_it_all(browser: Browser, address: str, width: int):
    """Nothing lies beyond the right edge. Mutations: a least width of a figure is left; no wrap."""
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto(address + "?encoder_step=0.0001&command_limit=0.5")
    finished(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    x, _, across, high = page.evaluate(AXES, "plane")
    assert 0.0 <= x < x + across <= width
    assert high > 200.0
    before = page.evaluate(RUN)
    at = page.evaluate(PLACE, [0.05, 40.0])
    page.mouse.click(*at)
    page.wait_for_function(f"before => ({RUN})() !== before", arg=before)
    page.close()


def test_the_tour_takes_three_clicks(browser: Browser, address: str):
    """And ends as it says. Mutation: the steps are not compared with what is shown."""
    page = opened(browser, address)
    said = list[str]()
    for number, name in ((1, "below the boundary"), (2, "beyond it"), (3, "a coarse encoder")):
        page.get_by_role("link", name=f"{number} {name}").click()
        finished(page)
        page.wait_for_function(f"() => ({WORDS})() !== ''")
        said.append(page.evaluate(WORDS))
        expect(page.locator("b", has_text=f"{number} {name}")).to_be_visible()
    assert "comes to rest" in said[0]
    assert "grows without bound" in said[1]
    assert "keeps oscillating" in said[2]
    page.close()


# Onto the page, not onto the chooser: a browser that opens the file instead leaves the page.
DROP = """([name, text]) => {
  const dataTransfer = new DataTransfer()
  dataTransfer.items.add(new File([text], name))
  const dropped = new DragEvent("drop", {dataTransfer, bubbles: true, cancelable: true})
  if (document.body.dispatchEvent(dropped)) throw new Error("the browser would open the file")
}"""
AXES = """name => {
  const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name(name))
  const {x, y, width, height} = view.canvas_view.el.getBoundingClientRect()
  return [x + view.frame.bbox.left, y + view.frame.bbox.top,
          view.frame.bbox.width, view.frame.bbox.height]
}"""


def test_what_is_zoomed_to_is_computed_and_stands_in_the_address(browser: Browser, address: str):
    page = opened(browser, address + "?command_limit=0.5")
    before = page.evaluate(MAP)
    page.locator("[title^='Box Zoom']").first.click()
    x, y, width, height = page.evaluate(AXES, "plane")
    page.mouse.move(x + 0.5 * width, y + 0.1 * height)
    page.mouse.down()
    page.mouse.move(x + 0.75 * width, y + 0.5 * height, steps=4)
    page.mouse.up()
    page.wait_for_function(f"before => ({MAP})() !== before", arg=before)
    finished(page)
    low, high = (float(k) for k in query(page)["K_range"].split(","))
    assert (low, high) == pytest.approx((25.0, 45.0), abs=1.0)
    page.locator("[title^='Fit the axes']").first.click()
    page.wait_for_function("!location.search.includes('K_range=2')")
    finished(page)
    assert query(page)["K_range"] == "0.0,50.0"

    x, y, width, height = page.evaluate(AXES, "position")
    page.mouse.move(x + 0.25 * width, y + 0.5 * height)
    page.mouse.wheel(0, -600)
    page.wait_for_function("location.search.includes('t_range=')")
    start, stop = (float(t) for t in query(page)["t_range"].split(","))
    assert 0.0 < start < 1.0 < stop < 4.0
    for _ in range(6):
        page.mouse.wheel(0, 600)
    page.wait_for_function("!location.search.includes('t_range=')")
    page.close()


def test_a_device_with_and_without_what_was_found(browser: Browser, tmp_path: Path):
    found = make_physics("coulomb_friction", "m1", level=2e-3)
    save_device(load_device("phantom_1_0").with_physics(found), file := tmp_path / "found.toml")
    with served("phantom_1_0", "--compare", str(file)) as url:
        page = opened(browser, url + "?K=27&B=0.05")
        without, shown = page.evaluate(MAP), page.evaluate(RUN)
        page.get_by_role("button", name="with Coulomb friction at m1").click()
        page.wait_for_function("location.search.includes('device=1')")
        page.wait_for_function(f"before => ({MAP})() !== before", arg=without)
        finished(page)
        page.wait_for_function(f"before => ({RUN})() !== before", arg=shown)
        expect(page.get_by_text("2 mN m (the device's)")).to_be_visible()
        other = page.evaluate(RUN.replace('"run"', '"beside"'))
        assert len(other.split(" ")) == len(shown.split(" "))
        page.close()


def test_a_tab_closed_while_it_computes_disturbs_no_other(browser: Browser, address: str):
    stays = opened(browser, address)
    for _ in range(2):
        goes = browser.new_page()
        goes.goto(address + "?friction=0.003&encoder_step=0.0001")
        goes.wait_for_function("() => Bokeh.documents.length > 0")
        goes.close()
    slider = stays.get_by_role("slider", name="Delay")
    before = stays.evaluate(MAP)
    slider.press("ArrowRight")
    stays.wait_for_function("location.search.includes('delay_s=')")
    stays.wait_for_function(f"before => ({MAP})() !== before", arg=before)
    finished(stays)
    stays.close()


PRESS = """async (key) => {
  const text = Bokeh.documents[0].get_model_by_name("progress")
  const frame = () => new Promise(done => requestAnimationFrame(done))
  const times = []
  return await new Promise((done, failed) => {
    let began = null
    const slow = setTimeout(() => failed(new Error(
      `no new picture: ${JSON.stringify(times)}, now ${text.html}, ${document.visibilityState}`
    )), 30000)
    const changed = async () => {
      const said = text.html
      await frame(); await frame()  // drawn in the first, seen in the second
      times.push([performance.now() - began, said])
      if (said.includes("11 \u00d7 11")) return
      text.properties.html.change.disconnect(changed)
      clearTimeout(slow)
      done(times)
    }
    text.properties.html.change.connect(changed)
    let handle = document.activeElement
    while (handle.shadowRoot?.activeElement) handle = handle.shadowRoot.activeElement
    began = performance.now()
    handle.dispatchEvent(new KeyboardEvent("keydown", {key, bubbles: true, cancelable: true}))
  })
}"""


@pytest.mark.parametrize(
    ("start", "moves"),
    [
        pytest.param("", 4, id="no friction"),
        pytest.param("", 20, id="no friction, as measured", marks=pytest.mark.truth),
        pytest.param("?friction=0.002", 8, id="friction, as measured", marks=pytest.mark.truth),
    ],
)
def test_slider_to_picture(
    browser: Browser, address: str, start: str, moves: int,
    record_property: Callable[[str, object], None],
):  # fmt: skip
    """Measures; what it measures stands in docs/performance.md. -m truth -s shows it."""
    page = opened(browser, address + start)
    page.get_by_role("slider", name="Encoder step").focus()
    first, middle = list[float](), list[float]()
    for move in range(moves):
        seen = page.evaluate(PRESS, "ArrowRight" if move < moves // 2 else "ArrowLeft")
        first.append(seen[0][0])
        middle.append(seen[-1][0])
    page.close()
    for name, times in (("first picture", first), ("41 x 41", middle)):
        median = statistics.median(times)
        record_property(name, median)
        print(f"{name}: median of {moves} moves {median:.0f} ms, most {max(times):.0f} ms")
    assert len(first) == moves
    assert all(0.0 < f <= m for f, m in zip(first, middle, strict=True))
