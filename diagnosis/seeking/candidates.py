"""Every effect at every place, with starts over the magnitudes that the data could show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.magnitude import within_bounds
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.sim.device import Device, has_room, known, place_label
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Bounds, Effect, Physics
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place, place_at


@dataclass(frozen=True)
class Start:
    """One effect at one place with start values, and the scales of its free parameters.

    bounds: physical ones for this recording; by default those of the effect. own: values that
    differ between recordings (`model.own_values`), by their name: which parameter, and by how much.
    """

    physics: Physics
    scales: Mapping[str, float]
    bounds: Bounds = field(default_factory=dict[str, tuple[float, float]])
    own: Mapping[str, tuple[str, float]] = field(default_factory=dict[str, tuple[str, float]])

    def beyond(self, names: Sequence[str], scales: Mapping[str, float]) -> list[float]:
        """Return x of the recordings' own values, in order of names; scales: of the parameters."""
        more = (self.own.get(name) for name in names)
        return [0.0 if own is None else own[1] / scales[own[0]] for own in more]

    @property
    def label(self) -> str:
        """effect@place."""
        return place_label(self.physics)

    def scaled(self, factor: float) -> "Start | None":
        """Return the start with a multiple of its strength; None without one or beyond bounds."""
        effect = self.physics.effect
        names = effect.magnitudes
        if not names:
            return None
        values = dict(self.physics.values)
        for name in names:
            none = effect.parameter(name).none_of_it()
            values[name] = none + factor * (values[name] - none)
        scales = {k: v * factor if k in names else v for k, v in self.scales.items()}
        if not within_bounds(effect, values):
            return None
        return replace(self, physics=replace(self.physics, values=values), scales=scales)

    def as_strong_as(self, other: Physics) -> "Start | None":
        """Return the start with the strength of another effect; None if they do not compare.

        The fit of a law that contains another, or is contained in it, starts best where the other
        ended. If `other` has several strengths (friction that differs by direction), the largest
        counts.
        """
        own, its = self.physics.effect, other.effect
        if own.strength is None or its.strength is None:
            return None
        mine, theirs = own.parameter(own.strength), its.parameter(its.strength)
        if mine.unit != theirs.unit:
            return None
        size = abs(self.physics.values[mine.name] - mine.none_of_it())
        alike = [
            p for p in map(its.parameter, {theirs.name, *its.magnitudes}) if p.unit == mine.unit
        ]
        wanted = max(abs(other.values[p.name] - p.none_of_it()) for p in alike)
        return self.scaled(wanted / size) if size > 0.0 and wanted > 0.0 else None


def candidates(device: Device, experiments: Sequence[Experiment], gain: float = 1.0) -> list[Start]:
    """Return all starts for a device and its recordings; gain: as in `sizes_of`."""
    sizes = sizes_of(device, experiments, gain)
    masses = device.chain.masses.size + len(device.hosts())
    present = {(p.effect.name, p.place.acts_on) for p in device.physics}
    found: list[Start] = []
    for effect in EFFECTS.values():
        if effect.in_recording or (effect.rotary_only and not device.rotary):
            continue
        if not has_room(effect, masses):
            continue
        for place in map(place_at, effect.places):
            if place.masses_needed > device.chain.masses.size or known(effect, place, device):
                continue
            akin = (effect.name, *effect.contains)
            if not present.isdisjoint((name, place.acts_on) for name in akin):
                continue
            if sizes.driven or not effect.of_command:
                found += starts_of(effect, place, sizes)
    return found


def starts_of(effect: Effect, place: Place, sizes: Sizes) -> list[Start]:
    """Return the starts of an effect at a place."""
    bounds = effect.within(sizes, place)
    return [
        Start(Physics(effect, str(place), values), scales, bounds)
        for values, scales in effect.starts(sizes, place)
        # a start for very stiff links may be out of bounds
        if within_bounds(effect, values)
    ]
