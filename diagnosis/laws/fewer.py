"""As many points as a law pays for, odd or not, told from the slopes of one fit.

With A = J'J the information of weighed innovations r with slopes J over all parameters, what they
say of the numbers z of a law, all others o free, is to second order

    z' P z - 2 z' g,    P = A_zz - A_zo A_oo^-1 A_oz,    g = P z_0 - (J_z - J_o A_oo^-1 A_oz)' r,

about the numbers z_0 at which the slopes were taken. Any law of fewer numbers y at which
z = c + B y (fewer points, an odd law) adds to that what its numbers cost,

    ln det B'PB + 2 sum_k ln range_k - k ln 2 pi,    range_k ~ |y_k|,

least over y, as `selection.evidence` prices every hypothesis. So the points that pay are told from
one fit, or from slopes alone where nothing was fitted yet: they go one at a time, that which costs
least by going, and what was cheapest is fitted.

Where no hypothesis is true a likelihood is too sure of itself, by the phi of `evidence.compared`:
P and g are then divided by it, and so is what a fit gains (`tempered`). A table of sixteen points
otherwise follows what has nothing to do with its state.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.laws.forms import Form, Shape, Site, form_of
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.selection.hypothesis import SWEEP, Hypothesis
from zwidth.sim.physics.effect import Physics

Floats = NDArray[np.float64]


def tempered(h: Hypothesis, phi: float) -> float:
    """Return what a hypothesis costs where likelihoods are too sure by phi, in -2 ln.

    Misfit and information, and so ln det A of all its parameters, are phi times less.
    """
    return h.cost.total - (1.0 - 1.0 / phi) * h.cost.misfit - h.x.size * math.log(phi)


@dataclass(frozen=True)
class Known:
    """What slopes know of the law that a model has last: its free numbers z, P and g.

    names, numbers (z,), precision (z, z), pull (z,).
    """

    names: tuple[str, ...]
    numbers: Floats
    precision: Floats
    pull: Floats

    @property
    def stands(self) -> float:
        """What the law explains as it stands, in -2 ln against one of nothing."""
        return float(self.numbers @ (self.precision @ self.numbers - 2.0 * self.pull))


def numbers_of(model: Model, keys: tuple[str, ...]) -> list[tuple[int, str, float]]:
    """Return place in x, name and scale of the free numbers of a model's last effect."""
    last = len(model.effects) - 1
    return [
        (j, p.key, p.scale)
        for j, p in enumerate(model.parameters)
        if p.kind == "effect" and p.index == last and p.key in keys
    ]


def known(model: Model, x: Floats, residual: Floats, slopes: Floats, phi: float = 1.0) -> Known:
    """Return what a residual (samples + priors,) and slopes (.., x) know of a model's last law.

    phi: by how much the likelihood is too sure.
    """
    law = model.effects_at(x)[-1]
    places, names, scales = zip(*numbers_of(model, form_of(law).names), strict=True)
    others = np.setdiff1d(np.arange(x.size), places)
    own, beside = slopes[:, places] / np.array(scales), slopes[:, others]
    inverse = np.linalg.pinv(beside.T @ beside, hermitian=True)
    own = own - beside @ (inverse @ (beside.T @ own))
    p = own.T @ own
    p += 1e-9 * float(np.diag(p).max()) * np.eye(len(p))  # a sum of forces may be unknown
    numbers = np.array([law.values[name] for name in names])
    off = residual - beside @ (inverse @ (beside.T @ residual))
    return Known(names, numbers, p / phi, (p @ numbers - own.T @ off) / phi)


def known_of(h: Hypothesis, phi: float = 1.0) -> Known:
    """Return what a priced hypothesis knows of its last law."""
    assert h.slopes is not None
    return known(h.model, h.x, h.residual, h.slopes, phi)


@dataclass(frozen=True)
class Priced:
    """A law of some points, and what it costs against one of nothing, in -2 ln."""

    shape: Shape
    cost: float
    make: Callable[[], Physics] | None = None

    @property
    def law(self) -> Physics | None:
        """The law; None where nothing is known of it."""
        return self.make() if self.make and math.isfinite(self.cost) else None


def price(there: Known, form: Form, site: Site, shape: Shape) -> Priced:
    """Return a law of some points, as near to what is known as it can be."""
    few = form.fewer(site, there.names, shape)
    if few.basis.shape[1] == 0:
        return Priced(shape, math.inf)
    square = few.basis.T @ there.precision @ few.basis
    square += 1e-12 * float(np.diag(square).max()) * np.eye(len(square))
    try:
        inverse = np.asarray(np.linalg.inv(square), dtype=np.float64)
    except np.linalg.LinAlgError:
        return Priced(shape, math.inf)
    y = inverse @ (few.basis.T @ (there.pull - there.precision @ few.offset))
    z = few.offset + few.basis @ y
    cost = float(z @ there.precision @ z - 2.0 * z @ there.pull) + _freedom(square, inverse, y)
    return Priced(shape, cost, partial(few.law, y))


def _freedom(square: Floats, inverse: Floats, y: Floats) -> float:
    """What numbers y (k,) known with a precision cost, as `evidence.freedom`."""
    deviation = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    ranges = SWEEP * np.maximum(np.abs(y), deviation)
    sign, log_det = np.linalg.slogdet(square)
    if sign <= 0.0 or not np.all(ranges > 0.0):
        return math.inf
    return float(log_det + 2.0 * np.sum(np.log(ranges)) - y.size * math.log(2.0 * math.pi))


def as_it_is(there: Known) -> float:
    """Return what a law costs as it stands, its numbers unchanged, against one of nothing."""
    p = there.precision
    inverse = np.asarray(np.linalg.pinv(p, hermitian=True), dtype=np.float64)
    return there.stands + _freedom(p, inverse, there.numbers)


def cheapest(there: Known, form: Form, site: Site, *more: Shape) -> Priced:
    """Return the law of the points that pay, of all shapes that a law may have.

    The ends stay, and so does the point of a number that is held. more: shapes besides the form's
    own, of which points may go as well.
    """
    kept = form.kept(site, there.names)
    priced = partial(price, there, form, site)
    found: list[Priced] = []
    for shape in (*form.shapes(site), *more):
        fewest = 3 if len(shape.axes) == 1 and not shape.odd else 2  # two points are a line
        one = priced(shape)
        found.append(one)
        while True:
            fewer = [
                shape_without(one.shape, i, k)
                for i, axis in enumerate(one.shape.axes)
                for k in range(1, axis.size - 1)
                if axis.size > fewest and axis[k] != kept[i]
            ]
            if not fewer:
                break
            one = min(map(priced, fewer), key=lambda each: each.cost)
            found.append(one)
    return min(found, key=lambda each: each.cost)


def shape_without(shape: Shape, axis: int, k: int) -> Shape:
    """Return a shape without one of the points along one of its axes."""
    axes = [np.delete(at, k) if i == axis else at for i, at in enumerate(shape.axes)]
    return Shape(tuple(axes), shape.odd)


@dataclass(frozen=True)
class Begun:
    """A hypothesis whose last effect is a law, and where that stands."""

    h: Hypothesis
    site: Site


def promised(one: Begun) -> float:
    """Return what a priced hypothesis would cost with the points of its last law that pay."""
    there, law = known_of(one.h), one.h.model.effects_at(one.h.x)[-1]
    own, best = as_it_is(there), cheapest(there, form_of(law), one.site).cost
    if math.isfinite(own):
        return one.h.cost.total + min(0.0, best - own)
    paid = one.h.cost  # not all of its points are told, but those that pay may be
    return paid.misfit + paid.rarity + paid.searched + best - there.stands
