"""The numbers that decide what a diagnosis says.

One frozen class for each part of the pipeline, one field for each number. Below each number are its
unit, its origin (derived, by convention, elicited from engineers, or tuned) and the data behind it.
Numbers that only control a method (rounds of a solver, a guard against rounding) are kept with the
method.

Here are those of the search, the intake, the answer, of laws without a name, and of what changes or
happens. Those of other parts stand at the top of their modules, and move here when these are
rebuilt.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Evidence:
    """When one hypothesis is believed over another."""

    alpha: float = 1e-3
    """Odds at which what is not true is believed over what is. Convention."""

    blocks: int = 40
    """Stretches of the recordings over which gains are compared. Tuned; fewer than ten say little
    of their spread, and a stretch must be longer than errors depend on each other."""

    rare: float = 1e-3
    """Probability of an effect that says nothing of how common it is. Elicited: rarer than any in
    the library."""

    as_well: float = 10.0
    """In -2 ln: what costs no more than this beyond the best explains as well, as another place of
    an event or another course of a change. Convention: odds of 150 to 1."""

    once: float = 0.05
    """Probability that something happens once in a recording, and that a parameter changes.
    Elicited."""

    told: float = 3.84
    """Chi-square within which a number is in its 95 % interval. Derived."""

    dated: float = 7.352
    """The same of the time of a step: -2 ln (1 - sqrt(0.95)) (Hansen, Econometrica 68, 2000).
    Derived."""

    @property
    def rarity_of_once(self) -> float:
        """What a change or an event costs for being rare, in -2 ln."""
        return 2.0 * math.log((1.0 - self.once) / self.once)


@dataclass(frozen=True)
class Pursuit:
    """What a search goes on with."""

    near_rival: float = 40.0
    """In -2 ln: what costs no more than this beyond the best is fitted to its end, as a rival.
    Tuned, no data kept."""

    hopeless: float = 200.0
    """In -2 ln: what costs as much more than the best of its view or round is not fitted further.
    Tuned, with one check: five recordings of the paired set kept their names when it was applied
    to all candidates."""

    lagging: float = 0.2
    """Of all that the best explains, by which another may lag behind it once its noise is its own
    and still be fitted to its end. Tuned: on a rig of four effects with play such fits gained 0.01
    to 0.08 of it. Also what is not fitted to its end may lag behind over a longer horizon before it
    is clearly worse there (`selection.slower`)."""

    no_sign: float = 10.0
    """Chi-square to first order, below which a start says nothing. Tuned: the noise of a few
    samples."""

    glance: int = 2000
    """Ticks of all recordings in which what is strong is looked for first. Tuned: see
    docs/performance.md, The account."""

    worth_a_glance: int = 3
    """Times as long as a glance are recordings of which one is taken. Derived: a glance in vain
    costs a third of a look at all of them then."""

    rival_share: float = 0.3
    """Of what an effect explains, that another must explain to first order to be fitted in its
    place, beyond `hopeless`; and of what the first of a view does, to be fitted beside it. Tuned,
    as `glance`; of the effects that were taken on four recordings of the paired set each explained
    0.9 of the most in one view at least."""

    clear_sign: float = 50.0
    """Chi-square to first order in these ticks, from which a start is fitted without looking at the
    rest. Tuned, as `glance`."""


@dataclass(frozen=True)
class Adequacy:
    """When free runs on data that was kept out speak against an answer (`answer.adequacy`)."""

    horizons: tuple[float, ...] = (0.05, 0.5, 2.0)
    """Seconds that free runs last. Tuned: to where lags, masses and drifts show."""

    runs: int = 3
    """Free runs of a length, of which fewer say nothing. Convention."""

    louder: float = 3.0
    """Times as strong as where it was fitted, that noise may be. Convention."""

    chance: float = 0.1
    """Of the motion, that free runs may err beyond the noise of readings. Tuned: a rig of five
    masses erred 0.42 by what was missing, with noise that foretold it."""

    led: float = 0.1
    """Of the square of errors, below which what the motion explains of it is no matter. Tuned, no
    data kept."""

    scatter: float = 1.0
    """Sigma of stretches by which an answer must be better than doing without it. Convention."""

    apart: float = 2.0
    """Sigma by which the free runs of one answer must be better than another's. Convention."""

    matters: float = 1.02
    """Factor of an error of free runs that anyone would care about. Convention."""

    often: float = 0.01
    """Probability of signed ranks by chance, below which a law's free runs err less. Convention."""


@dataclass(frozen=True)
class Verdict:
    """What an answer is called, once all is known (`answer.verdict`)."""

    apart: float = 5.0
    """Sigma within which a rival cannot be told from what was found. Convention: five sigma."""

    shifted: float = 5.0
    """Sigma by which a linear parameter must differ from the device file's. Convention, as `apart`.
    """

    sure: float = 0.95
    """Probability of a name or a richer form of it, below which it is not promised. Convention."""

    left_white: float = 0.01
    """Of the chi-square explained, that may be left beside names. Tuned, no data kept."""

    left_coloured: float = 0.05
    """As `left_white` where a horizon was asked for, and chi-square is no statistic. Tuned, no data
    kept."""

    unnamed: float = 60.0
    """Chi-square, times the inflation of the residual, that a force without a name must gain beyond
    1.5 for each of its unknowns. Tuned, no data kept."""

    worth_a_law: float = 0.8
    """Of the error of the names' free runs, below which a learned law is worth having. Tuned:
    nobody would act on less, and of 13 recordings without a law one got a law that left 0.94
    (`benchmarks.learned_laws`)."""

    worse_force: float = 1.05
    """Times the error of the refit, above which an answer is none: of the force that the recorded
    motion needs. Tuned: on eight machines' pages answers have 0.2 to 0.6."""

    worse_run: float = 1.5
    """As `worse_force` of whole runs, which drift. Tuned, as `worse_force`."""

    as_much: float = 0.8
    """Of what a force over one quantity explains, from which one over another is said beside it.
    Convention: which of them is more does not tell what the force depends on."""

    worse_file: float = 1.2
    """Times the error of the device file, from which a user is warned of an answer. Convention."""


@dataclass(frozen=True)
class Intake:
    """When something about a recording itself is taken for wrong (`intake`).

    Each was tuned on the recordings of machines and on faults sown in them
    (`benchmarks.sown_faults`), unless it says otherwise.
    """

    better: float = 1.5
    """Factor of the rms prediction error by which another way to read a recording counts."""

    smooth: float = 1.3
    """As `better`, of a command that is smooth between its samples."""

    exchanged: float = 2.0
    """As `better`, of two outputs that are read the other way round: a device file is off by half
    in every number."""

    certain: float = 3.0
    """As `better`, of a wrong sign or unit that is no matter of physics."""

    clear: float = 40.0
    """-2 ln likelihood from which a command shows in a motion, and another scale of it is asked."""

    surely: float = 100.0
    """-2 ln likelihood from which a command is late or exchanged."""

    known: float = 10.0
    """-2 ln likelihood from which an observer knows by how much a command is late."""

    share: float = 0.25
    """Of what a command explains in all, that another scale must explain beyond it."""

    off: float = 2.5
    """Factor by which a device file may be off in how much a command drives."""

    alike: float = 1.1
    """Slope within which a position and the integral of a velocity are those of one motion. No
    unit is as near one, and no filter that a device is read by makes as much."""

    sign_off: float = 3.0
    """As `off`, of a sign that is wrong: a wrong unit beside it is rare."""

    weak: float = 0.5
    """Scale below which a command is far too large, to which no noise adds."""

    power: float = 0.1
    """Of the most energy that a command could take out of a device, that tells its sign."""

    left_open: float = 3.0
    """Standard deviations of the command's scale, or of masses, that a device file leaves open.
    Convention."""

    near_unit: float = 1.5
    """Factor within which what a rough device file tells is taken for a unit."""

    far_unit: float = 20.0
    """Factor by which saturation, stiction or another machine's masses do not stand for a unit."""

    unit_odds: float = 1e-2
    """Probability that a recording has a wrong sign, or a unit that is mistaken for the SI.
    Elicited."""

    factor_odds: float = 1e-4
    """Probability that a channel counts wrong by a factor that is no unit. Elicited."""

    factor_width: float = 0.2
    """Of the logarithm of such a factor, what masses, springs and gain of a file leave open."""

    tone: float = 0.95
    """Of a command's power, in one line of its spectrum: nothing tells of columns exchanged."""

    half: float = 0.5
    """Of what a command leaves as described, that it leaves with the columns exchanged."""

    whole: float = 0.1
    """Of a step, by which values may lie beside a lattice."""

    turning: float = -0.38
    """Correlation of neighbouring errors, below which they are those of a differenced position.
    Derived: beside what is smooth white noise has -0.35 (0.01 about that in 1000 samples), a
    difference -0.41 to -0.53."""

    worked_out: float = 0.02
    """Of what is rough in a velocity, below which the error of a filtered position is nothing: it
    is no measurement of its own."""

    clipped: float = 0.005
    """Of the samples of a command, that stand at its largest value. Convention."""

    repeats: float = 0.02
    """Of the samples of an output, that repeat the one before. Convention."""


@dataclass(frozen=True)
class Laws:
    """When a law without a name is learned, and what it is said to look like."""

    stands_for: int = 2
    """Names that it must make superfluous to be said rather than names that explain a recording.
    Convention."""

    comes_back: float = 1.5
    """Times that each value of a state is met, on the mean, for a law over it to be learned: of
    what is met once a law tells time. Tuned, no data kept."""

    points: int = 16
    """Of a table, to begin with. Tuned: see docs/learned.md."""

    hope: float = 20.0
    """In -2 ln: what a law of all its points may cost more than names before those that pay are
    looked for. Tuned, no data kept."""

    within: float = 0.01
    """Chance of a distance as large, above which a formula lies within the band. Convention."""

    close: float = 6.0
    """In -2 ln: formulas that cost no more than this beyond the likeliest are said beside it.
    Convention: the 95 % of two numbers."""

    even: float = 2.0
    """The same, within which the formula of fewer numbers is said first. Convention."""


@dataclass(frozen=True)
class Changes:
    """What may change in a recording."""

    most: int = 3
    """Changes that are looked for, one after the other. Convention."""


@dataclass(frozen=True)
class Events:
    """What may happen once in a recording."""

    most: int = 4
    """Events in all that was recorded: more are missing physics. Convention."""

    longest_s: float = 3.0
    """[s] that an event lasts at most. Convention: what lasts longer is a change."""

    longest_share: float = 0.2
    """The same as a share of the recording. Convention."""

    apart_s: float = 0.4
    """[s] between two pulses from which on they are two events, if neither lasts as long.
    Convention."""


@dataclass(frozen=True)
class FreeForces:
    """When a force of free shape is said to be left, or to stand in the place of a name."""

    odds: float = 1e8
    """Recordings of white noise in one of which a line is as strong as one that is said. Tuned,
    no data kept: noise of the same spectrum and envelope as the residual's is not all noise."""

    over_time: float = 300.0
    """In -2 ln, that a force over time alone must gain: less is slow noise. Tuned, no data kept."""

    weak: float = 200.0
    """The same, below which a slower observer must agree. Tuned, no data kept."""

    rather: float = 25.0
    """The same, by which it must be likelier than a name. Derived: five sigma of one number."""

    part: float = 0.5
    """Of what names explain, that it must explain to first order to be fitted. Tuned, no data
    kept."""


EVIDENCE, PURSUIT, ADEQUACY, VERDICT = Evidence(), Pursuit(), Adequacy(), Verdict()
INTAKE = Intake()
LAWS, CHANGES, EVENTS, FREE_FORCES = Laws(), Changes(), Events(), FreeForces()
