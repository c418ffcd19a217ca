"""Subjects with a law without a name: on rigs at full size, or on devices at the limit.

A rig may also have effects of the library. The law is drawn for each rig (`grammar`), with 5 to 30
% of the driving force, and is as clear as any effect of a rig.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from zwidth.diagnosis.recording.experiment import experiment
from zwidth.exam.filming import film
from zwidth.exam.grammar import NOVEL, Law, draw_law, novelty, scaled
from zwidth.exam.machines import log_uniform
from zwidth.exam.rigs import FAILURES, TRIES, VISIBLE, with_effects
from zwidth.exam.stages import device_file, draw_stage
from zwidth.exam.subject import Subject
from zwidth.exam.visible import refitted, standing_law
from zwidth.exam.windows import cut, window_of, window_starts
from zwidth.planning.rehearsal import Noise
from zwidth.scenarios.concealed.devices import draw_device, mistaken
from zwidth.scenarios.concealed.excitation import draw_drive
from zwidth.scenarios.concealed.integrator import undisturbed, width
from zwidth.scenarios.concealed.rig import (
    Floats,
    Made,
    Rig,
    draw_nuisance,
    draw_outputs,
    record,
)
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import place_at

STREAM = 23
RIG_SHARE = 0.6  # of devices at full size
BESIDE = (0.6, 0.25, 0.15)  # shares of rigs with none, one and two effects of the library
SHARES = (0.05, 0.3)  # of the rms command
SENSED = 0.2  # of it, of a sensor's law: that much of the rms travel
LAWS = 12  # drawn before another device is
SHORTEST, LONGEST = 10.0, 20.0  # s, of devices as at the limit
FITTED_SHARE = 0.3  # of their device files


def draw_outsider(seed: int, index: int, seconds: float | None = None) -> Subject:
    """Return subject number `index` of a seed; raises ValueError if none was found."""
    random = np.random.default_rng([seed, index, STREAM])
    whole = random.random() < RIG_SHARE
    for _ in range(TRIES):
        try:
            found = _on_rig(random, seconds) if whole else _at_limit(random, seconds)
        except FAILURES:
            continue
        if found is not None:
            return found
    raise ValueError(f"no law was found for index {index} of seed {seed}; try another")


@dataclass(frozen=True)
class Bare:
    """A device recorded without the law that is to be concealed in it.

    effects: further effects of the library that the device has, besides those of `device`.
    """

    device: Device
    effects: Sequence[Physics]
    made: Sequence[Made]
    noise: Noise

    def law(self, random: np.random.Generator) -> tuple[Law, float] | None:
        """Return a law scaled along the first recording, and its share; None if none is found."""
        first = self.made[0]
        t, command = first.trace.t, first.trace["command"]
        for _ in range(LAWS):
            found = draw_law(random, self.device, t, first.states, command)
            if found.amplitude == 0.0 or novelty(found, t, first.states, command) < NOVEL:
                continue
            share = log_uniform(random, *SHARES)
            if found.at == "sensor":
                size = SENSED * share * float(np.std(first.states[:, 0]))
            else:
                size = share * float(np.sqrt(np.mean(command**2)))
            return scaled(found, size), share
        return None

    def stands(self, made: Sequence[Made]) -> float:
        """Return by how many sigma the law stands out.

        made: recordings with the law; those used for the fit come first.
        """
        without, recorded = (
            [replace(experiment(m.trace, self.device), dropped=m.lost) for m in every]
            for every in (self.made, made[: len(self.made)])
        )
        return standing_law(self.device, self.effects, without, recorded, self.noise, VISIBLE)


def _on_rig(random: np.random.Generator, seconds: float | None) -> Subject | None:
    stage = draw_stage(random, seconds)
    if stage is None:
        return None
    beside = with_effects(random, stage, int(random.choice(len(BESIDE), p=BESIDE)))
    if beside is None:
        return None
    made, hidden = beside
    physics = [make_physics(h.effect, h.at, **h.values) for h in hidden]
    device = stage.machine.device
    bare = Bare(device, physics, made[: stage.fitted], stage.noise)
    drawn = bare.law(random)
    if drawn is None:
        return None
    law, share = drawn
    scenes = stage.with_physics(physics, law.row(device.chain.masses.size)[None, :])
    made = [film(s) for s in scenes]
    sigma = bare.stands(made)
    if not sigma >= VISIBLE:
        return None
    nominal, kind = device_file(random, stage, stage.seen(made))
    traces = tuple(m.trace for m in made)
    about = stage.about() | {"share": share, "on": "a rig at full size"}
    return Subject(
        "outside", traces[: stage.fitted], traces[stage.fitted :], nominal,
        device.with_physics(*physics), hidden, kind, about, law=law, law_sigma=sigma,
        floor=floor(made, stage.fitted),
    )  # fmt: skip


def _at_limit(random: np.random.Generator, seconds: float | None) -> Subject | None:
    device = draw_device(random, encoder=False)
    duration = seconds or float(random.uniform(SHORTEST, LONGEST))
    drive = draw_drive(random, device, duration)
    nuisance, outputs = draw_nuisance(random, device, drive), draw_outputs(random, device)
    rig = Rig(device, drive, nuisance, outputs, None, int(random.integers(2**62)))
    noise = Noise(nuisance.process, nuisance.measurement)
    bare = Bare(device, (), [record(rig)], noise)
    drawn = bare.law(random)
    if drawn is None:
        return None
    law, share = drawn
    made = [record(replace(rig, laws=law.row(device.chain.masses.size)[None, :]))]
    sigma = bare.stands(made)
    if not sigma >= VISIBLE:
        return None
    nominal, kind = (
        replace(mistaken(random, device), name="device under test", source=""),
        "guessed",
    )
    if random.random() < FITTED_SHARE:
        seen = experiment(made[0].trace, nominal)
        nominal, kind = refitted(nominal, [seen], noise), "fitted"
    about = {
        "drive": [{"kind": drive.kind, "feedback": list(drive.feedback)}],
        "levels": [1.0],
        "outputs": list(outputs),
        "noise": asdict(nuisance),
        "share": share,
        "on": "a device as at the limit",
    }
    return Subject(
        "outside", (made[0].trace,), (), nominal, device, (), kind, about, law=law, law_sigma=sigma,
        floor=floor(made, 1),
    )  # fmt: skip


def floor(made: Sequence[Made], fitted: int) -> float:
    """Return the rms error of the truth's own noise-free runs, on the data that judge others.

    Of the first output, in windows as `perfect` has them, from the true states: no prediction errs
    less but by chance.
    """
    judged, errors = made[fitted:], list[Floats]()
    for one in judged or made:
        ticks = one.trace.t.size
        start = 0 if judged else cut(ticks)
        window = window_of(ticks - start, one.run.period)
        firsts = [start + f for f in window_starts(ticks - start, window)]
        moved = np.zeros((ticks, width(one.run.truth)))
        undisturbed(one.run, window, firsts, moved)
        quantity, _, at = next(n for n in one.trace.channels if n != "command").partition("_")
        column = int(one.run.truth.reads[2 * (quantity == "velocity"), place_at(at).index])
        seen = one.trace[f"{quantity}_{at}"]
        for f in firsts:
            errors.append(seen[f : f + window] - moved[f : f + window, column])
    joined = np.concatenate(errors)
    return float(np.sqrt(np.mean(joined**2)))
