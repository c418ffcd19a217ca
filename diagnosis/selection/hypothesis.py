"""A hypothesis: a structure, its parameters, a noise model, and their cost."""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import creased, descend, slopes_where_it_stands
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.fitting.uncertainty import shared
from zwidth.diagnosis.model.parameters import Model, effect_labels
from zwidth.diagnosis.noise.family import NEXT_SAMPLE, Family, Motions, Noise, likeliest
from zwidth.diagnosis.noise.gaps import with_play
from zwidth.diagnosis.noise.predictor import FINAL, SCREENING, SEARCHING, Fineness
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.evidence import Compared, Cost, compared, freedom, rarity
from zwidth.diagnosis.settings import EVIDENCE
from zwidth.sim.physics.sizes import SMALLEST

Floats = NDArray[np.float64]
Prices = tuple[tuple[str, float], ...]
SWEEP = -math.log(SMALLEST)  # ln of the range of a magnitude, equally likely in every octave
SHORTEST_BLOCK = 50  # samples
MOST_TURNS, MUCH = 10, 10.0  # turns of a fit; gain in misfit that justifies a further one
WORTH = 1.0  # gain in misfit below which a fit has ended
MORE = 2.0  # the same gain, for a fit to the end
FARTHER = (2.0, 4.0)  # times the step of a turn, each from the end of the one before
HORIZONS = 4.0  # horizons over which the dependence of errors is measured
FURTHER = 3  # new fits after one that ended at its largest allowed distance
EDGE = 1e-3  # in x, from a bound on which a fit has ended
UNSEEN = 1e-9  # information on x, relative to the device file's own


@dataclass(frozen=True)
class Hypothesis:
    """Structure and parameters (model, x) for recordings, noise, and their cost.

    experiments: the recordings, with corrections of the structure (lost commands, errors of encoder
    steps). blocks: -2 log likelihood by stretches of the recordings. residual: weighted innovations
    and priors with the noise; slopes: its derivatives by x, None if they were not computed. family:
    the noise family from which noise was chosen; only costs within one family can be compared.
    prices: penalties, in -2 ln, of effects (effect@place) that were sought tick by tick. ended:
    whether another round of fit and noise is known to gain nothing.
    """

    experiments: Sequence[Experiment]
    model: Model
    x: Floats
    noise: Noise
    cost: Cost
    blocks: Floats
    residual: Floats
    slopes: Floats | None = None
    family: Family = NEXT_SAMPLE
    prices: Prices = ()
    ended: bool = False

    @cached_property
    def labels(self) -> frozenset[str]:
        """effect@place of each effect."""
        return frozenset(effect_labels(self.model.effects))

    @property
    def creased(self) -> bool:
        """Whether the prediction is a nonsmooth function of the parameters."""
        return creased(self.model)

    @property
    def has_valleys(self) -> bool:
        """Whether a fit ends in the valley of the cost where it began."""
        return with_play(self.model.effects)

    @property
    def against_physics(self) -> str:
        """A parameter or combination that is not physical, "" for none.

        That is a parameter on a physical bound (`Parameter.ends`) or a forbidden combination
        (`Effect.forbidden`).
        """
        return next((name for name, _ in self._unphysical), "")

    @property
    def shrunk(self) -> str:
        """The only effect (effect@place) that is not physical, "" if there is not exactly one."""
        whose = {label for _, label in self._unphysical}
        return whose.pop() if len(whose) == 1 else ""

    @property
    def _unphysical(self) -> Iterator[tuple[str, str]]:
        """What is not physical, and the effect to which it belongs, "" for the device."""
        labels = effect_labels(self.model.effects)
        for p, x in zip(self.model.parameters, self.x, strict=True):
            if p.at_end(float(x), p.ends, EDGE):
                yield p.name, labels[p.index] if p.kind == "effect" else ""
        for effect, label in zip(self.model.effects_at(self.x), labels, strict=True):
            if wrong := effect.effect.forbidden(dict(effect.values)):
                yield wrong, label

    @property
    def ratio(self) -> float:
        """The observer's ratio."""
        return self.noise.observer.ratio

    @property
    def problem(self) -> Problem:
        """The recordings with the hypothesis's noise."""
        return self.noise.problem(self.experiments)

    @property
    def ground(self) -> Landscape:
        """The cost over x, with the hypothesis's model and noise."""
        return self._ground(SEARCHING)

    @property
    def far_ground(self) -> Landscape:
        """The same with few substeps, which suffice to compare costs early in a search."""
        return self._ground(SCREENING)

    def _ground(self, fineness: Fineness) -> Landscape:
        problem = self.problem
        return Landscape(problem.experiments, problem.observer, self.model, fineness)

    @property
    def samples(self) -> int:
        """Number of weighted innovations in the residual."""
        return self.residual.size - sum(p.prior for p in self.model.parameters)

    def in_finer_steps(self) -> "Hypothesis":
        """Return the hypothesis with its cost in the substeps of final fits, all else unchanged."""
        (finer,) = self._ground(FINAL).costs([self.x])
        return replace(self, cost=replace(self.cost, misfit=float(finer)))

    def less(self, index: int) -> "Hypothesis | None":
        """Return the hypothesis without one effect, not fitted again; None without an observer."""
        model, x = self.model.less(self.x, index)
        near, motions = self.family.near(self.ratio), self.noise.motions
        with suppress(NoObserver):
            return judged(self.experiments, model, x, self.family, near, self.prices, motions)
        return None

    def moved(self, x: Floats) -> "Hypothesis":
        """Return the hypothesis at another x, with the best noise near its own."""
        return self._at(x, self.family.near(self.ratio))

    def anew(self, x: Floats) -> "Hypothesis":
        """Return the hypothesis at another x, with the best noise of the whole family."""
        return self._at(x, self.family)

    def under(self, ratio: float) -> "Hypothesis":
        """Return the hypothesis with the noise of one ratio; may raise NoObserver."""
        return self._at(self.x, self.family.of(ratio))

    def on(self, experiments: Sequence[Experiment]) -> "Hypothesis":
        """Return the hypothesis on other recordings with the same noise; may raise NoObserver."""
        there = judged(
            experiments, self.model, self.x, self.family, self.family.of(self.ratio), self.prices
        )
        problem = Problem(there.problem.experiments, self.noise.observer)
        weighed = problem.weighted(self.model, self.x)
        noise = replace(there.noise, observer=self.noise.observer, weighed=weighed)
        residual = np.concatenate([weighed, there.residual[weighed.size :]])
        return replace(there, noise=noise, residual=residual)

    def _at(self, x: Floats, among: Family) -> "Hypothesis":
        motions = self.noise.motions
        return judged(self.experiments, self.model, x, self.family, among, self.prices, motions)

    @property
    def fitted(self) -> Fitted:
        """The hypothesis as a fit; only after `priced`."""
        assert self.slopes is not None
        chi2 = float(self.residual @ self.residual)
        return Fitted(self.model, self.x, chi2, self.residual, self.slopes, self.samples)


def judged(
    experiments: Sequence[Experiment],
    model: Model,
    x: Floats,
    family: Family = NEXT_SAMPLE,
    among: Family | None = None,
    prices: Prices = (),
    motions: Motions = None,
) -> Hypothesis:
    """Return a model at x with its most likely noise; raises NoObserver if none is possible.

    among: the members of the family that are tried, None for all. prices: ignored for effects that
    the model lacks. motions: as in `noise.family.likeliest`.
    """
    labels = effect_labels(model.effects)
    paid = tuple((label, price) for label, price in prices if label in labels)
    noise = likeliest(experiments, model, x, among or family, motions)
    there = noise.problem(experiments)
    ground = Landscape(there.experiments, there.observer, model, SEARCHING)
    residual = np.concatenate([noise.weighed, x[ground.priors]])
    own = {p.name for p in model.parameters if p.kind == "change"}
    changes = sum(v.price for v in model.varying if v.name in own)
    searched = sum(price for _, price in paid) + changes
    known = Cost(ground.cost(residual), rarity=_rarity(model), searched=searched)
    blocks = _blocks(ground, residual)
    return Hypothesis(experiments, model, x, noise, known, blocks, residual, None, family, paid)


def independent(h: Hypothesis, horizon: float) -> Hypothesis:
    """Return a hypothesis whose likelihood counts only independent errors.

    Errors over a horizon [s] are dependent, tau at a time (`shared`), so one hypothesis gains by
    chance tau times as much over another as with independent errors. If all n samples counted, laws
    would be found in chance. So the likelihood, its slopes and the penalty of a parameter all count
    1 / tau times (the power of Bissiri, Holmes & Walker, J. R. Stat. Soc. B 78, 2016). On a motor
    under white force with one known friction, the phi of any further effect over 50 ms is 20 to 90
    if each sample counts, and 1.0 to 1.4 with this.
    """
    if h.family.whitening:
        return h
    first = h.experiments[0]
    segment = max(SHORTEST_BLOCK, round(HORIZONS * horizon / first.period))
    tau = shared(h.residual[: h.samples].reshape(-1, len(first.outputs)), segment)
    return judged(h.experiments, h.model, h.x, replace(h.family, counts=1.0 / tau), None, h.prices)


def settled(
    begun: Hypothesis, turns: int = 3, rounds: int = 6, *, to_the_end: bool = False
) -> Hypothesis:
    """Fit and choose the noise again, in turn, until neither gains; then price the parameters.

    The first round uses as few substeps as suffice to compare costs, which brings the fit most of
    the way. (A noise chosen at wrong parameters attributes their errors to disturbances. But making
    each round with a slower noise too gained less than 1 in -2 ln on two masses with two frictions,
    from six device files up to 60 % off, and changed no effect on eleven recordings of the paired
    set.) turns: the most, but more while they gain much. A fit that ends at the limit of its
    allowed distance from the start (`Parameter.walks`) has not converged, and continues.

    to_the_end: continue while a turn gains anything or changes the noise, which moves the minimum,
    and continue along each turn's step (`_farther`). Without this, a clean machine of three masses
    ended 16 in -2 ln too high, with half of its parameters off by 3 to 5 sigma. It is used for an
    answer without effects and for near rivals. Where physics is missing, a refit that is fitted to
    the end imitates it: a search that began there lost the friction of a rack and of two other
    machines. Used in all fits, it made tables of a law take about four times as long.
    """
    best = _settled(begun, turns, rounds, to_the_end)
    for _ in range(FURTHER):
        walked = (
            p.at_end(float(x), p.walks, EDGE)
            for p, x in zip(best.model.parameters, best.x, strict=True)
        )
        if not any(walked):
            break
        model, x = best.model.begun_at(best.x)
        near = best.family.near(best.ratio)
        again = judged(best.experiments, model, x, best.family, near, best.prices)
        best = _settled(again, turns, rounds, to_the_end)
    if best.has_valleys:  # find the motions again
        near = best.family.near(best.ratio)
        anew = judged(best.experiments, best.model, best.x, best.family, near, best.prices)
        best = replace(anew, ended=best.ended) if anew.cost.misfit < best.cost.misfit else best
    return priced(best)


def _settled(begun: Hypothesis, turns: int, rounds: int, to_the_end: bool) -> Hypothesis:
    best, gained, same = begun, math.inf, False
    for turn in range(MOST_TURNS):
        if turn >= turns and (gained < MORE and same if to_the_end else gained < MUCH):
            break
        own = best.moved(_descended(best, rounds, turn > 0))
        if to_the_end and turn and best.cost.misfit - own.cost.misfit > WORTH:
            own = _farther(best, own)
        gained, same = best.cost.misfit - own.cost.misfit, own.ratio == best.ratio
        if gained > 0.0:
            best = own
        if gained < WORTH and (turn or gained <= 0.0):
            return replace(best, ended=True)
    return best


def _farther(before: Hypothesis, own: Hypothesis) -> Hypothesis:
    """Go on along a turn's step while that costs less.

    A turn ends at the least cost under the noise and the observer of the turn before, and so on the
    way to where they are best, too: its steps shrink by a ratio, of which the limit is a multiple.
    """
    for times in FARTHER:
        x = before.model.within(before.x + times * (own.x - before.x))
        far = before.moved(x)
        if not far.cost.misfit < own.cost.misfit:
            break
        own = far
    return own


def _descended(h: Hypothesis, rounds: int, fine: bool) -> Floats:
    ground = h.ground if fine else h.far_ground
    return descend(ground, h.x, rounds, h.creased, first=not (fine or h.has_valleys)).x


def priced(h: Hypothesis) -> Hypothesis:
    """Return the hypothesis with its slopes, and with the penalty of its parameters.

    The penalty is infinite if the recordings do not determine a parameter of an effect: they can
    then show only a simpler one.
    """
    slopes = slopes_where_it_stands(h.ground, h.x).slopes
    information, parameters = slopes.T @ slopes, h.model.parameters
    asked = ("effect", "change")
    if any(
        p.kind in asked and information[i, i] < UNSEEN and not h.model.is_linear(p)
        for i, p in enumerate(parameters)
    ):
        return replace(h, slopes=slopes, cost=replace(h.cost, freedom=math.inf))
    # Skips the origin of positions (no prior) if only velocities are recorded: for all hypotheses.
    seen = [i for i, p in enumerate(parameters) if p.prior or information[i, i] > UNSEEN]
    # A uniform range R has the variance R^2 / 12, which limits the uncertainty of every direction:
    # else a parameter that is equivalent to the origin of positions would cost nothing.
    ranges = _ranges(h.model, h.x, information)
    own = [i for i, p in enumerate(parameters) if not h.model.is_linear(p)]
    known = information.copy()
    known[own, own] += 12.0 / np.square(ranges)
    paid = freedom(known[np.ix_(seen, seen)], ranges)
    return replace(h, slopes=slopes, cost=replace(h.cost, freedom=paid))


def _rarity(model: Model) -> float:
    return rarity([p.effect.prior_at(p.place) or EVIDENCE.rare for p in model.effects])


def _ranges(model: Model, x: Floats, information: Floats) -> list[float]:
    """Range of each effect parameter in x, at least its own standard error.

    A magnitude is equally likely in every octave of its sweep: its density at v is 1 / (v ln(most /
    least)), so its range is v ln(most / least). A phase is uniform over its turn. A change is
    uniform up to the size of the changing parameter, in both directions.
    """
    variance = np.diag(np.linalg.pinv(information))
    found: list[float] = []
    for i, p in enumerate(model.parameters):
        if model.is_linear(p):
            continue
        if p.kind == "change":
            spread = math.sqrt(max(float(variance[i]), 1e-300))
            found.append(max(2.0 * model.size_of(p.index, x), spread))
        if p.kind != "effect":
            continue
        physics = model.effects[p.index]
        declared = physics.effect.parameter(p.key)
        if declared.role == "turning":
            found.append(2.0 * math.pi / p.scale)
            continue
        value = physics.values[p.key] / p.scale + float(x[i])
        none = declared.none_of_it()
        size = abs(value - (none / p.scale if math.isfinite(none) else 0.0))
        found.append(SWEEP * max(size, math.sqrt(max(float(variance[i]), 1e-300))))
    return found


def _blocks(ground: Landscape, residual: Floats) -> Floats:
    """-2 log likelihood over stretches of the recordings, (blocks,); they sum to the total."""
    observer = ground.problem.observer
    o = observer.deviation.size
    rows = residual[: residual.size - int(np.count_nonzero(ground.priors))].reshape(-1, o)
    moments = rows.T @ rows
    count = rows.shape[0]
    known = observer.told * count
    each = float(observer.cost_of(moments[None], count)[0]) / known
    inverse = np.linalg.pinv(moments / known)
    squares = np.einsum("ki,ij,kj->k", rows, inverse, rows)
    own = observer.counts * squares + observer.told * (each - observer.counts * o)
    pieces = max(1, min(EVIDENCE.blocks, count // SHORTEST_BLOCK))
    return np.array([part.sum() for part in np.array_split(own, pieces)])


def gains(new: Hypothesis, old: Hypothesis) -> Floats:
    """The gain of one hypothesis over the other in each stretch (blocks,)."""
    return old.blocks - new.blocks


def against(new: Hypothesis, old: Hypothesis) -> Compared:
    """The gain of one hypothesis over the other, and its scatter about the predicted gain."""
    if new.samples != old.samples:
        return compared(gains(new, old))
    outputs = new.noise.observer.deviation.size
    apart = (old.residual[: old.samples] - new.residual[: new.samples]).reshape(-1, outputs)
    rows = new.residual[: new.samples].reshape(-1, outputs)
    inverse = np.linalg.pinv(rows.T @ rows / rows.shape[0])
    squares = np.einsum("ki,ij,kj->k", apart, inverse, apart)
    foretold = [part.sum() for part in np.array_split(squares, new.blocks.size)]
    return compared(gains(new, old), np.array(foretold))
