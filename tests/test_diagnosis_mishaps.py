"""Nothing found is lost: an error in one stage of a diagnosis costs that stage alone."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zwidth.diagnosis.answer.stands
import zwidth.diagnosis.diagnose
from zwidth.cli import run
from zwidth.diagnosis.answer.result import Diagnosis, NotDiagnosed, Verdict
from zwidth.diagnosis.answer.verdict import Left
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.fitting.descend import descend
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.intake.gate import Suspicion
from zwidth.diagnosis.mishaps import Mishaps, collecting, isolated, silent
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import likeliest
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError, Output
from zwidth.diagnosis.selection.effort import NORMAL, QUICK
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.selection.moves import Move, shown
from zwidth.diagnosis.selection.search import Moves, Search, fitted, search
from zwidth.diagnosis.selection.searched import Searched, as_found, unnamed
from zwidth.diagnosis.settings import PURSUIT
from zwidth.planning.excitations import Scale, excitation
from zwidth.planning.rehearsal import Noise, rehearse
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import save_device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics

MASS = Device("mass", "", True, make_chain([1e-3], [5e-3]), Interface(period=0.001, delay=0.0))
FRICTION = make_physics("coulomb_friction", "m1", level=3e-3)
BAND = make_physics("dead_band", "command", width=3e-3)
POSITION, VELOCITY = Output("position", 0), Output("velocity", 0)
TOML = """
file = "{name}.csv"
rotary = true
period_s = 0.001
[input]
signal = "u"
unit = "N m"
[[output]]
signal = "y"
unit = "{unit}"
quantity = "{quantity}"
at = "m1"
"""


AUGMENTED = "zwidth.stability.augmented_boundary.augmented_boundary"


class Bug(ValueError):
    """A mistake in the code, of the kind that arrays of other shapes make."""


@pytest.fixture(autouse=True)
def _undrawn(monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction]
    """Figures are made, and not drawn, which takes a second each."""
    monkeypatch.setattr("zwidth.figures.style.picture_bytes", lambda _: b"")


def throw(*_: Any, **__: Any) -> Any:
    raise Bug("shapes (3,) and (4,) do not fit")


def nothing(*_: Any, **__: Any) -> None:
    return None


@cache
def recorded(output: Output = POSITION, name: str = "swing") -> Experiment:
    """A second of a mass with friction."""
    truth = MASS.with_physics(FRICTION)
    command = excitation("small_multisine", MASS, 1.0, Scale(0.1, 2.0), seed=1)
    return rehearse(truth, command, Noise(1e-3, 1e-5), outputs=(output,), seed=2, name=name)


@cache
def searched(output: Output = POSITION) -> Searched:
    """What a search finds, cut short: the friction, and a dead band two sigma behind."""
    e = recorded(output).split()[0]
    plain = settled(judged([e], Model(MASS), np.zeros(Model(MASS).linear_count)))

    def with_effect(effect: Any, scales: dict[str, float]) -> Hypothesis:
        model = plain.model.with_effect(effect, scales)
        return settled(judged([e], model, np.append(plain.x, 0.0)))

    best, other = with_effect(FRICTION, {"level": 3e-3}), with_effect(BAND, {"width": 3e-3})
    behind = replace(best.cost, misfit=best.cost.misfit + 4.0)
    found = Search(plain, best, NORMAL, silent)
    for h in (
        plain,
        best,
        replace(other, cost=behind, blocks=best.blocks + 4.0 / best.blocks.size),
    ):
        found.keep(h)
    return as_found(MASS, found)


def _ending_at_once(patch: pytest.MonkeyPatch) -> None:
    """Let a diagnosis end at once with what `searched` gives, and find nothing left.

    Nor is a reading suspected: which one is likeliest takes a search of its own.
    """
    at = zwidth.diagnosis.answer.stands
    patch.setattr("zwidth.diagnosis.intake.take_in.suspicion", lambda *_: Suspicion())
    patch.setattr(
        zwidth.diagnosis.diagnose, "searched", lambda _, e, *__: searched(e[0].outputs[0])
    )
    patch.setattr(at, "left_over", lambda *_: Left(0.0, ""))
    patch.setattr(at, "instead_of", nothing)
    patch.setattr(
        zwidth.diagnosis.diagnose, "knowing_events", lambda taken, found, *_: (taken, found, ())
    )


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A diagnosis that ends at once."""
    _ending_at_once(monkeypatch)
    return monkeypatch


@cache
def diagnosed() -> Diagnosis:
    with pytest.MonkeyPatch.context() as patch:
        _ending_at_once(patch)
        return diagnose(MASS, [recorded()])


def write(folder: Path, name: str = "swing", output: Output = POSITION) -> None:
    e = recorded(output)
    values = np.column_stack([e.command, e.measured[:, 0]])
    np.savetxt(folder / f"{name}.csv", values, "%.17g", ",", header="u,y", comments="")
    unit = "rad" if output is POSITION else "rad/s"
    text = TOML.format(name=name, unit=unit, quantity=output.quantity)
    (folder / f"{name}.toml").write_text(text)
    save_device(MASS, folder / "known.toml")


LINE = ["diagnose", "swing.toml", "--device", "known.toml", "--out", "o", "--json", "o/r.json"]


def answered(line: list[str], status: int) -> dict[str, Any]:
    """The JSON of a command that ends with a status."""
    assert run(line) == status
    return json.loads(Path("o/r.json").read_text())


@pytest.mark.parametrize(
    ("stage", "where", "verdict"),
    [
        ("detect", "stands.left_over", Verdict.UNDECIDED),
        ("detect", "stands.instead_of", Verdict.UNDECIDED),
        ("separation", "findings.without", Verdict.UNDECIDED),
        ("separation", "findings.rivals", Verdict.UNDECIDED),
        ("held out", "answered.held_out", Verdict.UNDECIDED),
        ("adequacy", "stands.adequacy", Verdict.UNDECIDED),
        ("locate", "answered.locate", Verdict.CONFUSABLE),
        ("intervals", "findings.spans", Verdict.CONFUSABLE),
        ("augmented device", "answered.improved", Verdict.CONFUSABLE),
    ],
)
def test_an_error_after_the_search_costs_its_stage_alone(
    short: pytest.MonkeyPatch, stage: str, where: str, verdict: Verdict
):
    """The friction stays found and is named; a verdict stands where the stage decides nothing.

    Mutations: the stage's `attempt` or `isolated` taken off; `DECISIVE` empty.
    """
    short.setattr(f"zwidth.diagnosis.answer.{where}", throw)
    said: list[str] = []
    found = diagnose(MASS, [recorded()], say=said.append)
    assert [m.stage for m in found.errors][:1] == [stage]
    assert found.findings[0].effect == "coulomb_friction"
    assert found.verdict is verdict
    assert sum("Bug: shapes" in line for line in said) == len(found.errors)
    assert "\n" not in found.errors[0].sentence
    written = found.as_json()["errors"][0]
    assert written["stage"] == stage
    assert written["error"].startswith("Bug: shapes")


def test_an_upper_bound_that_fails_costs_that_one(short: pytest.MonkeyPatch):
    """Whichever stage meets it first says it. Mutation: all bounds inside one `isolated` only."""
    alone = unnamed(searched())
    short.setattr(zwidth.diagnosis.diagnose, "searched", lambda *_: alone)
    short.setattr(Model, "with_effect", _failing_with("dead_band", Model.with_effect))
    at = zwidth.diagnosis.answer.stands
    short.setattr(at, "named_only_whole", lambda *_: False)
    short.setattr(at, "farther", lambda _, found, *__: found)
    short.setattr(at, "next_believed", lambda _: ())
    short.setattr("zwidth.diagnosis.answer.answered._law", lambda *_: (None, False, False))
    answer = diagnose(MASS, [recorded()])
    assert {(m.stage, m.what) for m in answer.errors} == {("limits", "dead_band@command")}
    assert "coulomb_friction@m1" in answer.upper_bounds
    assert "dead_band@command" not in answer.upper_bounds


def _failing_with(name: str, real: Callable[..., Model]) -> Callable[..., Model]:
    def with_effect(model: Model, physics: Any, *rest: Any) -> Model:
        return throw() if physics.effect.name == name else real(model, physics, *rest)

    return with_effect


def _nothing_in_place(_: int) -> Move:
    return lambda _h, _effort: iter(())


ONE = replace(QUICK, effects=1, near=3, far=1, rivals=0, ended=3)
ADDING = Moves(last=(), glancing=(), exchanging=(), replacing=_nothing_in_place)


@pytest.mark.parametrize("when", ["screened", "begun", "ended"])
def test_a_candidate_that_fails_costs_itself_alone(monkeypatch: pytest.MonkeyPatch, when: str):
    """Among the others the friction is found. On threads too, which see who collects errors.

    Mutations: `isolated` taken off the candidates of `screened`, `attempt` off those of `_each`;
    threads without the context of their caller.
    """
    monkeypatch.setenv("ZWIDTH_THREADS", "2")
    monkeypatch.setattr("zwidth.diagnosis.selection.moves.NO_SIGN", -np.inf)
    to_the_end = replace(PURSUIT, hopeless=np.inf)
    monkeypatch.setattr("zwidth.diagnosis.selection.search.PURSUIT", to_the_end)
    all_of_a_view = replace(PURSUIT, rival_share=-np.inf)
    monkeypatch.setattr("zwidth.diagnosis.selection.moves.PURSUIT", all_of_a_view)

    def first(ground: Any, *rest: Any, **more: Any) -> Any:
        return throw() if ground.model.has("gain_asymmetry") else descend(ground, *rest, **more)

    def last(h: Hypothesis, **more: Any) -> Hypothesis:
        return throw() if h.model.has("gain_asymmetry") else settled(h, **more)

    with collecting(silent) as mishaps:
        if when == "screened":
            failing = _failing_with("gain_asymmetry", Model.with_effect)
            monkeypatch.setattr(Model, "with_effect", failing)
        elif when == "begun":
            monkeypatch.setattr("zwidth.diagnosis.selection.moves.descend", first)
        else:
            monkeypatch.setattr("zwidth.diagnosis.selection.search.settled", last)
        every = replace(ONE, near=40, ended=1 if when == "screened" else 40)
        found = search(MASS, [recorded().split()[0]], every, moves=ADDING)
    assert {(m.stage, m.what) for m in mishaps.found} == {("candidates", "gain_asymmetry@command")}
    (name,) = (p.effect.name for p in found.best.model.effects)
    assert name.endswith("friction")
    assert not [labels for labels in found.tried if "gain_asymmetry@command" in labels]


@pytest.mark.parametrize("where", ["search.settled", "hypothesis.likeliest", "searched.as_found"])
def test_without_a_refit_there_is_no_answer_but_a_file_that_says_so(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    where: str,
):
    """Mutation: NotDiagnosed let through without its files."""
    write(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("zwidth.diagnosis.selection.search._grown", nothing)
    monkeypatch.setattr(f"zwidth.diagnosis.selection.{where}", throw)
    answer = answered(LINE, 1)
    assert answer["verdict"] == "undecided"
    stages = [e["stage"] for e in answer["errors"]]  # which reading is likeliest needs one, too
    assert stages[-1] == "refit"
    assert {*stages} <= {"gate", "refit"}
    assert "Bug: shapes" in Path(answer["report"]).read_text(encoding="utf-8")
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("error: nothing can be concluded: refit failed: Bug: shapes")
    assert set(answer) == set(diagnosed().as_json()) | {
        "boundary", "device", "augmented_device", "report", "logs",
    }  # fmt: skip


@pytest.mark.parametrize(("where", "named"), [("_grown", 0), ("_exchanged", 1)])
def test_a_search_that_fails_keeps_what_it_had(
    monkeypatch: pytest.MonkeyPatch, where: str, named: int
):
    """Mutations: `isolated` taken off the rounds of the search; a reading believed whose search
    failed, to which friction without a name is a wrong unit.
    """
    monkeypatch.setattr(f"zwidth.diagnosis.selection.search.{where}", throw)
    monkeypatch.setattr(zwidth.diagnosis.answer.stands, "left_over", lambda *_: Left(0.0, ""))
    monkeypatch.setattr(zwidth.diagnosis.answer.stands, "instead_of", nothing)
    found = diagnose(MASS, [recorded()], effort=ONE)
    assert found.verdict is Verdict.UNDECIDED
    assert found.sentence.startswith("an internal error prevented a part of the search")
    assert [m.stage for m in found.errors] == ["search"]
    assert len(found.findings) == named
    assert all(f.effect.endswith("friction") for f in found.findings)
    assert found.linear_refit["m1"][1].value > 0.0


def test_an_interrupted_search_keeps_what_it_had(monkeypatch: pytest.MonkeyPatch):
    """And says that it was. Mutation: an interruption let through, or taken for an end."""

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("zwidth.diagnosis.selection.search._exchanged", interrupted)
    said: list[str] = []
    found = search(MASS, [recorded().split()[0]], ONE, said.append)
    assert found.interrupted
    (label,) = found.best.labels
    assert label.endswith("friction@m1")
    assert said[-1].startswith("interrupted")


def test_one_recording_of_several_that_fails_costs_itself_alone(
    tmp_path: Path, short: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """One cannot be read, one not judged; the log is that of the third. Alone, none is spared.

    Mutations: `isolated` taken off the reading; `left_out` not taken off the paths.
    """
    short.chdir(tmp_path)
    write(tmp_path)
    write(tmp_path, "odd")
    (tmp_path / "gone.toml").write_text('file = "gone.csv"')

    def suspected(_: Device, e: Experiment) -> Any:
        return throw() if e.name == "odd" else Suspicion()

    short.setattr("zwidth.diagnosis.intake.take_in.suspicion", suspected)
    short.setattr("zwidth.planning.separating.separating", nothing)
    short.setattr(AUGMENTED, nothing)
    answer = answered(["diagnose", "gone.toml", "odd.toml", *LINE[1:]], 0)
    stages = [(e["stage"], e["what"]) for e in answer["errors"]]
    assert stages == [("recording", "gone.toml"), ("gate", "odd")]
    assert [Path(p).name for p in answer["logs"]] == ["swing.diagnosis.mcap"]
    assert "warning: recording (gone.toml) failed: " in capsys.readouterr().err
    assert run(["diagnose", "gone.toml", *LINE[2:]]) == 2
    assert run(["diagnose", "odd.toml", *LINE[2:]]) == 1


@pytest.mark.parametrize(
    ("stage", "where", "status"),
    [
        ("next experiment", "planning.separating.separating", 0),
        ("boundary", "stability.augmented_boundary.augmented_boundary", 0),
        ("picture", "figures.diagnosis.whole_run_figure", 0),
        ("picture", "figures.diagnosis.residual_figure", 0),
        ("picture", "figures.augmented_boundary.augmented_boundary_figure", 0),
        ("log", "diagnose_files.diagnosis_trace", 1),
        ("augmented device", "diagnose_files.commented_text", 1),
        ("report", "diagnosis_report.page", 1),
    ],
)
def test_an_error_in_what_follows_leaves_all_other_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stage: str, where: str, status: int
):
    """Exit status 1 where a file that was promised is missing.

    Mutations: `isolated` taken off the stage; errors of pictures not shown in the report.
    """
    write(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("zwidth.diagnose_files.diagnose", lambda *_: diagnosed())
    monkeypatch.setattr("zwidth.planning.separating.separating", nothing)
    monkeypatch.setattr(AUGMENTED, nothing)
    if where.endswith("augmented_boundary_figure"):
        monkeypatch.setattr(AUGMENTED, _no_boundary)
    monkeypatch.setattr(f"zwidth.{where}", throw)
    answer = answered(LINE, status)
    assert [e["stage"] for e in answer["errors"]] == [stage]
    assert answer["verdict"] == diagnosed().verdict.value
    files = {"augmented device": "augmented_device", "report": "report", "log": "logs"}
    for name, key in files.items():
        assert bool(answer[key]) == (name != stage)
    if stage not in ("report",):
        page = Path(answer["report"]).read_text(encoding="utf-8")
        assert "What failed" in page
        assert "Bug: shapes" in page


def _no_boundary(*_: Any) -> Any:
    from zwidth.stability.augmented_boundary import AugmentedBoundary

    return AugmentedBoundary((), (), (), 1e-3, True, 0.0, "it stays")


def test_what_was_found_is_written_before_what_takes_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """When the next experiment is sought, device, report and JSON are there already.

    Mutation: the first writing of report or JSON left out.
    """
    write(tmp_path)
    monkeypatch.chdir(tmp_path)
    there: list[str] = []

    def separating(*_: Any) -> None:
        there.extend(sorted(path.name for path in Path("o").glob("[!.]*")))
        raise KeyboardInterrupt

    monkeypatch.setattr("zwidth.diagnose_files.diagnose", lambda *_: diagnosed())
    monkeypatch.setattr("zwidth.planning.separating.separating", separating)
    answer = answered(LINE, 130)
    ends = ["augmented.toml", "diagnosis.html", "diagnosis.mcap"]
    assert there == ["r.json", *(f"swing.{end}" for end in ends)]
    assert answer["findings"][0]["effect"] == "coulomb_friction"
    assert answer["errors"] == []


def test_a_velocity_alone_gets_a_next_experiment(
    tmp_path: Path, short: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Nothing says where a free mass stands, and nothing has to.

    Mutation: `_stands_unseen` False.
    """
    write(tmp_path, output=VELOCITY)
    short.chdir(tmp_path)
    short.setattr(AUGMENTED, nothing)
    short.setattr("zwidth.planning.next_experiment.SHORTEST_S", 4.0)
    short.setattr("zwidth.planning.next_experiment.LIBRARY", ["small_multisine"])
    answer = answered(LINE, 0)
    assert answer["errors"] == []
    assert answer["next_experiment"]["separates"] == ["coulomb_friction@m1", "dead_band@command"]
    assert Path(answer["next_experiment"]["scenario"]).exists()
    assert "Coulomb friction at m1 from a dead band in the command" in capsys.readouterr().out


def test_a_friction_beside_a_fast_mode_is_searched():
    """A mode of 715 Hz at 1 kHz, where one substep per tick is too long for friction.

    Mutation: `prepared` without the substeps that are needed.
    """
    stiff = fast_mode(715.0)
    truth = stiff.with_physics(make_physics("coulomb_friction", "m2", level=3e-3))
    command = excitation("small_multisine", stiff, 0.6, Scale(0.1, 2.0), seed=1)
    e = rehearse(truth, command, Noise(1e-3, 1e-5), seed=2)
    plain = settled(judged([e], Model(stiff), np.zeros(Model(stiff).linear_count)))
    rubbed = [p for p in shown(plain, replace(ONE, near=40)) if p.model.has("coulomb_friction")]
    found = fitted(Search(plain, plain, ONE, silent), rubbed, 1)[0]
    level = found.model.build(found.x).physics[0].values["level"]
    assert level == pytest.approx(3e-3, rel=0.5)
    assert found.cost.total < plain.cost.total - 22.0


def fast_mode(hertz: float, tip: float = 1e-4) -> Device:
    masses = [1e-3, tip]
    stiffness = (2.0 * np.pi * hertz) ** 2 * masses[0] * masses[1] / sum(masses)
    chain = make_chain(masses, [5e-3, 0.0], 0.0, [stiffness], [100.0 * tip])
    return Device("stiff", "", True, chain, Interface(period=0.001))


def test_a_model_that_no_kernel_follows_is_no_mistake():
    """A mode so fast that friction needs more substeps than are taken: the worst residual, no end.

    Mutation: `Many` without `MOST_SUBSTEPS`.
    """
    light = fast_mode(200750.0, tip=1e-9)
    absurd = light.with_physics(make_physics("coulomb_friction", "m2", level=3e-3))
    problem = Problem([recorded()], searched().problem.observer)
    model = Model(absurd)
    with pytest.raises(NoObserver):
        likeliest([recorded()], model, np.zeros(model.linear_count))
    assert np.all(problem.weighted(model, np.zeros(model.linear_count)) == 1e6)


def test_a_recording_of_no_use_is_the_user_s_to_change(monkeypatch: pytest.MonkeyPatch):
    """No observer at all is a sentence about the recording. Mutation: NoObserver let through."""

    def none(*_: Any) -> Any:
        raise NoObserver("no observer follows this recording")

    monkeypatch.setattr("zwidth.diagnosis.intake.take_in.suspicion", lambda *_: Suspicion())
    monkeypatch.setattr(zwidth.diagnosis.diagnose, "searched", none)
    with pytest.raises(ExperimentError, match="no observer follows"):
        diagnose(MASS, [recorded()])


def test_errors_go_through_where_nobody_collects_them_or_somebody_looks_for_them(
    monkeypatch: pytest.MonkeyPatch,
):
    """Mutation: `debugging` False."""
    with pytest.raises(Bug), isolated("stage"):
        throw()
    with pytest.raises(KeyboardInterrupt), collecting(silent), isolated("stage"):
        raise KeyboardInterrupt
    monkeypatch.setattr("zwidth.diagnosis.selection.search.settled", throw)
    with pytest.raises(NotDiagnosed):
        diagnose(MASS, [recorded()])
    monkeypatch.setenv("ZWIDTH_DEBUG", "1")
    with pytest.raises(Bug):
        diagnose(MASS, [recorded()])


def test_an_error_is_named_once_and_inner_collectors_are_the_outer_one():
    """Mutation: a collector inside another keeps its errors to itself."""
    said: list[str] = []
    with collecting(said.append) as outer:
        for _ in range(2):
            with collecting(silent) as inner:
                assert inner is outer
                with isolated("picture", "residual"):
                    throw()
    assert isinstance(outer, Mishaps)
    assert said == ["picture (residual) failed: Bug: shapes (3,) and (4,) do not fit"]
