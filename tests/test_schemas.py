"""The published JSON schemas, held against real outputs and real files."""

import json
import re
import runpy
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import MadeOnce
from sampled import SAMPLE, Sampled
from test_check import banded, bench, heavier, recorded, write_csv
from test_door import ANGLE, TORQUE, T
from test_fleet import KNOWN, make

from zwidth import cli
from zwidth.controllers.excitation import noise
from zwidth.diagnose_files import _plain
from zwidth.diagnosis.answer.changes import Change, Windows
from zwidth.diagnosis.answer.events import Course, Event
from zwidth.diagnosis.answer.result import Estimate, Unanswered
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.mishaps import Mishap
from zwidth.files.whole import json_text
from zwidth.fleet.diagnosed import diagnose_fleet
from zwidth.fleet.listing import listed
from zwidth.identification.output import position
from zwidth.sim.device_file import commented_text, shipped_devices, template_text
from zwidth.sim.device_file import load_device as load
from zwidth.sim.trace import Trace

jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
DOCS = Path(__file__).parents[1] / "docs"
if not DOCS.is_dir():
    pytest.skip("not a clone: the wheel has no documentation", allow_module_level=True)


def refused(name: str, value: Any) -> list[str]:
    schema = json.loads((DOCS / "schemas" / f"{name}.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    found = jsonschema.Draft202012Validator(schema).iter_errors(value)
    return [error.message for error in found]


def test_the_schemas_are_those_that_the_code_declares():
    """Mutation: an effect without a new `python docs/make_schemas.py`."""
    for name, text in runpy.run_path(str(DOCS / "make_schemas.py"))["texts"]().items():
        assert (DOCS / "schemas" / name).read_text() == text, "run: python docs/make_schemas.py"


@pytest.mark.parametrize("name", shipped_devices())
def test_shipped_devices_are_as_the_schema_says(name: str):
    assert refused("device", tomllib.loads(commented_text(load(name)))) == []


def test_a_device_with_a_band_and_the_template_are_too():
    assert refused("device", tomllib.loads(commented_text(banded()))) == []
    assert refused("device", tomllib.loads(template_text(2))) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [("period_s", "period"), ('"stribeck_friction"', '"stribeck"'), ("scatter", "scater"),
     ("[chain]", "[chains]"), ("level", "levl")],
)  # fmt: skip
def test_a_slip_in_a_device_file_is_refused(old: str, new: str):
    assert refused("device", tomllib.loads(commented_text(banded()).replace(old, new)))


LOOSE = (
    ("where",), ("where", "time", 0), ("where", "state", 0), ("where", "entry", 0), ("facts",),
    ("facts", "chi2_per_sample"), ("fit", "whole_run", 0), ("fit", "whole_run", 0, "rms"),
    ("fit", "force", 0), ("findings", 0), ("adequacy",), ("adequacy", "horizons", 0), ("cost",),
    ("cost", "by", 0),
)  # fmt: skip


def misspelt(value: Any, place: tuple[str | int, ...]) -> Any:
    """Return a copy with a key too many at a place."""
    copy = json.loads(json.dumps(value))
    inner = copy
    for key in place:
        inner = inner[key]
    inner["slip of the pen"] = 1
    return copy


def test_every_schema_has_an_id_of_its_own_is_on_a_page_and_in_the_wheel():
    """Mutation: a schema without an entry in `SCHEMAS`, or the folder left out of the wheel."""
    files = sorted((DOCS / "schemas").glob("*.json"))
    found = [json.loads(path.read_text()) for path in files]
    assert len({schema["$id"] for schema in found}) == len(found) == 11
    page = (DOCS / "diagnosis_json.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"\(schemas/([\w.]+)\)", page)) == [path.name for path in files]
    project = tomllib.loads((DOCS.parent / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel["force-include"]["docs/schemas"] == "zwidth/schemas"


def base() -> dict[str, Any]:
    """What a diagnosis that an error ended leaves, without files."""
    error = Mishap("gate", "", "ValueError: no", ValueError("no"))
    fault = Fault("clipped_command", "it was clipped", False, 1.0, "a.csv", ("command",))
    left = Unanswered("an error", (fault,), (error,)).as_json()
    files = {"augmented_device": None, "report": None, "logs": [], "device": "d", "boundary": None}
    return _plain(left | files)


def test_an_answer_that_an_error_ended_is_as_the_schema_says():
    found = base()
    assert refused("diagnosis", found) == []
    for loose in (("errors", 0), ("faults", 0)):
        assert refused("diagnosis", misspelt(found, loose)), loose
    assert refused("diagnosis", found | {"upper_bounds": {"backlash@link12": 0.1}})
    assert refused("diagnosis", found | {"upper_bounds": {"backlash@link12": {"gap": 0.1}}}) == []


@pytest.mark.parametrize("shape", ["step", "settling", "follows", "each recording"])
def test_a_change_is_as_the_schema_says(shape: str):
    one, many = Estimate(1.0, 0.5, np.inf, "N m"), np.array([0.0, np.nan])
    step = shape == "step"
    change = Change(
        "level", "coulomb_friction" if step else None, "m1" if step else None, shape, "a.csv",
        3.0 if step else None, (2.0, 4.0) if step else None, None if step else 9.0, one, one, one,
        12.0, (0.1, 0.05) if step else None, 1, Windows(many, many, many, many, many, many, None),
        rate_between=None if step else (8.0, 10.0), each=(("a.csv", one),),
        covariate_ends=(20.0, 40.0) if shape == "follows" else None,
    )  # fmt: skip
    found = base() | {"changes": [_plain(change.as_json())]}
    assert refused("diagnosis", found) == []
    for loose in (("changes", 0), ("changes", 0, "windows"), ("changes", 0, "by")):
        assert refused("diagnosis", misspelt(found, loose)), loose
    found["changes"][0]["shape"] = "leap"
    assert refused("diagnosis", found)


@pytest.mark.parametrize("kind", ["stop", "slip"])
def test_an_event_is_as_the_schema_says(kind: str):
    one, many = Estimate(1.0, 0.5, 1.5, "N"), np.array([0.0, 1.0])
    hit = kind == "stop"
    event = Event(
        kind, "m1", "a.csv", 3.0, (2.9, 3.1), 3.5 if hit else None, (3.4, 3.6) if hit else None,
        one if hit else None, one if hit else None, one if hit else None, None if hit else one,
        0.2 if hit else None, ("m2",), 99.0, 2, Course(many, many, many, many, many, "N", "m"),
    )  # fmt: skip
    found = base() | {"events": [_plain(event.as_json())]}
    assert refused("diagnosis", found) == []
    for loose in (("events", 0), ("events", 0, "course")):
        assert refused("diagnosis", misspelt(found, loose)), loose


@pytest.mark.parametrize(
    "line",
    [
        "plan DEV --seconds 3 --noise 1e-4 --excitation small_multisine",
        "boundary phantom_1_0 --delay-ms 2 --damping 0 0.02 5 --tolerance 0.05 --limit-s 4"
        " --criterion passivity --felt --lever 0.1",
        "boundary DEV --delay-ms 2 --damping 0.01 --tolerance 0.05 --limit-s 4",
        "relay phantom_1_0 --delay-ms 2 --damping 0.02 --starts 2",
        "sweep phantom_1_0 --over delay --values 0.001 0.002 --dampings 3 --rounds 0"
        " --tolerance 0.05 --limit-s 2",
        "map phantom_1_0 --coarse 3 --levels 0 --seconds 0.5",
    ],
)
def test_what_other_commands_write_is_as_the_schemas_say(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Mutation: a key added or renamed where the JSON is made."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dev.toml").write_text(commented_text(bench()))
    command, *rest = line.replace("DEV", "dev.toml").split()
    assert cli.run([command, *rest, "--json", "r.json"]) == 0
    found = json.loads((tmp_path / "r.json").read_text())
    assert refused(command, found) == []
    assert refused(command, misspelt(found, ()))
    first = {"plan": "plans", "boundary": "boundaries", "relay": "conditions", "sweep": "steps"}
    assert refused(command, misspelt(found, (first.get(command, "transitions"), 0)))


def test_an_identified_device_is_as_the_schema_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    modal = load("phantom_1_0").modal
    assert modal is not None
    u = noise(duration=12.0)
    q = position(modal, 0.0, u, 0.001)
    q += 1e-5 * np.random.default_rng(0).standard_normal(u.size)
    write_csv(tmp_path / "good.csv", Trace(
        np.linspace(0.0, 12.0, u.size, endpoint=False), {"command": u, "position_m1": q},
        {"command": "N m", "position_m1": "rad"}, "recorded", {},
    ))  # fmt: skip
    assert cli.run(["identify", "good.csv", "--json", "r.json"]) == 0
    found = json.loads((tmp_path / "r.json").read_text())
    assert refused("identify", found) == []
    assert refused("identify", misspelt(found, ("parameters", "m")))


def test_a_diagnosis_and_checks_are_as_the_schemas_say(
    sampled: Sampled, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Of the sample, and of a like recording of a bench that is heavier."""
    monkeypatch.chdir(tmp_path)
    write_csv(tmp_path / "bad.csv", recorded(heavier(bench()), 71))
    found = sampled.answer
    assert found["findings"]
    assert refused("diagnosis", found) == []
    for loose in LOOSE:
        assert refused("diagnosis", misspelt(found, loose)), loose
    assert refused("device", tomllib.loads(sampled.device.read_text())) == []
    line = ["check", str(sampled.device), str(SAMPLE), "bad.csv", "--json", "c.json"]
    assert cli.run(line) == 1
    found = json.loads((tmp_path / "c.json").read_text())
    assert found["changed"]
    assert refused("check", found) == []
    for loose in (("recordings", 0), ("changed", 0)):
        assert refused("check", misspelt(found, loose)), loose
    del found["recordings"][0]["outputs"][0]["most"]
    assert refused("check", found) == ["'most' is a required property"]
    assert cli.run(["check", str(sampled.device), "none.csv", "--json", "c.json"]) == 2
    none = json.loads((tmp_path / "c.json").read_text())
    assert refused("check", none) == []
    assert refused("check", misspelt(none, ()))


def test_a_fleet_is_as_the_schema_says(made_once: MadeOnce, tmp_path: Path):
    """With one that runs away. Mutations: a key added or renamed; a number that JSON has not."""
    shutil.copytree(made_once("fleet", make), tmp_path / "copy")
    fleet = diagnose_fleet(KNOWN, listed(tmp_path / "copy" / "rig"), tmp_path / "copy" / "work")
    first, *others = fleet.members
    away = replace(first, quick=replace(first.quick, free=np.inf))
    found = json.loads(json_text(replace(fleet, members=(away, *others)).as_json()))
    assert found["members"][0]["free_run"] is None
    assert refused("fleet", found) == []
    for loose in ((), ("parameters", "k0"), ("parameters", "m1", "slopes", "load [kg]"),
                  ("odd", 0), ("changes", 0), ("members", 0), ("members", 0, "parameters", "k0"),
                  ("members", 0, "pooled", "k0")):  # fmt: skip
        assert refused("fleet", misspelt(found, loose)), loose


def test_the_joints_of_a_recording_are_as_the_schema_says(
    sampled: Sampled, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Of one that is diagnosed and one that is not. Mutation: a joint without its answer."""
    monkeypatch.chdir(tmp_path)
    grid = np.column_stack([T, TORQUE, ANGLE, TORQUE, ANGLE, 0.0 * T, 0.0 * T])
    header = "time,tau[0],q[0],tau[1],q[1],tau[2],q[2]"
    np.savetxt("arm.csv", grid, "%.17g", ",", header=header, comments="")

    def diagnose(console: Any, recordings: tuple[Path, ...], *_: Any) -> Any:
        if recordings[0].name == "arm.1.toml":
            raise ValueError("a test")
        console.result(sampled.answer)
        return sampled.found

    monkeypatch.setattr("zwidth.joint_door.diagnose_files", diagnose)
    assert cli.run(["diagnose", "arm.csv", "--joint", "all", "--json", "r.json"]) == 0
    found = json.loads((tmp_path / "r.json").read_text())
    assert found == {
        "joints": {"0": sampled.answer, "1": {"error": "a test"}}, "still": ["2"]
    }  # fmt: skip
    assert refused("joints", found) == []
    for loose in ((), ("joints", "0"), ("joints", "0", "findings", 0), ("joints", "1")):
        assert refused("joints", misspelt(found, loose)), loose
