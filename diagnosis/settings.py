"""The numbers that decide what a diagnosis says, all of them.

One frozen class a part of the pipeline, one field a number. Under each stand its unit, where it
comes from (derived, by convention, elicited from engineers, or tuned) and the data behind it. What
only steers a method (rounds of a solver, a guard against rounding) stands with the method, as the
default of an argument; nothing there may change what is said of a recording.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Evidence:
    """When one hypothesis is believed over another."""

    alpha: float = 1e-3
    """Odds at which what is not true is believed over what is. Convention."""


EVIDENCE = Evidence()


@dataclass(frozen=True)
class Adequacy:
    """When an answer holds on recordings that it was not fitted to."""

    horizons_s: tuple[float, ...] = (0.05, 0.5, 2.0)
    """Lengths of free runs [s]: a contact, a movement of a hand, a manoeuvre. Convention."""

    preferred: float = 0.01
    """Odds by chance at which the free runs of one answer err less than those of another.
    Convention; ten times `alpha`, since neither answer has the odds for it."""

    negligible: float = 0.1
    """Share of the motion (rms) that free runs may err beyond the noise of readings, and share of
    their square error that forces which follow the motion may explain. Tuned: machines with nothing
    missing stay below, a brake whose law was in no library left 0.19."""

    most: float = 0.5
    """Share of a square error from which something is most of it: noise, or names that are said
    first. Convention."""

    better_sigma: float = 1.0
    """Standard errors by which what is named must predict better than doing without. Convention:
    names were believed before by `alpha`, and held-out data must not speak against them."""


ADEQUACY = Adequacy()


@dataclass(frozen=True)
class Verdict:
    """When a verdict is given."""

    apart_sigma: float = 5.0
    """Sigma within which a rival cannot be told apart, and a linear parameter is as the device file
    says. Convention of physics."""

    probable: float = 0.95
    """Probability of an effect, or a richer form of it, from which it is promised. Convention."""

    left_chi2: float = 60.0
    """Chi-square that a force of free shape must gain to be left over. Tuned: eight bins at every
    place and state gain less than 35 by chance at odds of `alpha`; colour that the filters leave
    makes it up to twice as much."""

    left_share: float = 0.01
    """Share of the chi-square explained that may be left beside a name. Tuned: what a law errs by
    that was measured to a percent."""

    left_share_coloured: float = 0.05
    """The same where the noise model is not white, and chi-square is no statistic. Tuned."""

    worse: float = 1.2
    """Times the free-run error of the device file, from which the augmented device is warned of.
    Convention."""

    one_level: float = 1.25
    """Largest over smallest size of a command (95 % and 5 % quantiles), up to which it has one
    level. Tuned: steps with overshoot 1.1, steps of 0.05 and 0.035 N m 1.43."""


VERDICT = Verdict()
