"""docs/foxglove_layout.json shows what a log really holds (of a diagnosis: its command's test)."""

from pathlib import Path

from tests.foxglove_layout import LAYOUT, OF_A_DIAGNOSIS, OF_A_RUN, assert_shown, placed
from zwidth.controllers.wall import wall
from zwidth.logs.events import Event
from zwidth.logs.mcap_writer import write_log
from zwidth.sim.device_file import load_device
from zwidth.sim.run import Start, simulate


def test_every_place_in_the_layout_is_in_a_log(tmp_path: Path) -> None:
    """Mutation: a channel written under another name (`units.SUFFIXES`), or a misspelt path."""
    start = Start(1e-3)
    phantom = load_device("phantom_1_0")
    run = simulate(phantom, wall(10.0, 0.02), duration=0.05, start=start, ledger=True)
    log = tmp_path / "run.mcap"
    write_log(log, run.trace, events=[Event(0.01, "contact", "m1", 0.1)], epoch_ns=0)
    assert assert_shown(log, OF_A_RUN) == {"/tick", "/events"}


def test_every_panel_is_placed_once() -> None:
    """Mutation: a panel left out of the layout, or named there and not described."""
    panels = list(placed(LAYOUT["layout"]))
    assert sorted(panels) == sorted(LAYOUT["configById"])
    assert {panel.partition("!")[0] for panel in OF_A_DIAGNOSIS} == {
        "Plot", "StateTransitions", "RosOut", "RawMessages",
    }  # fmt: skip
