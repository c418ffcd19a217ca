"""Where simulation and recording part, beside what was found: one sentence that fits the finding.

The map of the missing force is made with the refitted device, before anything has a name. So it
should point to where the finding is. Where it does not, that is said, with why: a map lets in a
force that follows one state, in eight bins; the search simulates each effect whole.
"""

from collections.abc import Sequence

from zwidth.diagnosis.answer.headline import effect_in_words, place_in_words
from zwidth.diagnosis.answer.result import Finding
from zwidth.diagnosis.forces.locate import Located, densest, sign_of, stands_out
from zwidth.sim.place import Place, place_at

# What the force of an effect follows, by which a map shows it; none for what is no such force.
FOLLOWS = {
    "velocity": ("coulomb_friction", "stribeck_friction", "rising_friction",
                 "presliding_friction", "hysteresis", "directional_friction", "load_friction",
                 "quadratic_drag"),
    "position": ("ground_spring", "gravity_pendulum", "force_ripple", "cubic_stiffness",
                 "backlash", "encoder_eccentricity", "hysteresis", "extra_mode"),
    "command": ("saturation", "dead_band", "command_step", "gain_asymmetry", "servo_limit",
                "servo_dead_zone", "servo_integral", "goal_rate_limit", "rate_limit",
                "falling_limit", "load_friction"),
}  # fmt: skip


def where(located: Located, findings: Sequence[Finding], masses: int) -> str:
    """Return the sentence, without a full stop. masses: of the device's chain."""
    top = max(located.maps, key=lambda m: m.gained, default=None)
    if top is None:
        return located.sentence
    if not stands_out(top):
        seen = "no force that follows position, velocity, command or time stands out from the noise"
        if not findings:
            return seen
        shows = "shows" if len(findings) == 1 else "show"
        return (
            f"{seen}; {_names(findings)} {shows} in the run as a whole, but not in a map of eight"
            " bins"
        )
    at = place_at(top.place)
    force = f"a force {place_in_words(at, masses)} that {_like(top.against)}{sign_of(top)}"
    first = f"{densest(located.state)}{force} would explain most of it"
    return f"{first}{_beside(top.against, at, findings, masses)}"


def _like(against: str) -> str:
    return "changes with time" if against == "time" else f"follows the {against}"


def _names(findings: Sequence[Finding]) -> str:
    return " and ".join(effect_in_words(f.effect) for f in findings)


def _beside(against: str, at: Place, findings: Sequence[Finding], masses: int) -> str:
    """What the map says of the findings: that it is one of them, or why it is none."""
    if not findings:
        return ""
    like = [f for f in findings if f.effect in FOLLOWS.get(against, ())]
    here = next((f for f in like if _mass(place_at(f.at)) == _mass(at)), None)
    if here is not None:
        return f", as the {effect_in_words(here.effect)} there does"
    f = next(iter(like or findings))
    name, found_at = effect_in_words(f.effect), place_in_words(place_at(f.at), masses)
    if like:
        return (
            f"; the {name} was nevertheless found {found_at}: the map shows one state in eight"
            " bins, while the search simulated each effect and found this place more probable"
        )
    return (
        f"; the {name} {found_at} is not a force that {_like(against)} alone, but explains more"
        " when it is simulated"
    )


def _mass(at: Place) -> Place:
    """The mass or link at which a map would show it: what is in the loop, at the motor."""
    return at.acts_on if at.kind in ("mass", "link", "ground") else Place("mass", 0)
