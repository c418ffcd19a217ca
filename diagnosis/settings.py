"""The numbers that decide the result of a diagnosis.

One frozen class for each part of the pipeline, one field for each number. Below each number are its
unit, its origin (derived, by convention, elicited from engineers, or tuned) and the data behind it.
Numbers that only control a method (rounds of a solver, a guard against rounding) are kept with the
method.

The numbers of other parts are at the top of their modules.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Evidence:
    """When one hypothesis is believed over another."""

    alpha: float = 1e-3
    """Largest probability of believing a wrong hypothesis over the right one. Convention."""

    blocks: int = 40
    """Stretches of the recordings over which gains are compared. Tuned: fewer than ten say little
    about their scatter, and a stretch must be longer than the memory of the errors."""

    rare: float = 1e-3
    """Probability of an effect whose file does not give one. Elicited: rarer than any in the
    library."""

    as_well: float = 10.0
    """In -2 ln: an alternative that costs at most this much more explains equally well, such as
    another place of an event or another course of a change. Convention: odds of 150 to 1."""

    levels_differ: float = 0.1
    """Share of the command's largest level by which levels differ at least, if a change may go with
    them. Convention: commands drawn twice from one distribution differ by less."""

    once: float = 0.05
    """Probability of an event in a recording, and of a change of a parameter. Elicited."""

    told: float = 3.84
    """Chi-square within which a number is in its 95 % interval. Derived."""

    dated: float = 7.352
    """The same for the time of a step: -2 ln (1 - sqrt(0.95)) (Hansen, Econometrica 68, 2000).
    Derived."""

    finest: float = 2e-5
    """Share of a value that its standard error is at least: an observer is an approximation if
    friction lets go between samples. Tuned: on the sample bench, with a standard error of 4e-6, the
    level of gravity is 2e-5 off, whatever the substeps."""

    @property
    def rarity_of_once(self) -> float:
        """The penalty of a change or an event for being rare, in -2 ln."""
        return 2.0 * math.log((1.0 - self.once) / self.once)


@dataclass(frozen=True)
class Pursuit:
    """Which hypotheses a search continues with."""

    near_rival: float = 40.0
    """In -2 ln: a hypothesis that costs at most this much more than the best is fitted to the end,
    as a rival. Tuned, no data kept."""

    hopeless: float = 200.0
    """In -2 ln: a hypothesis that costs this much more than the best of its view or round is not
    fitted further. Tuned, with one check: five recordings of the paired set kept their effects when
    it was applied to all candidates."""

    lagging: float = 0.2
    """Share of everything the best explains by which another may lag behind it, once it has its own
    noise, and still be fitted to the end. Tuned: on a rig of four effects with play, such fits
    gained 0.01 to 0.08 of it. Also the share by which a fit that has not ended may lag behind over
    a longer horizon before it is clearly worse there (`selection.slower`)."""

    farther: float = 3.0
    """Ratio of the simulations of the search over a longer horizon to all before it, after which
    this search ends with its best so far. Convention: on five recordings of an exam it took 0.1 to
    1.5 times as many, on a sixth, where little came before, eight times; a seventh, with physics
    that is in no library, had not ended after nine times its CPU time."""

    at_least_farther: float = 20_000.0
    """Simulations of all recordings that this search may take in any case; the one on which little
    came before took 10 000."""

    no_sign: float = 10.0
    """Chi-square to first order, below which a start is not significant. Tuned: the noise of a few
    samples."""

    glance: int = 2000
    """Ticks of all recordings in which strong effects are sought first. Tuned: see
    benchmarks/notes/performance.md, The account."""

    worth_a_glance: int = 3
    """Total length of recordings, as a multiple of `glance`, from which this first search is made.
    Derived: if it finds nothing, it has cost a third of a search of everything."""

    rival_share: float = 0.3
    """Share of what an effect explains that another must explain to first order to be fitted in its
    place, beyond `hopeless`; also the share of the first of a view that others must explain to be
    fitted too. Tuned, as `glance`: each effect that was accepted on four recordings of the
    paired set explained 0.9 of the most in at least one view."""

    loose_mass: float = 0.05
    """Standard error of the logarithm of a mass, from which a refit also begins with mass on the
    other side of a link (`selection.across`). Tuned: of 42 recordings of an exam with several
    masses, 31 have no such mass, which costs them nothing; on 3 of the other 11 the refit was in
    the wrong minimum."""

    clear_sign: float = 50.0
    """Chi-square to first order in these ticks, from which a start is fitted without the rest of
    the recordings. Tuned, as `glance`."""


@dataclass(frozen=True)
class Adequacy:
    """When free runs on held-out data speak against an answer (`answer.adequacy`)."""

    horizons: tuple[float, ...] = (0.05, 0.5, 2.0)
    """Seconds that free runs last. Tuned: to where lags, masses and drifts show."""

    runs: int = 3
    """Number of free runs of one length below which no judgement is made. Convention."""

    louder: float = 3.0
    """Largest strength of the noise, relative to where it was fitted. Convention."""

    follows: float = 5.0
    """Sigma from which on noise counts as louder where the command changes. Convention."""

    chance: float = 0.1
    """Largest error of free runs beyond the noise of readings, over the motion. Tuned: a rig of
    five masses had an error of 0.42 by missing physics, with noise that predicted it."""

    led: float = 0.1
    """Share of the squared error that forces along the motion may always explain. Tuned, no data
    kept."""

    scatter: float = 1.0
    """Sigma over stretches by which an answer must be better than the device without it.
    Convention."""

    apart: float = 2.0
    """Sigma by which the free runs of one answer must be better than another's. Convention."""

    matters: float = 1.02
    """Factor of an error of free runs that matters in practice. Convention."""

    often: float = 0.01
    """Probability, by signed ranks, below which a law's free runs count as better. Convention."""


@dataclass(frozen=True)
class Verdict:
    """Which verdict an answer gets (`answer.verdict`)."""

    apart: float = 5.0
    """Sigma within which a rival cannot be distinguished from a finding, and by which a linear
    parameter must differ from the device file's. Convention: five sigma."""

    sure: float = 0.95
    """Probability of an effect or a richer form of it, below which it is not called identified.
    Convention."""

    left_white: float = 0.01
    """Share of the chi-square explained that may be left beside named effects. Tuned, no data
    kept."""

    left_coloured: float = 0.05
    """As `left_white`, if a longer horizon was tried, where the gain does not follow a chi-square
    distribution. Tuned, no data kept."""

    unnamed: float = 60.0
    """Chi-square, over the inflation of the residual, that a force without a name must gain beyond
    1.5 for each of its unknowns. Tuned, no data kept."""

    worth_a_law: float = 0.8
    """Ratio of errors of free runs with a learned law and without, below which the law is worth
    having. Tuned: nobody would act on less, and of 13 recordings without a law one got a law that
    left 0.94 (`benchmarks.learned_laws`)."""

    known_law: float = 0.5
    """Half of a learned curve's 95 % band over its part that is not straight, both rms, above which
    an answer predicts a new command by its named effects alone. Tuned on two machines' training
    data: 0.04 for a spring that moves over all of its range, 0.88 for friction in a recording that
    dwells at three speeds (`python -m benchmarks.official`)."""

    worse_force: float = 1.05
    """Ratio to the refit's error, of the force that the recorded motion needs, above which an
    answer is rejected. Tuned: on eight machines' pages answers have 0.2 to 0.6."""

    worse_run: float = 1.5
    """As `worse_force`, for whole runs, which drift. Tuned, as `worse_force`."""

    as_much: float = 0.8
    """Share of what a force over one quantity explains, from which a force over another is named
    beside it. Convention: a smaller difference does not show what the force depends on."""

    worse_file: float = 1.2
    """Ratio to the error of the device file, from which a user is warned of an answer.
    Convention."""


@dataclass(frozen=True)
class Intake:
    """When a recording itself counts as wrong (`intake`).

    Each was tuned on the recordings of machines and on faults put into them
    (`benchmarks.sown_faults`), unless stated otherwise.
    """

    better: float = 1.5
    """Factor of the rms prediction error by which another reading of a recording must be better."""

    smooth: float = 1.3
    """As `better`, for a command that is smooth between its samples."""

    exchanged: float = 2.0
    """As `better`, for exchanged outputs: a device file may be wrong by half in every number."""

    certain: float = 3.0
    """As `better`, for a wrong sign or unit that no physics can explain."""

    clear: float = 40.0
    """-2 ln likelihood from which a command shows in a motion, so that other scales are tried."""

    surely: float = 100.0
    """-2 ln likelihood from which a command counts as late or exchanged."""

    known: float = 10.0
    """-2 ln likelihood from which an observer determines the delay of a command."""

    share: float = 0.25
    """Share of everything a command explains that another scale must explain in addition."""

    off: float = 2.5
    """Factor by which a device file may be wrong in the effect of the command."""

    alike: float = 1.1
    """Tolerance of the slope of a position against the integrated velocity of the same motion. No
    two units are so close, and no filter of a device changes the slope as much."""

    sign_off: float = 3.0
    """As `off`, for a wrong sign: a wrong unit together with it is rare."""

    weak: float = 0.5
    """Scale below which a command is far too large, which noise does not cause."""

    power: float = 0.1
    """Share of the largest energy that a command could take from a device, from which its sign is
    known."""

    left_open: float = 3.0
    """Standard deviations of the command's scale, or of masses, that a device file allows.
    Convention."""

    near_unit: float = 1.5
    """Factor within which a scale from a rough device file counts as a unit."""

    far_unit: float = 20.0
    """Factor that saturation, stiction or the masses of another machine do not cause, only a
    unit."""

    unit_odds: float = 1e-2
    """Probability that a recording has a wrong sign, or a unit that is mistaken for the SI.
    Elicited."""

    factor_odds: float = 1e-4
    """Probability that a channel has a wrong scale that is not a unit. Elicited."""

    factor_width: float = 0.2
    """Uncertainty of the logarithm of such a factor, by masses, springs and gain of a file."""

    tone: float = 0.95
    """Share of a command's power in one line of its spectrum, above which exchanged columns cannot
    be seen."""

    half: float = 0.5
    """Ratio of the unexplained shares with exchanged columns and as described."""

    whole: float = 0.1
    """Share of a step by which values may differ from a lattice."""

    turning: float = -0.38
    """Correlation of neighbouring errors, below which they are those of a differenced position.
    Derived: relative to a smooth curve, white noise has -0.35 (0.01 about that in 1000 samples), a
    difference -0.41 to -0.53."""

    worked_out: float = 0.02
    """Share of the roughness of a velocity, below which the error of a filtered position means that
    the velocity is not a separate measurement."""

    clipped: float = 0.005
    """Share of the samples of a command at its largest value. Convention."""

    repeats: float = 0.02
    """Share of the samples of an output that repeat the one before. Convention."""


@dataclass(frozen=True)
class Laws:
    """When a law is learned, and which formula it is given."""

    stands_for: int = 2
    """Number of named effects that it must make unnecessary to replace them. Convention."""

    comes_back: float = 1.5
    """How often each value of a state must be visited, on average, for a law over it: a law over a
    state that is visited once is one of time. Tuned, no data kept."""

    points: int = 16
    """Initial number of points of a table. Tuned: see docs/learned.md."""

    hope: float = 20.0
    """In -2 ln: how much more than the named effects a law with all its points may cost before the
    points that pay are sought. Tuned, no data kept."""

    within: float = 0.01
    """Probability of a distance as large, above which a formula is within the band. Convention."""

    close: float = 6.0
    """In -2 ln: formulas that cost at most this much more than the best are listed beside it.
    Convention: the 95 % of two numbers."""

    even: float = 2.0
    """The same, within which the formula of fewer numbers comes first. Convention."""


@dataclass(frozen=True)
class Changes:
    """Limits of changes in a recording."""

    most: int = 3
    """Number of changes that are sought, one after the other. Convention."""


@dataclass(frozen=True)
class Events:
    """Limits of events in a recording."""

    most: int = 4
    """Largest number of events in all recordings: more are missing physics. Convention."""

    longest_s: float = 3.0
    """[s] Longest event. Convention: what lasts longer is a change."""

    longest_share: float = 0.2
    """The same as a share of the recording. Convention."""

    opposed: float = 1.0 / 3.0
    """Share of the larger impulse from which one against it means that a short force pushes both
    ways. Convention: what a fit adds beside a hit is less. None of the hits and stops among the
    14 events of `benchmarks.events --named --count 30 --seed 92001` had it."""

    apart_s: float = 0.4
    """[s] Distance between two pulses from which they are two events, if neither lasts as long.
    Convention."""


@dataclass(frozen=True)
class FreeForces:
    """When a force of free shape is reported, beside named effects or in their place."""

    odds: float = 1e8
    """Number of recordings of white noise of which one has a line as strong as a reported one.
    Tuned, no data kept: real noise is more than noise with the residual's spectrum and envelope."""

    over_time: float = 300.0
    """In -2 ln, what a force over time alone must gain: less is slow noise. Tuned, no data kept."""

    weak: float = 200.0
    """The same, below which a slower observer must agree. Tuned, no data kept."""

    rather: float = 25.0
    """The same, by which it must be more likely than a named effect. Derived: five sigma of one
    number."""

    doubt: float = 9.0
    """The same, from which such a law is a rival of the named effect. Derived: three sigma of one
    number."""

    part: float = 0.5
    """Share of what named effects explain that it must explain to first order to be fitted. Tuned,
    no data kept."""


EVIDENCE, PURSUIT, ADEQUACY, VERDICT = Evidence(), Pursuit(), Adequacy(), Verdict()
INTAKE = Intake()
LAWS, CHANGES, EVENTS, FREE_FORCES = Laws(), Changes(), Events(), FreeForces()
