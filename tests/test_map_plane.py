"""A plane and the fates in it: axes, what is refused, and answers known beforehand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from engine_examples import coulomb, phantom

from zwidth.sim.fate import Conditions, Fate, fates_of
from zwidth.sim.growth import DECAYS, GROWS, LIMIT_CYCLE, UNDECIDED, Growth
from zwidth.sim.perception import Perception
from zwidth.sim.physics import make_physics
from zwidth.stability.fate_map import make_map, save_map
from zwidth.stability.fates import evaluate
from zwidth.stability.judging import Trial
from zwidth.stability.linear import critical_stiffness
from zwidth.stability.map_summary import summary
from zwidth.stability.plane import Axis, Plane, with_friction

K, B = Axis("K", 1.0, 50.0), Axis("B", 0.0, 0.12)
STEP = 1e-4


def plane(**changes: object) -> Plane:
    """Return a plane of the PHANToM, K over B, with runs of 1 to 4 s."""
    return replace(Plane(phantom(), B, K, trial=Trial(1e-3, 2.0, 8.0, 0.25)), **changes)  # pyright: ignore[reportArgumentType]


def test_without_nonlinearity_the_map_is_the_linear_boundary() -> None:
    """1 % below K_CR all rest, 1 % above all grow, at nine dampings on both sides of the corner.

    Mutation: `linear_radius` with the delay of another device: the second half fails.
    """
    dampings = np.array([0.0, 0.02, 0.04, 0.06, 0.08, 0.085, 0.09, 0.094, 0.097])
    critical = np.array([critical_stiffness(phantom(), b).stiffness for b in dampings], dtype=float)
    below = evaluate(plane(), dampings, 0.99 * critical)
    above = evaluate(plane(), dampings, 1.01 * critical)
    assert set(below.fate) == {Fate.RESTS}
    assert set(above.fate) == {Fate.GROWS}
    found = make_map(plane(), 17, 0)
    clear = np.abs(found.linear) > 1e-4
    np.testing.assert_array_equal(
        (found.fates.fate == Fate.RESTS)[clear], (found.linear < 0.0)[clear]
    )


def test_a_limit_holds_growth_and_only_growth() -> None:
    """Above K_CR the command swings from limit to limit, two-sided and, pressed on, one-sided.

    Mutation: half the limit not taken for a one-sided wall: its cycles are no growth.
    """
    limited = phantom().with_interface(command_limit=0.1)
    pressed = limited.with_physics(make_physics("constant_force", "m1", level=0.02))
    for device, one_sided in ((limited, False), (pressed, True)):
        some = plane(device=device, one_sided=one_sided)
        found = evaluate(some, np.array([0.03, 0.03]), np.array([5.0, 20.0]))
        assert list(found.fate) == [Fate.RESTS, Fate.GROWS]
        assert found.force[1] == pytest.approx(0.05 if one_sided else 0.1, rel=1e-3)


def test_a_cycle_at_the_limit_that_settles_is_growth() -> None:
    """Right of the corner, limit 0.5 N m: the cycle falls a little for longer than a run lasts.

    Mutation: `held & ~decays` in `fates_of`: some of the points rest.
    """
    device = phantom().with_interface(command_limit=0.5)
    some = Plane(device, B, K)
    b, k = np.meshgrid([0.086, 0.0875, 0.089], [36.5, 37.5, 38.0])
    above = np.array([critical_stiffness(device, x).stiffness or 0.0 for x in b.ravel()])
    assert np.all(above < k.ravel())
    assert set(evaluate(some, b.ravel(), k.ravel()).fate) == {Fate.GROWS}


def test_groups_of_points_are_points_alone() -> None:
    """Points that share a device, an encoder step or a start: each as it is alone.

    Mutation: `keys` without the amplitude: starts of other points.
    """
    for axis in (Axis("encoder_step", 0.0, 1e-3), Axis("amplitude", 1e-4, 1e-1), B,
                 Axis("friction", 0.0, 1e-2), Axis("delay", 0.0, 4e-3)):  # fmt: skip
        some = replace(plane(), x=axis, trial=Trial(1e-3, 1.0, 1.0, 0.125, substeps=2))
        x = np.repeat(axis.values(3), 3)
        y = np.tile([2.0, 12.0, 30.0], 3)
        together = evaluate(some, x, y)
        alone = [evaluate(some, x[i : i + 1], y[i : i + 1], workers=1) for i in range(9)]
        for name in ("fate", "amplitude", "force", "rate", "frequency"):
            single = np.array([getattr(one, name)[0] for one in alone])
            within = 1e-12 if name == "rate" else 0.0  # a sum whose order the matrix's shape sets
            np.testing.assert_allclose(getattr(together, name), single, rtol=within)


def growth(verdict: int, rate: float, amplitude: float, force: float) -> Growth:
    """Return the growth of one run."""
    values = (np.array([v]) for v in (rate, 0.0, amplitude, force, 10.0, force))
    return Growth(np.array([verdict]), *values)


@pytest.mark.parametrize(
    ("found", "step", "fate"),
    [
        ((DECAYS, -3.0, 1e-9, 0.0), 0.0, Fate.RESTS),
        ((DECAYS, -3.0, 1e-9, 0.0), STEP, Fate.RESTS),
        ((DECAYS, -0.2, 1e-4, 0.05), STEP, Fate.UNDECIDED),  # falls, but steps may stop it
        ((DECAYS, -0.001, 1e-4, 0.05), STEP, Fate.FELT),  # hardly falls
        ((DECAYS, -0.001, 1e-4, 0.05), 0.0, Fate.RESTS),  # linear: it will
        ((LIMIT_CYCLE, 0.0, 1e-4, 0.005), STEP, Fate.DITHERS),
        ((LIMIT_CYCLE, 0.0, 1e-4, 0.01), STEP, Fate.FELT),
        ((LIMIT_CYCLE, 0.0, 1e-2, 0.5), STEP, Fate.GROWS),  # at the limit
        ((LIMIT_CYCLE, 0.0, 1e-2, 0.05), STEP, Fate.GROWS),  # of 100 steps, not theirs
        ((LIMIT_CYCLE, 0.0, 1e-4, 0.005), 0.0, Fate.GROWS),  # without any steps
        ((DECAYS, -0.003, 1e-2, 0.5), 0.0, Fate.GROWS),  # at the limit, and settling
        ((DECAYS, -0.3, 1e-2, 0.5), 0.0, Fate.RESTS),  # at the limit, and coming down
        ((UNDECIDED, 0.1, 1e-4, 0.02), STEP, Fate.FELT),  # irregular
        ((UNDECIDED, 0.0, 1e-3, 0.02), 0.0, Fate.UNDECIDED),  # on the linear boundary
        ((GROWS, 0.01, 1e-4, 0.02), STEP, Fate.FELT),  # below the start and a few steps
        ((GROWS, 0.01, 2e-3, 0.02), STEP, Fate.GROWS),
        ((GROWS, math.inf, 1e9, 1e9), STEP, Fate.GROWS),
    ],
)
def test_verdicts_become_fates(
    found: tuple[int, float, float, float], step: float, fate: Fate
) -> None:
    """Perceptible from 0.01 N m on, limit 0.5 N m, start 1e-3 rad, 16 s.

    Mutations: any one of `restless`, `drifts`, `held_growth`, `_small` left out fails a row.
    """
    device = phantom().with_interface(encoder_step=step, command_limit=0.5)
    plane = Plane(device, B, K)
    one = np.ones(1)
    conditions = Conditions(
        [device], np.zeros(1, np.int64), 10.0 * one, 0.0 * one, 1e-3 * one,
        plane.rest(device, 1e-3) * one,
    )  # fmt: skip
    assert fates_of(growth(*found), conditions, plane.trial.limit_s, Perception())[0] == fate


def test_irregular_oscillations_are_judged_as_in_eight_times_the_time() -> None:
    """60 seeded points of the stable part with steps: equal answers after 8 s and after 64 s.

    Mutation: `(verdict == UNDECIDED)` left out of `irregular`.
    """
    rng = np.random.default_rng(5)
    device = phantom().with_interface(encoder_step=STEP)
    b, k = rng.uniform(0.0, 0.08, 60), rng.uniform(5.0, 30.0, 60)
    short = evaluate(plane(device=device), b, k).fate
    long = evaluate(plane(device=device, trial=Trial(1e-3, 32.0, 64.0, 0.5)), b, k).fate
    assert Fate.UNDECIDED not in short
    assert np.mean(short == long) >= 0.98


def test_a_threshold_leaves_no_dither() -> None:
    """Walls that dither within their steps grow where the threshold is below that, and only there.

    Mutation: no `dither` given to `Conditions` in `evaluate`.
    """
    device = phantom().with_interface(encoder_step=STEP)
    b, k = np.full(3, 0.05), np.array([5.0, 10.0, 15.0])
    dithers = {Fate.DITHERS, Fate.FELT}
    assert set(evaluate(plane(device=device), b, k).fate) <= dithers
    for steps, fate in ((0.1, Fate.GROWS), (100.0, Fate.RESTS)):
        trial = Trial(1e-3, threshold=steps * STEP)
        assert set(evaluate(plane(device=device, trial=trial), b, k).fate) == {fate}


def test_transitions_are_read_from_the_map() -> None:
    """K up to which all rest, and from which one grows: within a cell of K_CR where linear."""
    found = make_map(plane(), 9, 2)
    rests, grows = found.transitions()
    cell = found.y[1] - found.y[0]
    for x, r, g in zip(found.x[:20], rests, grows, strict=False):
        critical = critical_stiffness(phantom(), float(x)).stiffness
        assert critical is not None
        assert r == g == pytest.approx(critical, abs=0.51 * cell)
    said = summary(found)
    assert said["transitions"][3]["grows_from"] == grows[3]
    assert sum(f["share"] for f in said["fates"].values()) == pytest.approx(1.0)
    assert said["runs"] == found.run.sum() < found.run.size


def test_the_file_opens_in_xarray_with_units_and_settings(tmp_path: object) -> None:
    """Every array as in the map, units on each, the device as text."""
    import pathlib

    import xarray

    from zwidth.sim.device_file import device_to_text

    device = with_friction(phantom().with_interface(encoder_step=STEP), 1e-3)
    result = make_map(plane(device=device, trial=Trial(1e-3, 1.0, 1.0, 0.125, substeps=4)), 3, 1)
    file = save_map(result, pathlib.Path(str(tmp_path)) / "deep" / "map.nc")
    with xarray.open_dataset(file, engine="scipy") as data:
        np.testing.assert_array_equal(data["fate"], result.fates.fate)
        assert data["fate"].dims == ("K", "B")  # and not y and x, which name nothing
        np.testing.assert_array_equal(data["B"], result.x)
        np.testing.assert_array_equal(data["K"], result.y)
        assert data["B"].attrs == {"long_name": "B", "units": "N m s/rad"}
        assert data["K"].attrs["units"] == "N m/rad"
        assert data["rests_up_to"].dims == ("B",)
        assert data["force"].attrs["units"] == "N m"
        assert data.attrs["device"] == device_to_text(device)
        assert data.attrs["runs"] == result.runs


def test_what_grows_without_a_limit_has_a_colour_of_its_own() -> None:
    """In both panels, and in the legend; a colour bar has round ticks.

    Breaks where the panel of forces leaves what grows in the white of what comes to rest.
    """
    from matplotlib.collections import QuadMesh

    from zwidth.figures.map import legend, map_figure

    result = make_map(plane(), 5, 1)
    assert Fate.GROWS in result.fates.fate
    figure = map_figure(result)
    for axes in figure.axes[:2]:
        first = next(c for c in axes.collections if isinstance(c, QuadMesh))
        values = first.get_array()
        assert values is not None
        np.testing.assert_array_equal(np.asarray(values).reshape(result.fates.fate.shape),
                                      result.fates.fate)  # fmt: skip
    labels = [str(handle.get_label()) for handle in legend([result])]
    assert "grows" in labels
    limited = make_map(plane(device=phantom().with_interface(command_limit=1.0)), 3, 0)
    labels = [str(handle.get_label()) for handle in legend([limited])]
    assert "grows to the limit" in labels
    labels = [str(handle.get_label()) for handle in legend([result, limited])]
    assert "grows (to the limit, if any)" in labels


@pytest.mark.parametrize(
    ("low", "high", "ticks"),
    [(1.0, 1000.0, [1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0]), (110.0, 140.0, [110, 125, 140])],
)
def test_a_colour_bar_has_three_round_ticks_at_least(
    low: float, high: float, ticks: list[float]
) -> None:
    """Breaks where a narrow range has none of the powers of ten."""
    from zwidth.figures.map import round_ticks

    assert round_ticks(low, high) == pytest.approx(ticks)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("Q", 0.0, 1.0), "axis 'Q' is not known; it must be one of K, B, delay"),
        (("B", 1.0, 0.5), "axis B goes from 1 to 0.5; give two finite numbers, the smaller"),
        (("B", 0.5, 0.5), "the smaller one first"),
        (("B", math.nan, 0.5), "two finite numbers"),
        (("B", 0.0, math.inf), "two finite numbers"),
        (("B", -0.1, 0.5), "axis B begins at -0.1; it must begin at 0 or more"),
        (("B", 0.0, 0.5, "log"), "axis B begins at 0; it must begin above 0"),
        (("K", 0.0, 5.0), "axis K begins at 0; it must begin above 0"),
        (("command_limit", 0.0, 5.0), "above 0"),
        (("amplitude", 0.0, 5.0), "above 0"),
        (("B", 0.1, 0.5, "cubic"), "spacing is 'cubic'; it must be 'linear' or 'log'"),
    ],
)
def test_axes_that_cannot_be(arguments: tuple[object, ...], says: str) -> None:
    with pytest.raises(ValueError, match=says.replace("(", r"\(")):
        Axis(*arguments)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"x": K}, "both axes are K; choose two different quantities"),
        ({"stiffness": math.nan}, "stiffness is nan; it must be finite and >= 0"),
        ({"damping": -1.0}, "damping is -1.0; it must be finite and >= 0"),
        ({"x": Axis("delay", 0.0, 0.06)}, "reaches 0.06 s; a map allows at most 50 ticks"),
        ({"device": phantom().with_interface(delay=0.051)}, "a map allows at most 50 ticks"),
        (
            {"trial": Trial(1e-3, 0.06, 0.06, 0.01)},
            "too short to be judged; give at least 64 ticks",
        ),
    ],
)
def test_planes_that_cannot_be(changes: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        plane(**changes)


def test_friction_on_an_axis_replaces_what_the_device_has_at_m1() -> None:
    device = phantom().with_physics(coulomb(5e-3), coulomb(1e-3, "m3"))
    some = Plane(device, Axis("friction", 0.0, 1e-2), K)
    assert some.setting("friction") == 5e-3
    levels = {p.at: p.values["level"] for p in some.device_at({"friction": 2e-3}).physics}
    assert levels == {"m1": 2e-3, "m3": 1e-3}
    assert [p.at for p in some.device_at({"friction": 0.0}).physics] == ["m3"]
