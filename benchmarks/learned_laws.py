"""How well laws of no name are learned, on machines with a law drawn from the exam's grammar.

The grammar's shapes (odd, even and one-sided powers, tanh, sine, bump, straight pieces between
random knots; centred and scaled at random) of one state at one place, which neither a refit nor two
laws of the library come near (`grammar.novelty`): of position or velocity at a mass, of a link's
stretch or its rate, of the command. One or two masses of the exam's sizes, encoders and noise, a
device file whose every number is off by 10 to 50 %, a law of 10 to 50 % of the force that is as
new along the motion that it makes, and stands as clearly in the recording as those of the exam
(25 sigma). Every other recording has no law. Diagnosed with `--effort quick`, and with --two also
asked for laws over two states, as `--effort normal` does.

    python -m benchmarks.learned_laws --count 40 --seed 1 [--two]

With --two the law follows two states: A f(a) g(b) or A f(a + d g(b)), of position, velocity and
command at a mass, of a link's stretch, its rate and the command, or of the command and m1's
position or velocity. Its form is recovered where nine samples of ten lie in the band, or the
surface errs by less than a tenth, of those between the ends of what was fitted: without a plane,
which is a spring's, a damper's and a scale's, and without the scale of a law over the command where
that acts, as below.

Columns: what acts, the verdict, what was learned and where; by how much the curve errs over the
range that was fitted and holds 98 % of the samples, as a share of the law's rms, without what a
straight line holds (that is a spring's, a damper's or a gain's) and, of a law over the command,
without its scale (u + f(u) on m is the motion of c u + c f(u) on c m), and by how much it errs
together with the names beside it that follow the same state; whether the truth lies within its
band; and the share of the refit's held-out free-run error that is gone, of what the true device
would take away from its own true states. A form is recovered where the truth lies in the band or
the curve errs by less than a tenth, by itself or together with the names; how often by itself is
said too.
"""

import argparse
import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from zwidth.diagnosis.answer.laws import LearnedLaw, LearnedSurface
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.learning.curves import Learned
from zwidth.diagnosis.learning.surfaces import Surface
from zwidth.diagnosis.learning.tables import law_at
from zwidth.diagnosis.recording.experiment import stretches
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.exam.filming import Scene, draw_camera, film
from zwidth.exam.grammar import Law, draw_law, motion_at, novelty, scaled
from zwidth.exam.machines import draw_machine, guessed, log_uniform
from zwidth.exam.outsiders import Bare, floor
from zwidth.exam.playing import draw_playing
from zwidth.exam.rigs import FAILURES, VISIBLE
from zwidth.exam.stages import LEAST_STEPS
from zwidth.exam.windows import cut, window_of, window_starts
from zwidth.planning.rehearsal import Noise
from zwidth.scenarios.concealed.integrator import NO_LAWS
from zwidth.scenarios.concealed.rig import Made
from zwidth.sim.device import Device
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
SECONDS, TRIES, NOVEL = 12.0, 400, 0.4
STATES = {"position": "free_spring", "stretch": "free_spring", "velocity": "free_damper",
          "rate": "free_damper", "command": "free_amplifier"}  # fmt: skip
NAMED = {"position": "position", "stretch": "position", "velocity": "velocity", "rate": "velocity",
         "command": "command"}  # fmt: skip
NEAR, WITHIN, COARSE = 0.1, 0.01, 5e-3
INSIDE = 0.9  # of samples
MOST_OFF = 1.5  # that a device file's numbers are, and with them the scale of all


@dataclass(frozen=True)
class Drawn:
    """A recording with a law or none, the device file for it, and the law's states (samples,).

    floors: what the true device's free runs on the held-out part err by, over the motion there, in
    the first output, and in the position that it was counted from.
    """

    trace: Trace
    device: Device
    law: Law | None
    states: Floats
    floors: tuple[float, float] = (0.0, 0.0)


def drawn(seed: int, index: int, two: bool = False) -> Drawn:
    """Draw a recording; two: whether its law follows two states.

    Raises ValueError if no law that shows was found.
    """
    random = np.random.default_rng([seed, index, 57])
    for _ in range(TRIES):
        try:
            found = _try(random, index % 2 == 0, two)
        except FAILURES:
            continue
        if found is not None:
            return found
    raise ValueError(f"no machine was found for index {index} of seed {seed}; try another")


def _try(random: np.random.Generator, with_law: bool, two: bool) -> Drawn | None:
    machine = draw_machine(random)
    if machine.device.chain.masses.size > 2:
        return None
    playing = draw_playing(random, machine, SECONDS)
    camera = draw_camera(random, machine)
    still = replace(camera, process=0.0)
    scene = Scene(machine.device, playing, still, int(random.integers(2**31)), NO_LAWS)
    first = film(scene)
    if np.std(first.states[:, 0]) < LEAST_STEPS * machine.device.interface.encoder_step:
        return None
    # Noise is drawn for a command of rms one.
    size = float(np.sqrt(np.mean(first.trace.channels["command"] ** 2)))
    scene = replace(scene, camera=replace(camera, process=camera.process * size))
    made = film(scene)
    nominal = guessed(random, machine.device)
    if not with_law:
        return Drawn(made.trace, nominal, None, np.zeros(0))
    period = machine.device.interface.period
    t = period * np.arange(playing.wanted.size, dtype=np.float64)
    command = made.trace.channels["command"]
    law = draw_law(random, machine.device, t, made.states, command)
    if not (_over_two(law) if two else _over_one(law)):
        return None
    if novelty(law, t, made.states, command) < NOVEL:
        return None
    share = log_uniform(random, 0.1, 0.5)
    law = scaled(law, share * float(np.sqrt(np.mean(command**2))))
    rows = law.row(machine.device.chain.masses.size)[None, :]
    again = film(replace(scene, laws=rows))
    played = again.trace.channels["command"]
    if novelty(law, t, again.states, played) < NOVEL:  # the law may bring it where it is nothing
        return None
    noise = Noise(scene.camera.process, camera.reading)
    if not Bare(machine.device, (), [made], noise).stands([again]) >= VISIBLE:
        return None
    states = motion_at(law.at, t, again.states, played)
    factors = [law.first] if law.second is None else [law.first, law.second]
    seen = np.column_stack([states[factor.argument] for factor in factors])
    (first, *_) = (name for name in again.trace.channels if name != "command")
    mass = int(first[-1]) - 1
    channels = {"command": played, f"position_m{mass + 1}": again.states[:, mass]}
    units = dict.fromkeys(channels, "")
    truly = replace(again, trace=Trace(again.trace.t, channels, units, "recorded"))
    floors = (_floor(again), _floor(truly))
    return Drawn(again.trace, nominal, law, seen[:, 0] if law.second is None else seen, floors)


def _floor(made: Made) -> float:
    return floor([made], 1) / _motion(made.trace)


def _motion(trace: Trace) -> float:
    """The rms of what is judged, about its mean in each free run."""
    (seen, *_) = (v for name, v in trace.channels.items() if name != "command")
    first = cut(seen.size)
    window = window_of(seen.size - first, float(trace.t[1] - trace.t[0]))
    runs = [seen[first + f :][:window] for f in window_starts(seen.size - first, window)]
    return float(np.sqrt(np.mean([np.var(run) for run in runs])))


def _over_one(law: Law) -> bool:
    """Whether a law is of one state that the library's tables know at its place."""
    known = law.first.argument in STATES and law.at != "sensor"
    own = (law.first.argument == "command") == (law.at == "command")
    across = law.at.startswith("link") == (law.first.argument in ("stretch", "rate"))
    return law.second is None and known and own and across


def _over_two(law: Law) -> bool:
    """Whether a law is of two states that a grid knows at its place."""
    if law.second is None or law.at == "sensor":
        return False
    both = {law.first.argument, law.second.argument}
    if len(both) < 2 or (law.at == "command" and "command" not in both):
        return False
    link = law.at.startswith("link")
    return both <= ({"stretch", "rate", "command"} if link else {"position", "velocity", "command"})


def bent(values: Floats, states: Floats) -> Floats:
    """Return values (points,) less the straight line that is nearest to them."""
    line = np.polynomial.polynomial.polyfit(states, values, 1)
    return values - np.polynomial.polynomial.polyval(states, line)


def _ends(seen: Floats) -> tuple[Floats, Floats]:
    """Between which states a law was fitted: nothing is known of it beyond."""
    return np.asarray(seen.min(axis=0)), np.asarray(seen.max(axis=0))


def apart(one: Drawn, law: Law, curve: Learned) -> tuple[float, float]:
    """Return by how much a curve errs over the law's rms, and together with names beside it."""
    low, high = np.clip(np.quantile(one.states, (0.01, 0.99)), *_ends(curve.seen))
    s = np.linspace(low, high, 100)
    truth = bent(law.along({law.first.argument: s}), s)
    named = curve.named_at(s)
    alone = law_at(curve.physics, s)

    def errs(ours: Floats) -> float:
        scale = _scale(law, float(truth @ ours) / max(float(truth @ truth), 1e-300))
        off = bent(ours / scale, s) - truth
        return float(np.std(off) / max(np.std(truth), 1e-300))

    return errs(alone), errs(alone + named)


def apart_over_two(one: Drawn, law: Law, surface: Surface) -> tuple[float, bool]:
    """Return by how much a surface errs over the law's rms along the samples, and whether nine of
    ten lie in its band; both without a plane, and of a law over the command where that acts without
    its scale."""
    assert law.second is not None
    arguments = (law.first.argument, law.second.argument)
    order = [[NAMED[a] for a in arguments].index(s) for s in surface.states]
    low, high = _ends(surface.seen)
    states = one.states[np.all((one.states[:, order] >= low) & (one.states[:, order] <= high), 1)]
    truth = law.along(dict(zip(arguments, states.T, strict=True)))
    first, second = states[:, order].T
    ours, half = surface.at(first, second), surface.half(first, second)
    flat = np.column_stack([np.ones(truth.size), states])

    def off(values: Floats) -> Floats:
        return values - flat @ np.linalg.lstsq(flat, values, rcond=None)[0]

    scale = 1.0
    if "command" in arguments and law.at in ("m1", "command"):
        bend = off(truth)
        scale = _likely_scale(float(bend @ off(ours)) / max(float(bend @ bend), 1e-300))
    errs = np.abs(off(ours / scale - truth))
    half, ours = half / scale, ours / scale
    size = float(np.std(off(truth)))
    inside = float(np.mean(errs < half + COARSE * float(np.abs(ours).max())))
    return float(np.sqrt(np.mean(errs**2))) / size, inside > INSIDE


def _scale(law: Law, told: float) -> float:
    """By what a law is larger that no motion tells: of one over the command, as masses may be."""
    return _likely_scale(told) if law.at == "command" else 1.0


def _likely_scale(told: float) -> float:
    return float(np.clip(told, 1.0 / MOST_OFF, MOST_OFF))


def within(law: Law, curve: Learned) -> bool:
    """Return whether a curve's band holds the law."""
    at = curve.states[1:] if curve.odd else curve.states
    known = curve.covariance[1:, 1:] if curve.odd else curve.covariance
    forces = curve.forces[1:] if curve.odd else curve.forces
    own = law.along({law.first.argument: at})
    bend = bent(own, at)
    own = own * _scale(law, float(bend @ forces) / max(float(bend @ bend), 1e-300))
    known = known + np.eye(at.size) * (COARSE * float(np.abs(forces).max())) ** 2
    columns = np.column_stack([np.ones(at.size), at])
    weigh = np.linalg.inv(np.linalg.cholesky(known))
    off = weigh @ (forces - own)
    off -= weigh @ columns @ np.linalg.lstsq(weigh @ columns, off, rcond=None)[0]
    return bool(chi2.sf(float(off @ off), max(1, at.size - 2)) > WITHIN)


def _placed(
    one: Drawn, law: Law, found: LearnedLaw | LearnedSurface | None
) -> tuple[bool, list[float], bool]:
    """Whether what was learned stands where a law does, by how much it errs, and the band holds."""
    if isinstance(found, LearnedSurface):
        curve = found.curve
        at = "m1" if law.at == "command" else law.at
        two = law.second is not None and curve.physics.at == at
        arguments = [law.first.argument, law.second.argument] if law.second is not None else []
        if not two or {NAMED[a] for a in arguments} != set(curve.states):
            return False, [], False
        err, inside = apart_over_two(one, law, curve)
        return True, [err], inside
    if found is None or law.second is not None:
        return False, [], False
    own = found.curve.physics
    if own.effect.name != STATES[law.first.argument] or own.at != law.at:
        return False, [], False
    return True, list(apart(one, law, found.curve)), within(law, found.curve)


def main() -> None:
    """Print a line for each recording, and the tally."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--two", action="store_true")
    asked = parser.parse_args()
    near: list[bool] = []
    alone: list[bool] = []
    placed: list[bool] = []
    false: list[bool] = []
    gone: list[float] = []
    for index in range(asked.first, asked.first + asked.count):
        one = drawn(asked.seed, index, asked.two)
        since = time.perf_counter()
        recordings = stretches(one.trace, one.device, "run")
        found = diagnose(one.device, recordings, effort=replace(QUICK, surfaces=asked.two))
        spent = time.perf_counter() - since
        law, fit = found.learned, found.free_run
        what = "nothing" if one.law is None else one.law.text
        names = ", ".join(f"{f.effect} at {f.at}" for f in found.findings)
        line = f"{index:4d} {found.verdict.value:16s} [{names}]"
        after = fit.after if law is None else law.law.after
        if one.law is None:
            false.append(law is not None)
        else:
            (first, *_) = (name for name in one.trace.channels if name != "command")
            counted = found.searched.problem.experiments[0].outputs[0].name != first
            least = max(one.floors[counted], fit.noise_floor)
            share = (fit.refit - after) / max(fit.refit - least, 1e-12)
            gone.append(share)
            line += f" gone {100.0 * share:.1f} %"
            right, errs, inside = _placed(one, one.law, law)
            placed.append(right)
            held = right and min(errs) < NEAR
            by_itself = right and (inside or errs[0] < NEAR)
            held = held or by_itself
            if right:
                each = ", together ".join(f"{100.0 * err:.1f} %" for err in errs)
                line += f" errs {each}, within {inside}"
            near.append(held)
            alone.append(by_itself)
        if law is not None:
            own = law.curve.physics
            line += f" learned {own.effect.name} at {own.at} over {law.over}:"
            line += f" {law.formula or 'no form'}; {law.absorbed}"
        print(f"{line} | {one.law.at if one.law else ''} {what} {spent:.0f} s", flush=True)
    print(f"a law at its place: {sum(placed)} of {len(placed)}")
    print(f"form recovered: {sum(near)} of {len(near)}, by the curve alone {sum(alone)}")
    if gone:
        print(f"held-out error that is gone, median: {100.0 * float(np.median(gone)):.1f} %")
    print(f"learned of none: {sum(false)} of {len(false)}")


if __name__ == "__main__":
    main()
