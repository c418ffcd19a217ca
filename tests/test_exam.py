"""Concealed recordings: sealed, telling nothing, the same again; and how answers are marked."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from tests.physics_examples import phantom
from zwidth.cli import zwidth
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.exam import sitting
from zwidth.exam.conceal import conceal, make, orders
from zwidth.exam.drawing import draw
from zwidth.exam.hidden import seen
from zwidth.exam.mark import linear_truth, mark, stands_apart
from zwidth.exam.of_library import as_made, chosen
from zwidth.exam.perfect import HeldOut
from zwidth.exam.share import Share
from zwidth.exam.strata import STRATA, counts
from zwidth.exam.take import mark_all, open_seal, sit_all
from zwidth.exam.tally import tally
from zwidth.exam_page import goals, page
from zwidth.exam_sections import ratio
from zwidth.jobs.executor import Local
from zwidth.planning.reference import reference
from zwidth.scenarios.concealed.handout import key_file, names, recording_files
from zwidth.scenarios.concealed.outside import OUTSIDE
from zwidth.scenarios.concealed.rig import record
from zwidth.scenarios.concealed.sealing import SealError, canonical, seal
from zwidth.scenarios.concealed.shapes import Motion, draw_physics, places
from zwidth.sim.chain import make_chain
from zwidth.sim.physics import EFFECTS, NAMES

FRICTION = {
    "effect": "coulomb_friction", "at": "m1", "values": {"level": 0.01}, "magnitude": 0.01,
    "times_limit": 5.0, "sigma": 25.0, "sigma_beside": 25.0,
    "rivals": {"stribeck_friction@m1": 0.1, "dead_band@command": 9.0},
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one recording of nothing and one of an effect, two seconds each."""
    made = tmp_path_factory.mktemp("concealed")
    conceal(made, orders(made, {"none": 1, "single_5x": 1}, 7, 2.0), Local())
    return made


def copied(folder: Path, to: Path) -> Path:
    for part in ("recordings", "keys"):
        (to / part).mkdir()
        for file in (folder / part).iterdir():
            (to / part / file.name).write_bytes(file.read_bytes())
    return to


class Answer:
    """What a diagnosis hands over."""

    def __init__(self, device: Any, findings: list[dict[str, Any]]) -> None:
        self.device, self.findings = device, findings

    def as_json(self) -> dict[str, Any]:
        return {
            "verdict": "identified" if self.findings else "nothing_missing",
            "findings": self.findings,
            "linear_refit": {"gain": {"nominal": 1.0, "value": 1.0, "ci95": [0.99, math.nan]}},
        }


def silent(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Let every diagnosis find nothing; returns the list of lengths it was given."""
    taken: list[int] = []

    def diagnose(device: Any, experiments: Any) -> Answer:
        taken.append(experiments[0].ticks)
        return Answer(device, [])

    monkeypatch.setattr(sitting, "diagnose", diagnose)
    return taken


def test_recordings_say_nothing(folder: Path) -> None:
    """Descriptions differ in name, seal and channels alone, device files hold no physics."""
    assert names(folder) == ["r0001", "r0002"]
    for name in names(folder):
        files = recording_files(folder, name)
        description = (folder / "recordings" / f"{name}.toml").read_text()
        key = json.loads(key_file(folder, name).read_text())["key"]
        told = description + files["device"].read_text()
        for secret in ("none", "single", "physics", "seed", *(h["effect"] for h in key["hidden"])):
            assert secret not in told
        assert (
            "physics" in key["device"] or key["stratum"] == "none" or "interface" in key["device"]
        )
        header = files["recording"].read_text().splitlines()[0]
        assert set(header.split(",")) <= {
            "command", "position_m1", "velocity_m1", "position_m2", "position_m3", "position_m4"
        }  # fmt: skip


def test_the_same_seed_makes_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    """And another index another recording; breaks where a random number comes from elsewhere."""
    order = next(o for o in orders(tmp_path, {"none": 1, "single_5x": 1}, 7, 2.0)
                 if o.stratum == "none")  # fmt: skip
    for part in ("recordings", "keys"):
        (tmp_path / part).mkdir()
    make(order)
    for made in tmp_path.rglob("r*.*"):
        assert made.read_bytes() == (folder / made.relative_to(tmp_path)).read_bytes()
    rows = (folder / "recordings" / f"{order.name}.csv").read_text().splitlines()
    other = draw(STRATA["none"], 7, order.index + 10, seconds=2.0)
    assert float(rows[3].split(",")[0]) != pytest.approx(other.trace["command"][2], rel=1e-6)


def test_another_seed_is_not_mixed_in(folder: Path) -> None:
    with pytest.raises(ValueError, match="holds recordings of another seed, count or class"):
        conceal(folder, orders(folder, {"none": 2}, 8, 2.0), Local())


def test_keys_without_their_list_are_somebody_elses(tmp_path: Path) -> None:
    """Mutation: a key that is not ours counts as a recording that is finished."""
    (tmp_path / "keys").mkdir()
    key_file(tmp_path, "r0001").write_text("mine")
    with pytest.raises(ValueError, match=r"holds keys, but no made\.txt; choose another folder"):
        conceal(tmp_path, orders(tmp_path, {"none": 1}, 7, 2.0), Local())
    assert key_file(tmp_path, "r0001").read_text() == "mine"


def test_an_effect_stands_as_high_in_the_recording_as_its_limit_says() -> None:
    """Sigma of the engine's signature, and of the other integrator's recordings, within 10 %.

    Both at 2 times the limit: about 10. Breaks with friction 20 % weaker in the integrator.
    """
    made = draw(STRATA["single_2x"], 7, 3, NAMES.index("coulomb_friction"), seconds=4.0)
    (hidden,) = made.hidden
    assert made.nominal.interface.encoder_step == 0.0
    device = made.rig.device.without_physics()
    bare = seen(record(made.rig.without_physics()).trace, device)
    known = reference(device, [bare])
    model = Model(device)
    there = Problem([seen(made.trace, device)], known.problem.observer)
    moved = there.weighted(model, np.zeros(model.linear_count)) - known.base
    padded = np.concatenate([moved, np.zeros(known.jacobian.shape[0] - moved.size)])
    stands = np.linalg.norm(known.off(hidden.effect)(padded))
    assert stands == pytest.approx(hidden.sigma, rel=0.1)
    assert hidden.sigma == pytest.approx(10.0, rel=0.1)


@pytest.mark.parametrize("index", [5, 7])
def test_lost_commands_are_there_to_be_seen(index: int) -> None:
    """Few of them may all fall where the command stands still, and then nothing is concealed.

    Mutation that breaks it: a rig kept whatever was lost.
    """
    made = draw(STRATA["single_2x"], 7, index, NAMES.index("dropped_samples"), seconds=2.0)
    (hidden,) = made.hidden
    assert hidden.effect == "dropped_samples"
    device = made.rig.device.without_physics()
    known = reference(device, [seen(record(made.rig.without_physics()).trace, device)])
    lost = record(made.rig).lost
    for mask, low, high in ((lost, 0.5, 2.0), (np.zeros_like(lost), 0.0, 0.1)):
        recorded = replace(seen(made.trace, made.rig.device), dropped=mask)
        (stands,) = as_made(known, recorded, made.rig.device.physics)
        assert low * hidden.sigma <= stands <= high * hidden.sigma


def test_what_is_in_no_library_stands_out() -> None:
    """5 to 50 times the strength at five sigma, as seen on the recordings themselves."""
    made = draw(STRATA["unknown"], 9, 4, list(OUTSIDE).index("hum"), seconds=2.0)
    assert made.rig.outside is not None
    assert made.rig.outside.name == "hum"
    assert made.rig.device.physics == ()
    (hidden,) = made.hidden
    assert 5.0 <= hidden.times_limit <= 50.0
    assert hidden.sigma == pytest.approx(5.0 * hidden.times_limit, rel=0.1)


def test_several_effects_are_of_several_kinds() -> None:
    """Each effect once, one friction law per mass; breaks where the masses are not looked at."""
    device = phantom()
    for seed in range(200):
        random = np.random.default_rng(seed)
        several = chosen(STRATA["three_5x"], "coulomb_friction", random, device)
        assert several[0][0] == "coulomb_friction"
        assert len({name for name, _ in several}) == 3
        assert set(several) <= set(places(device))
        dry = [at for name, at in several if EFFECTS[name].family]
        assert len(set(dry)) == len(dry)


def test_every_effect_can_be_drawn_for_a_device_that_hardly_moves() -> None:
    """A link's coefficient of 1e17 stopped a whole exam.

    Mutation that breaks it: values not held within the effect's bounds.
    """
    device, random = phantom(), np.random.default_rng(1)
    still = Motion(1e-3, 2e-3, 1e-9, 1e-12, 3e-12, 2e-12, (1e-12, 1e-12))
    for name, at in places(device):
        assert draw_physics(random, name, at, device, still).effect.name == name


@pytest.mark.parametrize("changed", ["key", "salt", "recording", "device", "seal"])
def test_a_change_is_found(folder: Path, tmp_path: Path, changed: str) -> None:
    """One character of key, salt, recording, device file or seal."""
    made = copied(folder, tmp_path)
    (made / "answers").mkdir()
    name = "r0001"
    files = recording_files(made, name)
    digests = {"sha256": dict.fromkeys(files, "")}
    (made / "answers" / f"{name}.json").write_text(json.dumps(digests))
    if changed in files:
        text = files[changed].read_text()
        files[changed].write_text(text.replace("0", "1", 1))
    elif changed == "seal":
        path = made / "recordings" / f"{name}.toml"
        text = path.read_text()
        seal_at = text.index("SHA-256 ") + len("SHA-256 ")
        digit = "0" if text[seal_at] != "0" else "1"
        path.write_text(text[:seal_at] + digit + text[seal_at + 1 :])
    else:
        stored = json.loads(key_file(made, name).read_text())
        if changed == "salt":
            stored["salt"] = "00" + stored["salt"][2:]
        else:
            stored["key"]["noise"]["measurement"] *= 1.0000001
        key_file(made, name).write_text(json.dumps(stored))
    with pytest.raises(SealError, match=r"was changed after|does not match the seal"):
        open_seal(made, name)


def test_an_answer_to_another_recording_is_found(folder: Path, tmp_path: Path) -> None:
    made = copied(folder, tmp_path)
    (made / "answers").mkdir()
    answer = {"sha256": {"recording": "0" * 64}}
    (made / "answers" / "r0001.json").write_text(json.dumps(answer))
    with pytest.raises(SealError, match=r"is about another r0001\.csv"):
        open_seal(made, "r0001")


def test_a_seal_does_not_depend_on_the_order_of_names() -> None:
    """SHA-256 over salt and canonical JSON: printf '\\x00\\xff{"a":1}' | sha256sum."""
    assert seal("00ff", {"a": 1}).startswith("ec29070a3e6876d2")
    assert canonical({"b": 1.5, "a": [None, True]}) == b'{"a":[null,true],"b":1.5}'
    assert seal("00ff", {"a": 1, "b": 2}) == seal("00ff", {"b": 2, "a": 1})
    assert seal("00ff", {"a": 1}) != seal("00fe", {"a": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical({"a": math.nan})


def answered(*findings: dict[str, Any], verdict: str = "identified") -> dict[str, Any]:
    refit = {"m1": {"nominal": 1.0, "value": 1.1, "ci95": [1.0, 1.2]}}
    said = {"verdict": verdict, "findings": list(findings), "linear_refit": refit}
    return {"diagnosis": said, "seconds": 4.0, "core_seconds": 4.0, "samples": 10000}


def finding(effect: str, at: str, rivals: dict[str, float], **parameters: Any) -> dict[str, Any]:
    return {
        "effect": effect, "at": at, "separation_sigma": 20.0,
        "parameters": {k: {"value": v[0], "ci95": v[1]} for k, v in parameters.items()},
        "rivals": [
            {"effect": label.split("@")[0], "at": label.split("@")[1], "separation_sigma": d}
            for label, d in rivals.items()
        ],
    }  # fmt: skip


def key_of(*hidden: dict[str, Any], stratum: str = "single_5x") -> dict[str, Any]:
    return {"recording": "r1", "stratum": stratum, "hidden": list(hidden), "outside": None}


def test_marks() -> None:
    """First where it stands apart, in the class elsewhere; the rest is a claim."""
    right = finding("coulomb_friction", "m1", {}, level=(0.0101, [0.009, 0.011]))
    wrong = finding("dead_band", "command", {"coulomb_friction@m1": 3.0, "backlash@link12": 6.0})
    other = finding("constant_force", "m1", {})
    m = mark(key_of(FRICTION), answered(right, other), {"m1": 1.15, "b1": 2.0})
    assert m.effects[0].apart
    assert m.effects[0].right
    assert m.effects[0].first
    assert dict(m.effects[0].inside) == {"level": True}
    assert m.claims == ("constant_force@m1",)
    assert m.linear == {"m1": True}
    m = mark(key_of(FRICTION), answered(wrong), {"m1": 1.3})
    assert not m.effects[0].right
    assert m.effects[0].in_class
    assert m.claims == ()
    assert m.linear == {"m1": False}
    near = FRICTION | {"rivals": {"dead_band@command": 4.0}}
    assert mark(key_of(near), answered(wrong), {}).effects[0].right
    same = FRICTION | {"rivals": {"dead_band@command": 1e-9}}
    m = mark(key_of(same), answered(finding("dead_band", "command", {})), {})
    assert m.right  # no recording tells them apart
    assert m.effects[0].first
    failed = {"diagnosis": None, "seconds": 1.0, "core_seconds": 1.0, "samples": 9, "error": "..."}
    assert mark(key_of(FRICTION), failed, {}).verdict == "error"


def test_a_richer_rival_does_not_count_but_a_simpler_one_does() -> None:
    assert stands_apart(FRICTION)
    richer = FRICTION | {"effect": "stribeck_friction", "rivals": {"coulomb_friction@m1": 0.1}}
    assert not stands_apart(richer)
    elsewhere = FRICTION | {"rivals": {"stribeck_friction@m2": 0.1}}
    assert not stands_apart(elsewhere)


def test_an_angle_is_inside_by_whole_turns() -> None:
    """Breaks where a phase is compared as a plain number."""
    ripple = FRICTION | {"effect": "force_ripple", "values": {"phase": 3.1}, "rivals": {}}
    found = finding("force_ripple", "m1", {}, phase=(-3.15, [-3.3, -3.0]))
    assert mark(key_of(ripple), answered(found), {}).effects[0].inside == {"phase": True}
    found = finding("force_ripple", "m1", {}, phase=(-2.9, [-3.0, None]))
    assert mark(key_of(ripple), answered(found), {}).effects[0].inside == {"phase": False}


@pytest.mark.parametrize(
    ("right", "count", "reached"),
    [(2, 2, "too few to tell"), (19, 20, "yes"), (0, 2, "**no**"), (100, 100, "**no**")],
)
def test_a_goal_with_two_sides_needs_enough_to_tell(right: int, count: int, reached: str) -> None:
    """Breaks where two of two miss 92 to 98 % for certain; and no table is written of nothing."""
    silent = mark(key_of(stratum="none"), answered(verdict="nothing_missing"), {})
    found = tally([silent], {}) | {"coverage_counts": Share(right, count).as_json()}
    (row,) = (r for r in goals(found) if r[1] == "92 to 98 %")
    assert row[3] == reached
    pictures = {"magnitude": "a.png", "confusion": "b.png"}
    facts = {"command": "zwidth exam", "seed": 1, "length": "2 s"}
    assert "| in no library | named" not in page(found | {"marks": []}, facts, pictures)


@pytest.mark.parametrize(
    ("wrong", "count", "reached"),
    [(0, 1, "too few to tell"), (0, 20, "yes"), (1, 1, "**no**"), (1, 20, "**no**")],
)
def test_none_of_one_reaches_no_goal(wrong: int, count: int, reached: str) -> None:
    """A false claim in 0 of 1 says nothing of 2 %; 1 of 1 does.

    Breaks where a share of one subject counts like one of a hundred.
    """
    silent = mark(key_of(stratum="none"), answered(verdict="nothing_missing"), {})
    found = tally([silent], {})
    found["none"]["false_claims"] = Share(wrong, count).as_json()
    (row,) = (r for r in goals(found) if r[0] == "nothing concealed: an effect claimed")
    assert row[3] == reached


def test_tally() -> None:
    """Counts by hand, with the exact intervals of 0 of 100 and 1 of 2."""
    nothing = answered(verdict="nothing_missing")
    claim = answered(finding("backlash", "link12", {}))
    marks = [mark(key_of(stratum="none"), nothing, {}) for _ in range(99)]
    marks.append(mark(key_of(stratum="none"), claim, {}))
    right = finding("coulomb_friction", "m1", {}, level=(0.0101, [0.009, 0.011]))
    marks.append(mark(key_of(FRICTION), answered(right), {}))
    marks.append(mark(key_of(FRICTION), answered(finding("backlash", "link12", {})), {}))
    hum = key_of(stratum="unknown") | {"outside": {"name": "hum"}}
    marks.append(mark(hum, answered(verdict="unknown_physics"), {}))
    found = tally(marks, {"r1": HeldOut(1.0, 0.5, 0.11, 0.1)})
    assert found["false_claims"] == 0.01
    single = found["classes"]["single_5x"]["right_where_apart"]
    assert (single["right"], single["count"]) == (1, 2)
    assert single["ci95"] == pytest.approx([0.01258, 0.98742], abs=1e-5)
    assert found["by_effect"]["coulomb_friction"]["taken_for"] == {"backlash": 1}
    assert found["confusion"] == {
        "rows": ["coulomb_friction"],
        "columns": ["coulomb_friction", "backlash", "unknown", "nothing"],
        "counts": [[1, 1, 0, 0]],
    }
    assert found["unknown"]["said_so"]["share"] == 1.0
    assert found["coverage"] == 1.0
    assert found["held_out"]["share"]["median"] == pytest.approx(0.89 / 0.9)
    assert found["held_out"]["share_beyond_refit"]["median"] == pytest.approx(0.39 / 0.4)
    low, high = Share(0, 100).interval or (1.0, 1.0)
    assert (low, high) == (0.0, pytest.approx(1.0 - 0.025**0.01))
    assert ratio(Share(1, 2).as_json()) == "50.0 % (1 of 2; 1.3 to 98.7 %)"


def test_perfect_knowledge_that_is_worth_nothing_has_no_share() -> None:
    assert HeldOut(1.0, 1.0, 0.5, 0.99).share is None


def test_counts() -> None:
    assert sum(counts(200).values()) == 200
    assert counts(300)["none"] >= 100
    assert counts(0, "none=3, two_5x=1,none=1") == {"none": 4, "two_5x": 1}
    for text, sentence in (
        ("nothing=3", "strata has 'nothing'; its classes are none, single_2x"),
        ("none=x", "strata has 'none=x'; give NAME=COUNT"),
    ):
        with pytest.raises(ValueError, match=sentence):
            counts(0, text)
    with pytest.raises(ValueError, match="count is 0"):
        counts(0)


def test_linear_truth_has_the_names_of_a_refit() -> None:
    chain = make_chain([1.0, 2.0], [0.1, 0.2], 3.0, [4.0], [5.0])
    assert linear_truth(chain) == {
        "m1": 1.0, "m2": 2.0, "b1": 0.1, "b2": 0.2, "k12": 4.0, "b12": 5.0, "k0": 3.0, "gain": 1.0
    }  # fmt: skip


def test_an_exam_goes_on_where_it_stopped(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Answers that are there are kept, those that are missing come; then all is marked."""
    made = copied(folder, tmp_path)
    taken = silent(monkeypatch)
    assert sit_all(made, Local()) == ["r0001", "r0002"]
    assert taken == [2000, 2000]
    (made / "answers" / "r0002.json").unlink()
    sit_all(made, Local())
    assert len(taken) == 3
    marks, fits = mark_all(made, ["r0001", "r0002"], Local())
    by_class = {m.stratum: m for m in marks}
    assert by_class["none"].verdict == "nothing_missing"
    assert not by_class["single_5x"].effects[0].found
    for errors in fits.values():  # the answer is the device file itself
        assert errors.after == pytest.approx(errors.before, rel=1e-9)


def test_the_command(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It writes result, page and pictures, and says what was reached."""
    made = copied(folder, tmp_path)
    silent(monkeypatch)
    page = tmp_path / "evidence.md"
    done = CliRunner().invoke(zwidth, ["exam", str(made), "--page", str(page)])
    assert done.exit_code == 0, done.output
    found = json.loads((made / "exam.json").read_text())
    assert found["recordings"] == 2
    assert found["false_claims"] == 0.0
    text = page.read_text()
    assert "--strata none=1,single_5x=1 --seed 7 --seconds 2.0" in text
    for picture in ("evidence_confusion.png", "evidence_magnitude.png"):
        assert f"({picture})" in text
        assert (tmp_path / picture).stat().st_size > 1000


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(zwidth, ["exam", str(tmp_path)])
    assert isinstance(done.exception, ValueError)
    assert "holds no concealed recordings" in str(done.exception)


def test_a_diagnosis_that_fails_is_an_answer(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(device: Any, experiments: Any) -> Answer:
        raise ZeroDivisionError("no")

    monkeypatch.setattr(sitting, "diagnose", fails)
    answer = sitting.sit(sitting.Paper(str(folder), "r0001"))
    assert answer["diagnosis"] is None
    assert answer["error"] == "ZeroDivisionError: no"


def test_an_order_has_a_place_of_its_own() -> None:
    asked = orders(Path("x"), {"none": 30, "two_5x": 10}, 1)
    assert len({o.name for o in asked}) == 40
    assert sorted(o.rank for o in asked if o.stratum == "two_5x") == list(range(10))
    firsts = [o.stratum for o in asked[:20]]
    assert 2 <= firsts.count("two_5x") <= 8  # classes come mixed
