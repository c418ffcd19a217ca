"""What findings are worth, what is of no consequence, and a fit that ended badly."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fitting_examples import drive
from sampled import Sampled

from zwidth.diagnosis.answer.consequence import Worth, may_be_nothing
from zwidth.diagnosis.answer.result import Estimate, Finding, Verdict
from zwidth.diagnosis.answer.stands import ends_badly
from zwidth.diagnosis.answer.verdict import Facts, Left
from zwidth.diagnosis.answer.words import negligible_in_words, why, worth_in_words
from zwidth.diagnosis.model.parameters import Model
from zwidth.exam.mark import mark


def finding(lower: float, upper: float, effect: str = "coulomb_friction") -> Finding:
    name = {"coulomb_friction": "level", "gain_asymmetry": "ratio"}[effect]
    middle = Estimate(0.5 * (lower + upper), lower, upper, "N m")
    return Finding(effect, "m1", {name: middle}, 9.0, ())


@pytest.mark.parametrize(
    ("lower", "upper", "effect", "nothing"),
    [
        (0.01, 0.02, "coulomb_friction", False),
        (-0.01, 0.02, "coulomb_friction", True),
        (0.9, 1.1, "gain_asymmetry", True),  # none of an asymmetry is a ratio of one
        (1.05, 1.1, "gain_asymmetry", False),
    ],
)
def test_what_an_interval_lets_be_nothing(
    lower: float, upper: float, effect: str, nothing: bool
) -> None:
    """Mutation: nothing taken for zero everywhere."""
    assert may_be_nothing(finding(lower, upper, effect)) is nothing


@pytest.mark.parametrize(("times", "sigma"), [(0.46, -1.2), (0.9, 0.0), (0.999, -0.1), (1.54, 0.9)])
def test_what_held_out_data_do_without(times: float, sigma: float) -> None:
    """One that held-out motion does not excite is worth nothing there, and stays.

    Mutations: the interval alone; the sign of sigma alone.
    """
    known = replace(finding(0.01, 0.02), worth=Worth(times, sigma, 0.5))
    assert may_be_nothing(known) is (sigma < 0.0 and times < 0.98)


@pytest.mark.parametrize(
    ("times", "sigma"), [(51.3, 11.7), (51.3, 1.0), (1.05, 4.0), (0.998, -0.2)]
)
def test_what_free_runs_need_is_not_nothing(times: float, sigma: float) -> None:
    """Though its interval contains zero. Mutations: the interval alone; two sigma."""
    known = replace(finding(-0.01, 0.02), worth=Worth(times, sigma, 0.5))
    assert may_be_nothing(known) is not (times > 1.0 and sigma > 5.0)


@pytest.mark.parametrize(("least", "nothing"), [(0.002, False), (-0.001, True)])
def test_friction_that_holds_at_rest_is_something(least: float, nothing: bool) -> None:
    """Though none may be left in motion. Mutation: the first of its magnitudes alone."""
    level, rest = Estimate(1e-3, -1e-3, 3e-3, "N m"), Estimate(3e-3, least, 6e-3, "N m")
    values = {"level": level, "static_level": rest, "velocity": Estimate(0.3, 0.1, 0.5, "rad/s")}
    assert may_be_nothing(Finding("stribeck_friction", "m2", values, 9.0, ())) is nothing


def test_worth_and_no_consequence_in_words() -> None:
    f = finding(0.01, 0.02)
    assert worth_in_words(f) == ""
    paid = replace(f, worth=Worth(2.1, 5.0, 0.5))
    assert worth_in_words(paid).endswith("0.5 s on held-out data is 2.1 times as large")
    little = replace(f, worth=Worth(1.04, 3.0, 0.5))
    assert worth_in_words(little).endswith("is 4 % larger")
    chance = replace(f, worth=Worth(1.04, 1.0, 0.5))
    assert worth_in_words(chance).endswith("no more than chance")
    assert negligible_in_words([], 1) == ""
    assert negligible_in_words([f], 1) == (
        "detected, but too small to matter: Coulomb friction of 15 mN m (10 to 20) at the motor"
    )  # with its interval, as no table has it


def test_a_diagnosis_says_what_its_finding_is_worth(sampled: Sampled) -> None:
    """Of the shipped sample. Mutations: the refit's own error; held out not judged."""
    found = sampled.found
    assert {f.effect for f in found.findings} == {"stribeck_friction", "gravity_pendulum"}
    for one, said in zip(found.findings, sampled.answer["findings"], strict=True):
        assert one.worth is not None
        assert one.worth.pays
        assert one.worth.times > 1000.0
        assert said["worth"] == {k: getattr(one.worth, k) for k in ("times", "sigma", "horizon")}
    assert sampled.answer["negligible"] == []


def test_what_is_negligible_is_no_claim_and_is_seen_all_the_same() -> None:
    """Mutation: the list left out of what is named."""
    key = {
        "recording": "r", "stratum": "single_2x", "outside": None,
        "hidden": [{"effect": "coulomb_friction", "at": "m1", "sigma": 10.0, "values": {},
                    "rivals": {}}],
    }  # fmt: skip
    seen = finding(-0.01, 0.02).as_json()
    for findings, negligible, claims, named in (
        ([], [seen], (), True), ([seen], [], (), True), ([], [], (), False),
    ):  # fmt: skip
        answer = {
            "diagnosis": {"verdict": "x", "findings": findings, "negligible": negligible},
            "seconds": 1.0, "core_seconds": 1.0, "samples": 1,
        }  # fmt: skip
        m = mark(key, answer, {})
        assert (m.claims, m.all_named) == (claims, named)


def fit(**moved: float) -> Any:
    model = Model(drive())
    names = [p.name for p in model.linear]
    x = np.zeros(len(names))
    for name, value in moved.items():
        x[names.index(name)] = value
    return SimpleNamespace(model=model, x=x)


def error(refit: float, after: float, held_out: bool = True) -> Any:
    return SimpleNamespace(errors={"refit": refit, "after": after}, held_out=held_out)


def test_a_fit_that_ended_badly() -> None:
    """Mutations: a damper of nothing taken for an end; what was fitted asked; whole runs first."""
    assert ends_badly(fit(), (), ()) == ""
    assert ends_badly(fit(m1=5.0), (), ()).startswith(
        "the fit ends with m1 at the limit of its allowed range"
    )
    assert ends_badly(fit(k12=-5.0), (), ()) != ""
    least = next(p.lower for p in Model(drive()).linear if p.name == "b1")
    assert ends_badly(fit(b1=least), (), ()) == ""
    assert "force" in ends_badly(fit(), (), (error(0.57, 1.24),))
    assert ends_badly(fit(), (), (error(0.57, 1.24), error(0.5, 0.2))) == ""
    assert ends_badly(fit(), (), (error(0.57, 1.24, held_out=False),)) == ""
    assert ends_badly(fit(), (error(1.0, 2.0),), (error(0.5, 0.2),)) == ""
    assert "free run" in ends_badly(fit(), (error(1.0, 2.0),), ())
    assert ends_badly(fit(), (error(1.0, 1.2),), ()) == ""


@pytest.mark.parametrize(("others", "bad"), [((1.6, 3.0), True), ((1.6, 1.4), False)])
def test_a_whole_run_may_be_worse_by_chance(others: tuple[float, ...], bad: bool) -> None:
    """If parameters within their uncertainty do better. Mutation: none is drawn."""
    drawn = [(error(1.0, after),) for after in others]
    assert bool(ends_badly(fit(), (error(1.0, 2.0),), (), lambda: drawn)) is bad


def test_such_a_fit_is_no_answer() -> None:
    facts = Facts((finding(0.01, 0.02),), {}, Left(0.0, ""), bad="it is far")
    assert facts.verdict is Verdict.UNKNOWN_PHYSICS
    assert why(facts) == "it is far"
