"""Which effects a fleet's devices have: one structure for all, with parameters per recording.

Recordings of several devices differ in their parameters; with one x for all, spurious physics would
compensate the differences. So the cost of a structure S is computed with separate parameters for
each of a few recordings,

    cost(S) = sum_i (misfit_i(S) + freedom_i(S)) - 2 ln P(S),

with the rarity P(S) of the physics counted once (`diagnosis.selection.evidence`). Candidates are
the cheapest hypotheses from a search on each recording alone, and their parts; each further effect
must lower the cost by 2 ln (1 / ALPHA). A recording without information about a parameter is left
out of the comparison.

The few recordings are the most informative ones, of different devices: those whose refit determines
the linear parameters best (ln det J'J). Recordings whose parameters are far from the others' are
excluded, since they may have a fault.
"""

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.mishaps import Say
from zwidth.diagnosis.model.own_values import first_x
from zwidth.diagnosis.model.parameters import Model, effect_labels, linear_parameters
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.effort import Effort
from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.selection.search import search
from zwidth.shown import Valued
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import grid_of, is_grid
from zwidth.sim.physics.free_product import free_product, held
from zwidth.sim.physics.free_shift import unshifted
from zwidth.sim.physics.two_tables import LAW_FIRST, LAW_SECOND, is_two_tables, two_tables_of
from zwidth.sim.uncertainty import Uncertainty

Floats = NDArray[np.float64]
STEP_COST = 2.0 * math.log(1.0 / ALPHA)
CANDIDATES = 3  # structures of each search that are tried on all recordings
FAR = 4.0  # robust deviations beyond which a recording is not representative
OPEN = Uncertainty(masses=1.0, springs=1.0, dampers=2.0)
"""How far recordings of a fleet may be from its typical device: enough to notice odd ones."""
SHARE = 0.3  # share of a device file's value that is one unit of x, unless a scale is known


@dataclass(frozen=True)
class Structure(Valued):
    """The model that every recording of a fleet is fitted with.

    device: the typical one, without the effects; effects: at their typical values, with the scales
    and bounds of their free parameters (`Model`).
    """

    device: Device
    effects: tuple[Physics, ...] = ()
    scales: tuple[Mapping[str, float], ...] = ()
    bounds: tuple[Mapping[str, tuple[float, float]], ...] = ()

    @property
    def model(self) -> Model:
        """The model, which is the typical device at x = 0."""
        return Model(self.device, self.effects, self.scales, bounds=self.bounds)

    @property
    def labels(self) -> list[str]:
        """effect@place of each effect."""
        return effect_labels(self.effects)

    @property
    def typical(self) -> Device:
        """The typical device with its effects."""
        return self.device.with_physics(*self.effects)

    def to_json(self) -> str:
        """Return the structure as JSON text whose numbers read back exactly."""
        effects = [
            {
                "effect": p.effect.name,
                "at": p.at,
                "values": dict(p.values),
                "scales": dict(s),
                "bounds": {k: list(v) for k, v in b.items()},
            }
            for p, s, b in zip(self.effects, self.scales, self.bounds, strict=True)
        ]
        return json.dumps({"device": device_to_text(self.device), "effects": effects}, indent=1)


def structure_from(text: str) -> Structure:
    """Rebuild a structure from the output of `to_json`; raises ValueError for any other text."""
    try:
        found = cast("dict[str, Any]", json.loads(text))
        every = found["effects"]
        return Structure(
            device_from_text(found["device"]),
            tuple(make_physics(e["effect"], e["at"], **e["values"]) for e in every),
            tuple(e["scales"] for e in every),
            tuple({k: (v[0], v[1]) for k, v in e["bounds"].items()} for e in every),
        )
    except (KeyError, TypeError, IndexError) as error:
        raise ValueError(f"this is not a fleet structure: {error}") from None


def _kept(physics: Physics) -> set[str]:
    """The parameters of an effect that stay fixed: of a force over two states all but its forces.

    Of a pair of tables all but the numbers of their laws, one of which is fixed: in a product only
    the product matters, and a shift is equivalent to another origin of the shifted state.
    """
    if is_grid(physics.effect.parameters):
        return set(physics.values) - {n for row in grid_of(physics.values).names for n in row}
    if not is_two_tables(physics.effect.parameters):
        return set()
    tables = two_tables_of(physics.values)
    others = LAW_SECOND[: len(tables.second)]
    still = held if physics.effect is free_product else unshifted
    one = others[still([law for _, law in tables.second])]
    return set(physics.values) - {*LAW_FIRST[: len(tables.first)], *others} | {one}


def known_structure(device: Device) -> Structure:
    """Return the structure of a device file: all its effects are free, except the drive."""
    free = [
        p
        for p in device.physics
        if not (p.effect.sought == "lattice" or p.effect.in_recording or p.effect.of_drive)
    ]
    scales = [
        {
            k: SHARE * abs(v)
            for k, v in p.values.items()
            if v != 0.0 and math.isfinite(v) and k not in _kept(p)
        }
        for p in free
    ]
    # Without a name, without_physics would remove all effects.
    bare = device.without_physics(*(p.effect.name for p in free)) if free else device
    return Structure(
        replace(bare, uncertainty=_open(device)), tuple(free), tuple(scales), ({},) * len(free)
    )


def _open(device: Device) -> Uncertainty:
    known = device.uncertainty
    return replace(OPEN, command_scale=known.command_scale, zeros=known.zeros)


def informative(
    device: Device, experiments: Sequence[Experiment], devices: Sequence[str], count: int
) -> list[int]:
    """Return the indices of the most informative recordings, from different devices if possible.

    Raises NoObserver if no observer of the device exists for any of them.
    """
    model = known_structure(device).model
    told: list[tuple[int, float, Floats]] = []
    for place, e in enumerate(experiments):
        with suppress(NoObserver):
            h = settled(judged([e], model, first_x(model, [e])), turns=1)
            assert h.slopes is not None
            own = h.slopes[: h.samples]
            log_det = float(np.linalg.slogdet(own.T @ own + np.eye(own.shape[1]))[1])
            linear = [p.kind not in ("origin", "zero", "jitter", "skew") for p in model.parameters]
            told.append((place, log_det, h.x[np.array(linear)]))
    if not told:
        raise NoObserver("no observer of the device predicts any recording of the fleet")
    xs = np.stack([x for _, _, x in told])
    middle = np.median(xs, axis=0)
    spread = 1.4826 * np.median(np.abs(xs - middle), axis=0) + 0.05
    near = np.all(np.abs(xs - middle) < FAR * spread, axis=1)
    sound = [one for one, kept in zip(told, near, strict=True) if kept] or told
    ranked = [place for place, _, _ in sorted(sound, key=lambda one: -one[1])]
    chosen: list[int] = []
    seen = set[str]()
    for place in ranked:
        if devices[place] not in seen:
            chosen.append(place)
            seen.add(devices[place])
    chosen += [place for place in ranked if place not in chosen]
    return chosen[:count]


def sought(
    device: Device, experiments: Sequence[Experiment], effort: Effort, say: Say
) -> tuple[Structure, dict[str, float]]:
    """Return the structure of least cost over recordings, and the extra cost of each candidate.

    Raises NoObserver as `informative`.
    """
    begun = known_structure(device)
    bare = Model(replace(begun.device, uncertainty=_open(device)))
    found: dict[frozenset[str], tuple[Model, Floats, float]] = {}
    if begun.effects:  # the structure of the device file is one of the candidates
        own = begun.model
        found[frozenset(begun.labels)] = own, np.zeros(len(own.parameters)), 0.0
    wanting = len(experiments)
    for e in experiments:
        say(f"searching for missing physics in {e.name}")
        try:
            tried = search(bare.nominal, [e], effort)
        except NoObserver:
            wanting -= 1
            continue
        if tried.interrupted:  # an interrupted search has only its best hypothesis so far
            raise KeyboardInterrupt
        ranked = sorted(tried.tried.values(), key=lambda h: h.cost.total)
        for h in [tried.best, *ranked[:CANDIDATES]]:
            parts = [_single(h, i) for i in range(len(h.model.effects))]
            for one in [h, *(parts if len(parts) > 1 else [])]:
                known = found.get(one.labels)
                if known is None or one.cost.total < known[2]:
                    found[one.labels] = one.model, one.x, one.cost.total
    if not wanting:
        raise NoObserver("no observer of the device predicts any recording of the fleet")
    plain = [_fitted(e, bare, first_x(bare, [e])) for e in experiments]
    costs = {frozenset[str](): sum(h.cost.total for h in plain if h is not None)}
    fits: dict[frozenset[str], list[Hypothesis | None]] = {frozenset(): plain}
    for labels, (structure, x, _) in found.items():
        if not labels:
            continue
        say(f"fitting {' and '.join(sorted(labels))} to {len(experiments)} recordings")
        model = replace(structure, nominal=bare.nominal)
        each = [_fitted(e, model, x) for e in experiments]
        fits[labels], costs[labels] = each, _cost(each, plain)
    best = frozenset[str]()
    for labels in sorted(costs, key=len):
        if costs[labels] + STEP_COST * (len(labels) - len(best)) < costs[best]:
            best = labels
    more = {" + ".join(sorted(s)) or "linear": c - costs[best] for s, c in costs.items()}
    kept = [h for h in fits[best] if h is not None]
    return _typical(kept, _open(device)), more


def _single(h: Hypothesis, index: int) -> Hypothesis:
    others = [i for i in range(len(h.model.effects)) if i != index]
    model, x = h.model.less(h.x, *others)
    return judged(h.experiments, model, x)


def _fitted(e: Experiment, model: Model, x: Floats) -> Hypothesis | None:
    try:
        return settled(judged([e], model, model.within(x)))
    except NoObserver:
        return None


def _cost(each: Sequence[Hypothesis | None], plain: Sequence[Hypothesis | None]) -> float:
    """The cost of a structure over recordings; one that does not show it uses its plain fit."""
    total, rarity = 0.0, 0.0
    for h, without in zip(each, plain, strict=True):
        own = math.inf if h is None else h.cost.misfit + h.cost.freedom
        other = math.inf if without is None else without.cost.total
        rarity = rarity if h is None else h.cost.rarity
        if math.isfinite(own):
            total += own
        elif math.isfinite(other):
            total += other
    return total + rarity


def _typical(kept: Sequence[Hypothesis], uncertainty: Uncertainty) -> Structure:
    """The structure with the median parameters of the recordings, which become x = 0."""
    model = kept[0].model
    x = model.within(np.median(np.stack([h.x for h in kept]), axis=0))
    count = len(linear_parameters(model.nominal))
    only = replace(model, effects=(), scales=(), bounds=())
    chain = only.build(x[:count]).chain
    device = replace(model.nominal.with_chain(chain), uncertainty=uncertainty)
    bounds = model.bounds or ({},) * len(model.effects)
    return Structure(device, model.effects_at(x), model.scales, bounds)
