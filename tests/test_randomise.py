"""Draws from a device's posterior: joint, possible, and told by the fields of the format."""

import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from zwidth.export.draws import as_json, draws_of, independent_sentence
from zwidth.export.mjcf import mjcf
from zwidth.export.robots import urdf
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.device_file import commented_text, device_from_text
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.posterior import Posterior

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
def test_fields_are_those_of_the_file(export):  # noqa: ANN001
    """Mutation: the file of the device itself for every draw: no field is left."""
    drawn = draws_of(bench(), 20, 3)
    told = as_json(bench(), drawn, lambda d: export(d, "bench"), export.__name__, 3)
    root = ElementTree.fromstring(export(bench(), "bench").body)
    joint = next(e for e in root.iter("joint") if e.get("name") == "m1")
    masses, levels = drawn.values[:, 0].tolist(), drawn.values[:, 3].tolist()
    if export is mjcf:
        field = told["fields"]["joint/m1/frictionloss"]
        assert field["value"] == float(joint.get("frictionloss", ""))
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
    assert abs(np.corrcoef(drawn.values.T)[0, 1]) < 0.05
    assert "draws are independent" in independent_sentence(bench(None))


def test_the_posterior_reads_back_from_its_file():
    """Mutation: [posterior] not written."""
    text = commented_text(bench())
    assert device_from_text(text) == bench()
    assert device_from_text(text).posterior == TOLD
    assert "standard deviation of each" in text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: replace(p, sd=(6e-5, 0.0, 0.02, 1e-3)), "posterior.sd of b1 is 0.0; allowed"),
        (lambda p: replace(p, sd=(6e-5, math.inf, 0.02, 1e-3)), "posterior.sd of b1 is inf"),
        (lambda p: replace(p, sd=(6e-5,)), "posterior has 4 names, 1 sd"),
        (lambda p: replace(p, names=("m1", "m1", "b1", "k0")), "a name twice"),
        (lambda p: replace(p, correlation=((1.0, 2.0, 0.0, 0.0), (2.0, 1.0, 0.0, 0.0),
                                           (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))),
         "posterior.correlation is no correlation"),
    ],
)  # fmt: skip
def test_a_posterior_that_cannot_be_is_refused_in_a_sentence(change, said: str):  # noqa: ANN001
    with pytest.raises(ValueError, match=said):
        change(TOLD)


def test_a_name_that_the_device_lacks_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match="posterior.names has 'm2'"):
        draws_of(bench(replace(TOLD, names=("m2", *NAMES[1:]))), 1, 0)
    slip = commented_text(bench()).replace("correlation =", "corelation =")
    with pytest.raises(DeviceError, match="posterior.corelation"):
        device_from_text(slip)
