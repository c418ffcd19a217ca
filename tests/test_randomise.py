"""Draws from a device's posterior: joint, possible, and told by the fields of the format."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from zwidth.cli import run
from zwidth.diagnosis.answer.posterior import with_posterior
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.model.parameters import Model
from zwidth.export.cost import Cost
from zwidth.export.draws import as_json, draws_of, independent_sentence
from zwidth.export.mjcf import mjcf
from zwidth.export.model import Exported
from zwidth.export.robots import urdf
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.device_file import commented_text, device_from_text
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.posterior import Posterior
from zwidth.sim.uncertainty import Uncertainty

NAMES = ("m1", "b1", "interface.command_gain", "stribeck_friction@m1.level")
TOLD = Posterior(
    NAMES, (6e-5, 1.5e-3, 0.02, 1.2e-3),
    ((1.0, 0.2, 0.9, 0.5), (0.2, 1.0, 0.1, -0.6), (0.9, 0.1, 1.0, 0.4), (0.5, -0.6, 0.4, 1.0)),
)  # fmt: skip


def bench(told: Posterior | None = TOLD) -> Device:
    rub = make_physics("stribeck_friction", "m1", level=0.025, static_level=0.04, velocity=0.6)
    rotor = make_chain([1.2e-3], [3e-3])
    plain = Device("bench", "", True, rotor, Interface(period=0.002)).with_physics(rub)
    return replace(plain, posterior=told)


def test_draws_scatter_together_as_the_posterior_says():
    """Mutation: `root` replaced by the identity (independent draws): correlations are all zero."""
    drawn = draws_of(bench(), 4000, 3)
    assert drawn.joint
    found = drawn.values.copy()
    found[:, [0, 2]] = np.log(found[:, [0, 2]])  # mass and gain scatter in their logarithms
    near = np.abs(np.corrcoef(found.T) - np.array(TOLD.correlation))
    assert near.max() < 0.06, near  # b1 lies 2 sd above zero, and is cut there
    assert np.std(found[:, 0]) == pytest.approx(6e-5 / 1.2e-3, rel=0.05)
    assert np.std(drawn.values[:, 3]) == pytest.approx(1.2e-3, rel=0.05)


def test_what_physics_forbids_is_not_drawn_and_a_seed_draws_the_same_again():
    """Mutations: no look at the bounds (dampers below zero); the seed left out."""
    rows = tuple(tuple(float(i == j) for j in range(4)) for i in range(4))
    wide = bench(Posterior(NAMES, (3e-3, 9e-3, 0.5, 0.02), rows))
    drawn = draws_of(wide, 300, 1)
    assert drawn.values.min() > 0.0
    np.testing.assert_array_equal(drawn.values, draws_of(wide, 300, 1).values)
    assert not np.array_equal(drawn.values, draws_of(wide, 300, 2).values)


@pytest.mark.parametrize("export", [mjcf, urdf])
def test_fields_are_those_of_the_file(export: Callable[[Device, str], Exported]):
    """Mutation: the file of the device itself for every draw: no field is left."""
    drawn = draws_of(bench(), 20, 3)
    told = as_json(bench(), drawn, lambda d: export(d, "bench"), export.__name__, 3)
    root = ElementTree.fromstring(export(bench(), "bench").body)
    masses, levels = drawn.values[:, 0].tolist(), drawn.values[:, 3].tolist()
    if export is mjcf:
        field = told["fields"]["dcmotor/stribeck_friction_m1/lugre"]
        (motor,) = root.iter("dcmotor")
        assert field["value"] == [float(word) for word in motor.get("lugre", "").split()]
        field = {"draws": [one[2] for one in field["draws"]]}
        gains = told["fields"]["general/drive/gainprm"]["draws"]
        assert gains == drawn.values[:, 2].tolist()
        inertias = told["fields"]["body/b1/inertial/diaginertia"]["draws"]
        assert [one[0] for one in inertias] == masses
    else:
        field = told["fields"]["joint/m1/dynamics/friction"]
        assert told["fields"]["link/body/inertial/inertia/izz"]["draws"] == masses
    assert field["draws"] == levels
    assert told["joint"] is True
    assert told["parameters"]["m1"]["unit"] == "kg m2"
    assert not any(key.endswith("timestep") for key in told["fields"])


def test_without_a_posterior_draws_are_independent_and_said_to_be():
    drawn = draws_of(bench(None), 4000, 5)
    assert not drawn.joint
    assert drawn.names == ("m1", "b1")
    assert np.std(np.log(drawn.values[:, 0])) == pytest.approx(0.3, rel=0.05)
    np.testing.assert_allclose(np.corrcoef(drawn.values.T), np.eye(2), atol=0.05)
    assert "drawn independently of each other" in independent_sentence(bench(None))


def test_the_posterior_reads_back_from_its_file():
    """Mutation: [posterior] not written."""
    text = commented_text(bench())
    assert device_from_text(text) == bench()
    assert device_from_text(text).posterior == TOLD
    assert "standard deviation of each" in text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: replace(p, sd=(6e-5, 0.0, 0.02, 1e-3)), "posterior.sd of b1 is 0.0; it must be"),
        (lambda p: replace(p, sd=(6e-5, math.inf, 0.02, 1e-3)), "posterior.sd of b1 is inf"),
        (lambda p: replace(p, sd=(6e-5,)), "posterior has 4 names, 1 sd"),
        (lambda p: replace(p, names=("m1", "m1", "b1", "k0")), "a name twice"),
        (lambda p: replace(p, correlation=((1.0, 2.0, 0.0, 0.0), (2.0, 1.0, 0.0, 0.0),
                                           (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))),
         "posterior.correlation is not a correlation"),
    ],
)  # fmt: skip
def test_a_posterior_that_cannot_be_is_refused_in_a_sentence(
    change: Callable[[Posterior], Posterior], said: str
):
    with pytest.raises(ValueError, match=said):
        change(TOLD)


def test_a_name_that_the_device_lacks_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match=r"posterior\.names has 'm2'"):
        draws_of(bench(replace(TOLD, names=("m2", *NAMES[1:]))), 1, 0)
    slip = commented_text(bench()).replace("correlation =", "corelation =")
    with pytest.raises(DeviceError, match=r"posterior\.corelation"):
        device_from_text(slip)


def test_a_fit_writes_what_it_knows_of_all_its_numbers_together():
    """Fit of two columns that are nearly alike: their numbers go against each other.

    Mutation: `spread` by its diagonal alone: the correlation is 0.
    """
    nominal = replace(bench(None), uncertainty=Uncertainty(command_scale=0.2)).without_physics()
    rub = make_physics("coulomb_friction", "m1", level=0.02)
    model = Model(nominal).with_effect(rub, {"level": 0.01})
    names = [p.name for p in model.parameters]
    random = np.random.default_rng(0)
    samples = 4096
    slopes = random.standard_normal((samples, len(names)))
    mass, level = names.index("m1"), names.index("coulomb_friction@m1.level")
    slopes[:, level] = 0.9 * slopes[:, mass] + math.sqrt(1.0 - 0.81) * slopes[:, level]
    priors = np.diag([float(p.prior) for p in model.parameters])
    residual = np.concatenate([random.standard_normal(samples), np.zeros(len(names))])
    x = np.zeros(len(names))
    fitted = Fitted(model, x, 0.0, residual, np.vstack([slopes, priors]), samples)
    told = with_posterior(model.build(x), fitted).posterior
    assert told is not None
    assert set(told.names) == {"m1", "b1", "interface.command_gain", "coulomb_friction@m1.level"}
    one, other = told.names.index("m1"), told.names.index("coulomb_friction@m1.level")
    assert told.correlation[one][other] == pytest.approx(-0.9, abs=0.03)
    # sd of x is 1 / sqrt(samples (1 - 0.81)); of the level 0.01 times, of the mass 0.3 m1 times
    sd = 1.0 / math.sqrt(samples * 0.19)
    assert told.sd[other] == pytest.approx(0.01 * sd, rel=0.1)
    assert told.sd[one] == pytest.approx(0.3 * 1.2e-3 * sd, rel=0.1)


@pytest.fixture
def quick(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the bench, and no run of the export, which is tested elsewhere."""
    cost = Cost(None, "not run here")
    monkeypatch.setattr("zwidth.commands.export.cost_of", lambda *_: cost)  # pyright: ignore[reportUnknownLambdaType, reportUnknownArgumentType]
    monkeypatch.chdir(tmp_path)
    Path("bench.toml").write_text(commented_text(bench()))
    return tmp_path


def test_the_command_writes_the_draws_beside_the_model(quick: Path):
    line = ["export", "bench.toml", "--to", "mjcf", "--out", "b.xml"]
    assert run([*line, "--randomise", "30", "--seed", "4"]) == 0
    told = json.loads((quick / "b.draws.json").read_text())
    assert (told["draws"], told["joint"], told["seed"]) == (30, True, 4)
    assert len(told["fields"]["dcmotor/stribeck_friction_m1/lugre"]["draws"]) == 30


def test_formats_without_fields_and_slips_are_refused_with_status_2(
    quick: Path, capsys: pytest.CaptureFixture[str]
):
    line = ["export", "bench.toml", "--out", "b.x", "--randomise"]
    assert run([*line, "3", "--to", "c"]) == 2
    assert "--randomise can be used with --to mjcf, urdf, sdf" in capsys.readouterr().err
    slip = (quick / "bench.toml").read_text().replace('"b1",', '"b7",')
    (quick / "bench.toml").write_text(slip)
    assert run([*line, "3", "--to", "urdf"]) == 2
    assert "posterior.names has 'b7'" in capsys.readouterr().err
