"""A learned law, as the answer reports it: its curve or surface, formula, and worth.

A law over two states is a grid, or is made of two tables (`learning/surfaces`). Each of two tables
is known with the covariance of the fit, and is compared with formulas of its own
(`learning/formulas`): "a sine of the position times a parabola of the velocity", or "shifted by"
it. A grid has no formula.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.friction_curve import asked_beyond, read_beyond
from zwidth.diagnosis.answer.result import HeldOut
from zwidth.diagnosis.answer.words import LISTED, listed, place_in_words
from zwidth.diagnosis.fitting.uncertainty import Z95
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.learning.curves import Learned
from zwidth.diagnosis.learning.energy import LITTLE, makes_energy
from zwidth.diagnosis.learning.formulas import Formula, formulas
from zwidth.diagnosis.learning.surface_forms import TablesForm, told
from zwidth.diagnosis.learning.surfaces import Surface
from zwidth.diagnosis.learning.tables import law_at
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.selection.searched import Searched
from zwidth.shown import Valued
from zwidth.sim.physics.free_force import grid_of
from zwidth.sim.physics.two_tables import LAW_FIRST, LAW_SECOND, two_tables_of
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]
LETTERS = {"free_spring": "q", "free_damper": "v", "free_amplifier": "u", "free_sensor": "q",
           "position": "q", "velocity": "v", "command": "u"}  # fmt: skip
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
ANYWHERE = 10.0  # deviation of a shift's unknown constant, over the range of the shift


@dataclass(frozen=True)
class Law(ABC, Valued):
    """A learned law, and the fits to held-out data.

    names, law: errors of free runs on held-out data, relative to the motion, with the named effects
    alone and with the law. found: the fit with the law.
    """

    curve: Learned | Surface
    names: HeldOut
    law: HeldOut
    found: Searched

    @property
    @abstractmethod
    def over(self) -> str:
        """The state that the law depends on, in words."""

    @property
    @abstractmethod
    def formula(self) -> str:
        """The law's formula, "" for none."""

    @property
    @abstractmethod
    def energy(self) -> str:
        """Say whether the law ever generates energy."""

    @property
    @abstractmethod
    def extent(self) -> str:
        """Say the law's size, state, and form."""

    @abstractmethod
    def headline(self, masses: int) -> str:
        """Return the first line of an answer: where the law acts, and its extent."""

    @property
    @abstractmethod
    def sentence(self) -> str:
        """Say which law was learned."""

    @property
    def turns(self) -> bool:
        """Whether the law repeats with position, so that a ripple is its first harmonic."""
        return False

    @property
    def rotary(self) -> bool:
        """Whether the device is rotary."""
        return self.found.final.model.nominal.rotary

    @property
    def force_unit(self) -> str:
        """The unit of a force."""
        return "N m" if self.rotary else "N"

    @property
    def worth(self) -> str:
        """Say by how much the law lowers the error of free runs."""
        own, other = 100.0 * self.law.after, 100.0 * self.names.after
        return (
            f"error of short free runs on held-out data: {own:.2g} % of the motion with the learned"
            f" law, {other:.2g} % without"
        )

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`, the keys of every law."""
        return {
            "effect": self.curve.physics.effect.name,
            "at": self.curve.physics.at,
            "over": self.over,
            "formula": self.formula or None,
            "beside": list(self.curve.names),
            "absorbed": list[str](),
            "replaced": list(self.curve.replaced),
            "energy": self.energy,
            "gained": self.curve.gained,
            "free_run": {"names": self.names.after, "law": self.law.after},
        }


@dataclass(frozen=True)
class LearnedLaw(Law):
    """A law over one state, and the formulas near it (cheapest first, empty for none).

    formulas: of the law plus the named effects that depend on the same state at its place
    (`whole`), or of the law alone.
    """

    curve: Learned
    formulas: tuple[Formula, ...]
    whole: bool

    @property
    def turns(self) -> bool:
        """Whether the law repeats with position, so that a ripple is its first harmonic."""
        return self.curve.period > 0.0

    @property
    def letter(self) -> str:
        """The symbol of the state in formulas."""
        return LETTERS[self.curve.physics.effect.name]

    @property
    def formula(self) -> str:
        """The law's formula, "" for none."""
        return self.formulas[0].text(self.letter) if self.formulas else ""

    @property
    def over(self) -> str:
        """The state that the law depends on, and its period."""
        period = self.curve.period
        length = "rad" if self.rotary else "m"
        repeats = f", repeating every {with_unit(period, length, 4)}" if period else ""
        return f"{self.curve.over}{repeats}"

    @property
    def extent(self) -> str:
        """Say the law's size, state, and form."""
        reads = self.curve.physics.effect.name == "free_sensor"
        unit = ("rad" if self.rotary else "m") if reads else self.force_unit
        most = with_unit(float(np.abs(law_at(self.curve.physics, self.curve.seen)).max()), unit, 2)
        alike = listed([_a(f.form.name) for f in self.formulas[:2]], "or")
        return f"it reaches {most} and depends on {self.over}{self._looks(alike)}"

    def headline(self, masses: int) -> str:
        """Return the first line of an answer: where the law acts, and its extent."""
        curve = self.curve
        name = curve.physics.effect.name
        acts = {
            "free_amplifier": "the command has an error outside the library of effects",
            "free_sensor": "the reading has an error outside the library of effects",
        }.get(name, _acts(place_in_words(curve.physics.place, masses)))
        return f"{acts}: {self.extent}"

    def _looks(self, like: str) -> str:
        if not self.formulas:
            return ""
        names = () if self.curve.together is None or not self.whole else self.curve.together.names
        return f", and{f', together with {listed(names)},' if names else ''} looks like {like}"

    @property
    def sentence(self) -> str:
        """Say which law was learned."""
        what = {
            "free_amplifier": "an error added to the command",
            "free_sensor": "the error of the reading",
        }.get(self.curve.physics.effect.name, f"a force at {self.curve.physics.at}")
        return f"{what} that depends on {self.over}{self._looks(self.formula)}"

    @property
    def absorbed(self) -> str:
        """Say which named effects were part of the curve, "" for none."""
        gone = self.curve.absorbed
        is_, it = ("is", "it") if len(gone) == 1 else ("are", "them")
        return (
            f"{listed(gone)} {is_} no longer needed, since this curve includes {it}" if gone else ""
        )

    @property
    def size(self) -> str:
        """The law's entry in a device file."""
        return f"a table of {self.curve.states.size} points"

    @property
    def caption(self) -> str:
        """The title of the law's picture."""
        whole = self.curve.together
        both = "" if whole is None else (
            " The second curve is the sum of all forces that depend on the same quantity: the"
            f" table and {listed(whole.names)}."
        )  # fmt: skip
        return (
            "The learned curve with its 95 % band; the dots are the force that each sample of the"
            " recording needs. Below: how many samples there are. The band also covers what a"
            " different damper, spring or rest position could explain in place of part of the"
            f" curve.{both}"
        )

    @property
    def others(self) -> list[str]:
        """Formulas that the band does not distinguish from the first."""
        return [f"{f.form.name} ({f.text(self.letter)})" for f in self.formulas[1 : 1 + LISTED]]

    @property
    def energy(self) -> str:
        """Say whether the law ever generates energy."""
        return makes_energy(self.curve, self.rotary)

    def samples(self) -> tuple[Floats, Floats]:
        """Return states and forces (samples,): the force that each sample requires from the law.

        A force is the law at the predicted state plus the force that the innovations require beyond
        the fit (`friction_curve.asked_beyond`), in the recordings that were fitted.
        """
        physics, states = self.curve.physics, self.curve.seen
        final, problem = self.found.final, self.found.problem
        if physics.effect.name == "free_sensor":
            return states, law_at(physics, states) + read_beyond(problem, final)
        at = physics.at if physics.place.kind in ("mass", "link") else "m1"
        return states, law_at(physics, states) + asked_beyond(problem, final, at)

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        curve, together = self.curve, self.curve.together
        return super().as_json() | {
            "odd": curve.odd,
            "period": curve.period or None,
            "one_way": curve.one_way,
            "points": _points(curve.states, curve.forces, curve.lower, curve.upper),
            "seen": _quantiles(curve.seen),
            "formula_of": "together" if self.whole else "curve",
            "formulas": [_formula(f, self.letter) for f in self.formulas],
            "absorbed": list(curve.absorbed),
            "together": together and {
                "names": list(together.names),
                "points": _points(
                    together.states, together.forces, together.lower, together.upper
                ),
            },
        }  # fmt: skip


@dataclass(frozen=True)
class LearnedSurface(Law):
    """A law over two states, and formulas near those of its tables (cheapest first).

    forms: of the first and of the second state, each empty if no form fits; () for a grid. names:
    with the believed law of one state, if any.
    """

    curve: Surface
    forms: tuple[tuple[Formula, ...], ...]

    @property
    def over(self) -> str:
        """The states that the law depends on, in words."""
        return " and ".join(self.curve.over)

    @property
    def formula(self) -> str:
        """The law's formula, "" for none."""
        if not self.forms or not all(self.forms):
            return ""
        first, second = (LETTERS[state] for state in self.curve.states)
        law, other = self.forms[0][0], self.forms[1][0].text(second)
        if self.curve.shifts:
            return f"{law.text('s')}, s = {first} + {other}".replace("+ -", "- ")
        return f"({law.text(first)}) ({other})"

    def formula_at(self, first: Floats, second: Floats) -> Floats:
        """Return the formula's values at states (...,), if there is a formula."""
        law, other = (form[0] for form in self.forms)
        if self.curve.shifts:
            return law.at(first + other.at(second))
        return law.at(first) * other.at(second)

    @property
    def form(self) -> str:
        """The form in words: the laws of its tables, "" for a grid."""
        each = [f"a {form[0].form.name}" if form else "a law" for form in self.forms]
        does = " shifted by " if self.curve.shifts else " times "
        return does.join(
            f"{law} of {state}" for law, state in zip(each, self.curve.over, strict=False)
        )

    @property
    def absorbed(self) -> str:
        """Return "": a surface replaces effects, but absorbs none."""
        return ""

    @property
    def extent(self) -> str:
        """Say the law's size, states, and form."""
        most = float(np.abs(self.curve.at(*self.curve.seen.T)).max())
        looks = f" (approximately {self.form})" if self.forms else ""
        size = with_unit(most, self.force_unit, 2)
        return f"it reaches {size} and depends on both {self.over}{looks}"

    def headline(self, masses: int) -> str:
        """Return the first line of an answer: where the law acts, and its extent."""
        at = place_in_words(self.curve.physics.place, masses)
        return f"{_acts(at)}: {self.extent}"

    @property
    def sentence(self) -> str:
        """Say which law was learned."""
        looks = f", and looks like {self.formula}" if self.formula else ""
        at = self.curve.physics.at
        return f"a force at {at} that depends on both {self.over}{looks}"

    @property
    def size(self) -> str:
        """The law's entry in a device file."""
        if isinstance(self.curve.form, TablesForm):
            product = two_tables_of(self.curve.physics.values)
            return f"two tables of {len(product.first)} and {len(product.second)} points"
        grid = grid_of(self.curve.physics.values)
        return f"a table of {len(grid.rows)} rows and {len(grid.columns)} columns"

    @property
    def caption(self) -> str:
        """The title of the law's picture."""
        first, second = self.curve.over
        return (
            "Above: the force against both quantities; dots mark where the recording has samples."
            f" Below: the force against {first} for some values of {second}, and against"
            f" {second} for some values of {first}. The 95 % band includes the part of the law that"
            " a different damper, spring or command scale could explain."
        )

    @property
    def others(self) -> list[str]:
        """Formulas of each law that the band does not distinguish from the first."""
        return [
            f"{f.form.name} ({f.text(LETTERS[state])}) of {state}"
            for form, state in zip(self.forms, self.curve.states, strict=False)
            for f in form[1:LISTED]
        ]

    @property
    def energy(self) -> str:
        """Say whether the law generates energy along the recording, alone and with its damper."""
        final, place = self.found.final, self.curve.physics.place
        moved = predicted_states(self.found.problem, final)
        n, (i, j) = moved[0].shape[1] // 2, place.ends
        v = np.concatenate([
            x[SETTLING:, n + i] - (x[SETTLING:, n + j] if j >= 0 else 0.0) for x in moved
        ])  # fmt: skip
        chain = final.model.build(final.x).chain
        dampers = chain.link_dampers if place.kind == "link" else chain.ground_dampers
        own = self.curve.at(*self.curve.seen.T) * v
        whole = own - float(dampers[place.index]) * v * v
        does = "dissipates" if own.mean() <= 0.0 else "generates"
        mean = with_unit(abs(float(own.mean())), "W", 2)
        said = f"on average over the recording, this force {does} {mean}"
        if float(whole.max()) <= LITTLE * float(np.abs(whole).max()):
            return f"{said}; together with the damper, this force never generates energy"
        at_most = with_unit(float(whole.max()), "W", 2)
        return f"{said}; together with the damper, this force generates {at_most} at most"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        curve = self.curve
        return super().as_json() | {
            "states": list(curve.states),
            **(self._tables() if isinstance(curve.form, TablesForm) else _grid(curve)),
            "seen": {
                state: _quantiles(seen)
                for state, seen in zip(curve.states, curve.seen.T, strict=True)
            },
            "formulas": [self._likeliest()] if self.formula else [],
        }

    def _likeliest(self) -> dict[str, Any]:
        """The most likely formula of two tables, from the formulas of each."""
        return {
            "form": "shift" if self.curve.shifts else "product",
            "text": self.formula,
            "factors": [
                {"state": state, "form": form[0].form.name, "numbers": form[0].numbers}
                for state, form in zip(self.curve.states, self.forms, strict=True)
            ],
        }

    def _tables(self) -> dict[str, Any]:
        """Both tables with their bands, and the formulas near them."""
        curve = self.curve
        product = two_tables_of(curve.physics.values)
        found: dict[str, Any] = {}
        both = zip(("first", "second"), (product.first, product.second), (LAW_FIRST, LAW_SECOND),
                   self.forms, curve.states, strict=True)  # fmt: skip
        for key, table, names, form, state in both:
            states, law = np.array(table).T
            half = Z95 * np.sqrt(np.maximum(np.diag(curve.of(names[: len(table)])), 0.0))
            found[key] = {
                "points": _points(states, law, law - half, law + half, value="law"),
                "formulas": [_formula(f, LETTERS[state]) for f in form],
            }
        return found


def _grid(curve: Surface) -> dict[str, Any]:
    """The grid with its band where samples were seen, null elsewhere."""
    grid = grid_of(curve.physics.values)
    rows, columns = np.array(grid.rows), np.array(grid.columns)
    half = curve.half(*np.meshgrid(rows, columns, indexing="ij"))
    seen = told(curve.seen, rows, columns)

    def of_what_is_told(values: Floats) -> list[list[float | None]]:
        return np.where(seen, values, None).tolist()  # pyright: ignore[reportArgumentType,reportCallIssue]

    return {
        "rows": list(grid.rows),
        "columns": list(grid.columns),
        "table": grid.values.tolist(),
        "lower": of_what_is_told(grid.values - half),
        "upper": of_what_is_told(grid.values + half),
    }


def _formula(f: Formula, letter: str) -> dict[str, Any]:
    return {"form": f.form.name, "text": f.text(letter), "numbers": f.numbers,
            "chance": f.chance, "cost": f.cost}  # fmt: skip


def _points(*columns: Floats, value: str = "force") -> list[dict[str, float]]:
    rows = np.column_stack(columns).tolist()
    return [dict(zip(("state", value, "lower", "upper"), row, strict=True)) for row in rows]


def _quantiles(seen: Floats) -> dict[str, float]:
    return dict(zip(map(str, QUANTILES), np.quantile(seen, QUANTILES).tolist(), strict=True))


def _acts(at: str) -> str:
    """A force without a name, and where it acts, in words."""
    return f"a force outside the library of effects acts {at}"


def _a(form: str) -> str:
    """The name of a form with its article."""
    first = form.split(" ")[0]
    article = {"friction": "", "sum": "the "}.get(first, "an " if first[0] in "aeiou" else "a ")
    return f"{article}{form}"


def like_what(curve: Learned) -> tuple[tuple[Formula, ...], bool]:
    """Return the formulas near a law, and whether they include named effects over its state."""
    whole = curve.together
    if whole is not None:
        rubs = any("friction" in name for name in whole.names)
        found = formulas(whole.states, whole.forces, whole.covariance, False, rubs=rubs)
        if found:
            return tuple(found), True
    own = formulas(curve.states, curve.forces, curve.covariance, curve.odd, curve.period)
    return tuple(own), False


def factors(curve: Surface) -> tuple[tuple[Formula, ...], ...]:
    """Return formulas near each law of two tables (shifts up to a constant), () for a grid."""
    if not isinstance(curve.form, TablesForm):
        return ()
    tables = curve.form.tables
    found: list[tuple[Formula, ...]] = []
    for k, (table, names) in enumerate(((tables.first, LAW_FIRST), (tables.second, LAW_SECOND))):
        states, laws = np.array(table).T
        known = curve.of(names[: len(table)])
        if curve.shifts and k == 1:
            known = known + (ANYWHERE * np.ptp(laws)) ** 2
        found.append(tuple(formulas(states, laws, known, odd=False)))
    return tuple(found)
