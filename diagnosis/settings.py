"""The numbers that decide what a diagnosis says.

One frozen class a part of the pipeline, one field a number. Under each stand its unit, where it
comes from (derived, by convention, elicited from engineers, or tuned) and the data behind it. What
only steers a method (rounds of a solver, a guard against rounding) stands with the method.

So far those of the search and of the verdict are here. Those of other parts stand at the top of
their modules, and move here when these are rebuilt.
"""

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
    to 0.08 of it."""

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
    """As `worse_force` of whole runs, which drift; and times the error of the device file, from
    which a user is warned. Tuned, as `worse_force`."""


EVIDENCE, PURSUIT, VERDICT = Evidence(), Pursuit(), Verdict()
