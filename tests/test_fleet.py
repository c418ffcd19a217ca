"""A fleet with known faults: each is found, named, and has no part in what is said of others."""

import json
import pickle
import shutil
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import MadeOnce
from numpy.typing import NDArray

import zwidth.fleet.structure
from zwidth import cli
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.errors import Status
from zwidth.exam.fleets import DRY, INERTIA, PER_LOAD, SPRING, Truth, make_fleet, nominal
from zwidth.figures.fleet import fleet_figure
from zwidth.fleet import diagnosed
from zwidth.fleet.diagnosed import diagnose_fleet
from zwidth.fleet.history import Change, changes, date_of
from zwidth.fleet.kept import Kept
from zwidth.fleet.listing import Listed, is_fleet, listed
from zwidth.fleet.odd import courses, odd_ones
from zwidth.fleet.quick import Quick, Task, held, names_of, run
from zwidth.fleet.reading import experiment_of
from zwidth.fleet.result import Fleet
from zwidth.fleet.structure import Structure, known_structure, sought, structure_from
from zwidth.fleet.switched_off import free_error, switched_off
from zwidth.sim.chain import make_chain
from zwidth.sim.device_file import device_to_text
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]
KNOWN = nominal().with_physics(make_physics("coulomb_friction", "m1", level=0.04))
SECONDS, DEVICES, RUNS = 4.0, 8, 4


def structure() -> Structure:
    return known_structure(KNOWN)


def kept(work: Path, recordings: int) -> None:
    """Have a folder know its structure, so that none is searched for."""
    Kept(work, KNOWN, "quick").keep_structure(structure(), recordings)


def make(folder: Path) -> None:
    """Write a fleet with faults, what is true of it, and what is found in it."""
    truth = make_fleet(folder / "rig", DEVICES, RUNS, 5, 3, SECONDS)
    (folder / "truth.pickle").write_bytes(pickle.dumps(truth))
    recordings = listed(folder / "rig")
    kept(folder / "work", len(recordings))
    diagnose_fleet(KNOWN, recordings, folder / "work")


@pytest.fixture(scope="module")
def made(made_once: MadeOnce, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Truth]:
    """A copy of that fleet, beside what is kept of its diagnosis, and what is true of it."""
    folder = tmp_path_factory.mktemp("fleet") / "copy"
    shutil.copytree(made_once("fleet", make), folder)
    return folder / "rig", pickle.loads((folder / "truth.pickle").read_bytes())


@pytest.fixture(scope="module")
def found(made: tuple[Path, Truth]) -> tuple[Fleet, Path]:
    work = made[0].with_name("work")
    return diagnose_fleet(KNOWN, listed(made[0]), work), work


def test_every_fault_is_found_named_and_no_other(
    made: tuple[Path, Truth], found: tuple[Fleet, Path]
):
    truth, fleet = made[1], found[0]
    said = {"slipped_clamp": "slipped", "other_spring": "other_device"}
    odd = {m.listed.name: m.reason.kind for m in fleet.odd if m.reason}
    assert odd == {name: said.get(kind, kind) for name, kind in truth.faults.items()}
    reasons = [m.reason for m in fleet.odd if m.reason]
    spring = next(r for r in reasons if r.kind == "other_device")
    assert spring.parameters == ("k0",)
    assert not spring.recording


def test_what_is_shared_differs_and_scales_is_told_without_the_odd_ones(found: tuple[Fleet, Path]):
    spreads = found[0].spreads
    assert spreads["b1"].shared
    assert spreads["k0"].shared
    assert spreads["k0"].center.value == pytest.approx(SPRING, rel=2e-3)
    mass, friction = spreads["m1"], spreads["coulomb_friction@m1.level"]
    assert mass.slopes["load [kg]"].value == pytest.approx(PER_LOAD, rel=0.02)
    assert mass.center.value == pytest.approx(INERTIA + PER_LOAD, rel=0.1)
    assert friction.per_device
    assert not friction.per_run
    assert friction.center.value == pytest.approx(DRY, rel=0.1)


def test_the_drift_is_dated_on_its_device_and_nothing_else_changed(
    made: tuple[Path, Truth], found: tuple[Fleet, Path]
):
    truth, fleet = made[1], found[0]
    (change,) = fleet.changes
    assert (change.device, change.shape) == (truth.drifting, "drift")
    assert change.parameter == "coulomb_friction@m1.level"
    first, last = (date.fromisoformat(date_of(day)) for day in change.between)
    assert (first - truth.since).days <= 0 <= (last - truth.since).days + 2
    assert (last - first).days <= 10


def test_a_new_recording_costs_itself_alone(
    made: tuple[Path, Truth], found: tuple[Fleet, Path], monkeypatch: pytest.MonkeyPatch
):
    fleet, work = found
    recordings = listed(made[0])
    asked: list[str] = []

    def counted(task: Task) -> list[Quick]:
        asked.extend(name for name, _ in task.recordings)
        return run(task)

    monkeypatch.setattr(diagnosed, "run", counted)
    again = diagnose_fleet(KNOWN, recordings, work)
    assert asked == []
    assert again.as_json() == fleet.as_json()
    path = recordings[0].path.parent / "new.csv"
    text = recordings[1].path.with_suffix(".csv").read_text().splitlines()
    path.write_text("\n".join(text[:-1]) + "\n")
    toml = recordings[1].path.read_text().replace(f"{recordings[1].path.stem}.csv", "new.csv")
    path.with_suffix(".toml").write_text(toml)
    new = replace(recordings[1], name="new", path=path.with_suffix(".toml"))
    more = diagnose_fleet(KNOWN, [*recordings, new], work)
    assert asked == ["new"]
    assert len(more.members) == len(fleet.members) + 1


def test_the_answer_is_json_and_a_picture(found: tuple[Fleet, Path]):
    text = json.dumps(found[0].as_json(), allow_nan=False)
    read = json.loads(text)
    assert read["recordings"] == DEVICES * RUNS
    assert read["changes"][0]["shape"] == "drift"
    pooled = [m for m in read["members"] if not m["odd"]]
    # What is one for all is known far better than from a recording alone.
    together, alone = (
        np.median([m[which]["k0"]["error"] for m in pooled]) for which in ("pooled", "parameters")
    )
    assert together < 0.5 * alone
    assert len(fleet_figure(found[0]).axes) == len(found[0].spreads)


def test_a_structure_is_read_as_it_was_written():
    one = structure()
    again = structure_from(one.to_json())
    assert again.to_json() == one.to_json()
    assert list(names_of(again)) == ["m1", "b1", "k0", "coulomb_friction@m1.level"]
    with pytest.raises(ValueError, match="not a fleet structure"):
        structure_from("{}")


def test_a_drive_that_was_off_for_a_while_is_found(made: tuple[Path, Truth]):
    """To a few samples, by free runs. A sound recording has none.

    Mutations: half of the error not asked for; the edges left on their grid.
    """
    model = structure().model
    x = np.zeros(len(model.parameters))
    sound = experiment_of(next(p.path for p in listed(made[0])), KNOWN, "sound")
    assert switched_off(sound, model, x) is None
    bench = KNOWN.with_chain(make_chain([2e-3], [4e-3], 0.1)).with_interface(period=0.01)
    known = known_structure(bench).model
    t = 0.01 * np.arange(600)
    command = 0.4 * np.sin(2.0 * np.pi * 0.4 * t) + 0.1 * np.sin(2.0 * np.pi * 1.7 * t)
    off = (t >= 2.13) & (t < 4.38)
    run = simulate(bench, recorded(np.where(off, 0.0, command)), duration=6.0, substeps=20)
    q = run.trace["position_m1"] + 1e-4 * np.random.default_rng(0).standard_normal(600)
    e = Experiment(0.01, command, q[:, None], (Output("position", 0),), "e", float(q.std()))
    found = switched_off(e, known, np.zeros(len(known.parameters)))
    assert found is not None
    assert (found.from_s, found.to_s) == pytest.approx((2.13, 4.38), abs=0.06)
    assert found.on > 1.0 > 2.0 * found.off
    inverted = replace(e, command=-np.asarray(run.trace["command"]))  # it drives the other way
    whole = replace(e, command=np.asarray(run.trace["command"]))
    left_out = switched_off(inverted, known, np.zeros(len(known.parameters)))
    sign = free_error(whole, known, np.zeros(len(known.parameters)))
    assert left_out is None or left_out.off > sign


def test_free_runs_that_explain_nothing_are_unlike_the_others():
    """Own parameters with wide errors excuse a recording: its free runs do not.

    Mutation: free runs judged by their scatter alone, which is wide where runs differ.
    """
    frees = [0.05, 0.07, 0.3, 0.15, 0.1, 0.5, 0.2, 0.04, 0.3, 2.3]
    one = Quick("r", np.zeros(1), np.array([1.0]), np.array([0.1]), np.array([[0.01]]), noise=1e-3)
    quicks = [replace(one, free=free) for free in frees]
    course = courses(np.ones((10, 1)), np.full((10, 1), 0.1), ["d"] * 10, {})
    odd = odd_ones(quicks, ["m1"], ["d"] * 10, course)
    assert list(odd) == [9]
    assert odd[9].fits_badly
    lost = [replace(q, free=6.0 * q.free + 1.0) for q in quicks[:9]]  # a structure that is wrong
    course = courses(np.ones((9, 1)), np.full((9, 1), 0.1), ["d"] * 9, {})
    assert odd_ones(lost, ["m1"], ["d"] * 9, course) == {}


def test_ctrl_c_while_a_structure_is_sought_ends_it(
    made: tuple[Path, Truth], monkeypatch: pytest.MonkeyPatch
):
    """A search keeps what it has and returns; the fleet went on. Mutation: `interrupted` unread."""
    real = zwidth.fleet.structure.search

    def stopped(*asked: Any) -> Any:
        tried = real(*asked)
        tried.interrupted = True
        return tried

    monkeypatch.setattr(zwidth.fleet.structure, "search", stopped)
    e = experiment_of(listed(made[0])[0].path, nominal(), "one")
    with pytest.raises(KeyboardInterrupt):
        sought(nominal(), [e, e], replace(QUICK, rivals=1), lambda _: None)


def test_a_reading_may_stand_still_where_the_command_does():
    """As of a servo that holds its goal. Mutation: the longest standstill, whatever is asked."""
    goal = np.concatenate([np.linspace(0.0, 1.0, 100), np.ones(200), np.linspace(1.0, 0.0, 100)])
    reading = goal + 0.0
    e = Experiment(0.01, goal, reading[:, None], (Output("position", 0),))
    assert held(e) <= 1 / 400
    stuck = reading.copy()
    stuck[310:360] = stuck[310]
    assert held(replace(e, measured=stuck[:, None])) == pytest.approx(49 / 400)


def test_what_sticks_is_no_sensor_without_new_readings():
    """Friction holds it while the command rises, and it sets out from where it stood.

    Mutation: `_sets_out` always False.
    """
    command = np.sin(np.linspace(0.0, 6.0, 400))
    reading = np.sin(np.linspace(-0.5, 5.5, 400))
    begins = 60 + int(np.argmax(reading[60:] > reading[60] + 0.3))
    stuck = np.concatenate([reading[:60], np.full(50, reading[60]), reading[60:350]])
    e = Experiment(0.01, command, stuck[:, None], (Output("position", 0),))
    assert held(e) <= 1 / 400
    stale = reading.copy()
    stale[60:begins] = reading[60]
    assert held(replace(e, measured=stale[:, None])) == pytest.approx((begins - 61) / 400)


def test_what_is_known_of_a_drive_stays_as_it_is():
    """Mutations: the drive's numbers free like a friction's; a drive lost with what is free."""
    servo = make_physics("position_servo", "m1", stiffness=20.0, damping=0.0, back_emf=1.0)
    for device in (nominal().with_physics(servo), KNOWN.with_physics(servo)):
        found = known_structure(device)
        assert [p.effect.name for p in found.device.physics] == ["position_servo"]
        assert "position_servo@m1" not in found.labels


def test_a_folder_without_a_table_has_devices_and_dates_in_its_names(tmp_path: Path):
    truth = make_fleet(tmp_path, 3, 2, 0, 1, 2.0)
    (tmp_path / "fleet.csv").unlink()
    first = tmp_path / "d000" / "r00.toml"
    first.rename(first.with_name("axis_2026-03-02_1430.toml"))
    (tmp_path / "device.toml").unlink()
    every = listed(tmp_path)
    assert truth.faults == {}
    assert len(every) == 6
    assert {one.device for one in every} == {"d000", "d001", "d002"}
    assert every[0].date == datetime(2026, 3, 2, 14, 30, tzinfo=UTC)
    e = experiment_of(every[0].path, nominal(), "one")
    assert e.ticks == 200


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (
            "recording,date\nr.csv,yesterday\n",
            "date 'yesterday'; write it as ISO 8601, such as 2026-03-02",
        ),
        ("recording\nother.csv\n", "'other.csv', which does not exist"),
        ("recording,load\nr.csv,heavy\n", "'load' of 'heavy'; it must be a finite number"),
        ("recording\nr.csv\nr.csv\n", "twice"),
        ("recording\n", "lists no recording"),
        ("file,date\nother.csv,2026-01-05\n", "'other.csv', which does not exist"),
    ],
)
def test_what_is_wrong_with_a_table_is_one_sentence(tmp_path: Path, table: str, said: str):
    (tmp_path / "r.csv").write_text("u,q\n1,2\n")
    (tmp_path / "fleet.csv").write_text(table)
    assert is_fleet(tmp_path / "fleet.csv")
    assert not is_fleet(tmp_path / "r.csv")
    with pytest.raises(ValueError, match=said):
        listed(tmp_path)


def test_a_toml_table_says_the_same_as_a_csv(tmp_path: Path):
    (tmp_path / "r.csv").write_text("u,q\n1,2\n")
    (tmp_path / "t.csv").write_text("recording;unit;date;gain\nr.csv;a;2026-03-02;2.5\n")
    (tmp_path / "t.toml").write_text(
        '[[recording]]\nfile = "r.csv"\ndevice = "a"\ndate = 2026-03-02\ngain = 2.5\n'
    )
    assert is_fleet(tmp_path / "t.toml")
    assert listed(tmp_path / "t.csv") == listed(tmp_path / "t.toml")
    assert listed(tmp_path / "t.csv")[0].known == {"gain": 2.5}


def history(seed: int, level: float = 0.0, slope: float = 0.0, runs: int = 12) -> list[Change]:
    """Recordings of four devices, of which the second changes."""
    rng = np.random.default_rng(seed)
    days: Floats = np.tile(7.0 * np.arange(runs, dtype=np.float64), 4)
    devices = [name for name in "abcd" for _ in range(runs)]
    errors = rng.uniform(0.5, 1.5, days.size)
    y = 100.0 + errors * rng.standard_normal(days.size)
    mine = np.array(devices) == "b"
    y[mine] += level * (days[mine] >= 42.0) + slope * np.maximum(0.0, days[mine] - 28.0)
    return changes("p", days, y, errors, devices, 0.0, 8)


def test_steps_and_drifts_are_told_and_dated():
    right = 0
    for seed in range(20):
        (step,) = history(seed, level=6.0)
        assert (step.device, step.shape) == ("b", "step")
        assert step.after - step.before == pytest.approx(6.0, abs=5.0 * step.error)
        right += step.between[0] < 42.0 <= step.between[1]
        (drift,) = history(seed, slope=0.3)
        assert (drift.device, drift.shape) == ("b", "drift")
        right += drift.between[0] <= 28.0 <= drift.between[1]
    assert right >= 36  # of 40 intervals of 95 %


@pytest.mark.parametrize("runs", [5, 12])
def test_one_recording_that_is_off_is_no_change(runs: int):
    """Mutation: held against a value that stays alone."""
    for place in range(runs):
        for off in (3.0, 10.0, 100.0, 1e4):
            rng = np.random.default_rng([runs, place])
            days: Floats = np.tile(7.0 * np.arange(runs, dtype=np.float64), 4)
            devices = [name for name in "abcd" for _ in range(runs)]
            y = 100.0 + rng.standard_normal(days.size)
            y[place] -= off
            assert changes("p", days, y, np.ones(days.size), devices, 0.0, 8) == []


def test_hardly_anything_changes_where_nothing_does():
    assert sum(len(history(seed)) for seed in range(100)) <= 1


def test_what_all_devices_do_together_is_of_all():
    rng = np.random.default_rng(0)
    days: Floats = np.tile(7.0 * np.arange(6, dtype=np.float64), 20)
    devices = [f"d{k}" for k in range(20) for _ in range(6)]
    y = 100.0 + np.repeat(rng.normal(0.0, 20.0, 20), 6) + 1.5 * (days >= 21.0)
    y += rng.standard_normal(days.size)
    (change,) = changes("p", days, y, np.ones(days.size), devices, 0.0, 21)
    assert change.device == "all devices"
    assert change.between[0] < 21.0 <= change.between[1]


def test_devices_that_differ_and_scale_are_not_odd():
    """Mutation: no scatter beside errors, or no line over the columns."""
    odd = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        devices = [f"d{k}" for k in range(12) for _ in range(4)]
        load = rng.uniform(0.0, 5.0, 48)
        y = 10.0 + 3.0 * load + np.repeat(rng.normal(0.0, 1.0, 12), 4) + 0.1 * rng.normal(size=48)
        quicks = [Quick(str(i), values=np.array([v]), errors=np.array([0.1]), noise=1.0, free=1.0)
                  for i, v in enumerate(y)]  # fmt: skip
        found = courses(y[:, None], np.full((48, 1), 0.1), devices, {"load": load})
        odd += len(odd_ones(quicks, ["p"], devices, found))
        quicks[5] = replace(quicks[5], values=np.array([y[5] + 2.0]))  # within its device alone
        shifted = np.array([q.values for q in quicks])
        found = courses(shifted, np.full((48, 1), 0.1), devices, {"load": load})
        assert 5 in odd_ones(quicks, ["p"], devices, found)
    assert odd == 0


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    make_fleet(tmp_path / "rig", 3, 2, 0, 1, 3.0)
    (tmp_path / "rig" / "device.toml").write_text(device_to_text(KNOWN))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def never(*_: object) -> None:
    raise AssertionError("the work began")


LINE = ["diagnose", "rig", "--device", "rig/device.toml", "--effort", "quick", "--out", "o"]


def test_the_command_writes_report_picture_and_typical_device(
    small: Path, capsys: pytest.CaptureFixture[str]
):
    kept(small / "o" / "rig.fleet", 6)
    assert cli.run([*LINE, "--json", "o/x.json"]) == Status.DONE
    read = json.loads((small / "o" / "x.json").read_text())
    assert read["structure"] == ["coulomb_friction@m1"]
    page = (small / "o" / "rig.fleet.html").read_text()
    assert page.count("<details id=") == 3
    assert "http" not in page.replace("http://www.w3.org", "")
    assert (small / "o" / "rig.fleet.png").stat().st_size > 10_000
    assert "coulomb_friction" in (small / "o" / "rig.fleet.device.toml").read_text()
    assert "6 recordings of 3 devices" in capsys.readouterr().out


@pytest.mark.parametrize("ending", ["html", "png", "svg", "device.toml"])
def test_a_file_of_the_users_stops_a_fleet_before_its_work(
    small: Path, ending: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("zwidth.fleet_door.diagnose_fleet", never)
    mine = small / "o" / f"rig.fleet.{ending}"
    mine.parent.mkdir()
    mine.write_text("mine\n")
    assert cli.run(LINE) == Status.BAD_INPUT
    assert "was not written by" in capsys.readouterr().err
    assert mine.read_text() == "mine\n"


@pytest.mark.parametrize("file", ["rig/fleet.csv", "rig/d000/r00.csv", "rig/d000/r00.toml"])
def test_a_fleet_writes_over_none_of_its_inputs(
    small: Path, file: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("zwidth.fleet_door.diagnose_fleet", never)
    before = Path(file).read_bytes()
    assert cli.run([*LINE, "--json", file, "--force"]) == Status.BAD_INPUT
    assert capsys.readouterr().err.splitlines()[-1].endswith("give another file to write")
    assert Path(file).read_bytes() == before


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (["rig", "rig/d000/r00.toml"], "one of them is a fleet"),
        (["rig", "--validate", "rig/d000/r00.toml"], "--validate cannot be used with a fleet"),
        (["rig", "--wall"], "--wall cannot be used with a fleet"),
        (["rig/d000/r00.toml", "--processes", "2"], "--processes and --cluster are for a fleet"),
    ],
)
def test_what_has_no_use_is_refused(
    small: Path, line: list[str], said: str, capsys: pytest.CaptureFixture[str]
):
    assert cli.run(["diagnose", *line]) == Status.BAD_INPUT
    assert said in capsys.readouterr().err


def test_fewer_than_three_recordings_are_no_fleet(small: Path):
    every = [Listed("a", small / "rig" / "d000" / "r00.toml")]
    kept(small / "w", 1)
    with pytest.raises(ValueError, match="1 of 1 recordings can be used, and a fleet needs 3"):
        diagnose_fleet(KNOWN, every, small / "w")


def test_a_work_folder_of_others_is_refused(tmp_path: Path):
    (tmp_path / "mine.txt").write_text("mine\n")
    with pytest.raises(ValueError, match="holds other files"):
        Kept(tmp_path, KNOWN, "quick")
