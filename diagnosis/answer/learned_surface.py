"""A law of no name over two states, as an answer says it: its surface, its form, its worth.

Of two tables each law is known with the covariance of the fit, and looks like a formula of its own
(`learning/formulas`): "a sine of the position times a parabola of the velocity", or "shifted by"
it. A grid is of no form.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.result import HeldOut
from zwidth.diagnosis.answer.words import place_in_words
from zwidth.diagnosis.fitting.uncertainty import Z95
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.learning.formulas import Formula, formulas
from zwidth.diagnosis.learning.surface_forms import TablesForm, told
from zwidth.diagnosis.learning.surfaces import Surface
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.selection.searched import Searched
from zwidth.sim.physics.free_force import grid_of
from zwidth.sim.physics.two_tables import LAW_FIRST, LAW_SECOND, two_tables_of
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
LETTERS = {"position": "q", "velocity": "v", "command": "u"}
ALIKE = 3  # formulas of either law, that are not told apart and said
ANYWHERE = 10.0  # of what a shift varies by, that its constant may be
LITTLE = 1e-3  # of the largest power, below which none is made


@dataclass(frozen=True)
class LearnedSurface:
    """A surface, what the laws of its tables look like (cheapest first), and held-out fits.

    forms: of the first and of the second state; () for a grid, and empty for a law of no form.
    names, law: errors over the motion of free runs on held-out data, with the names and the law of
    one state that are believed, and with the surface. found: the fit with it.
    """

    curve: Surface
    forms: tuple[tuple[Formula, ...], ...]
    names: HeldOut
    law: HeldOut
    found: Searched

    @property
    def over(self) -> str:
        """What it follows, in words."""
        return " and ".join(self.curve.over)

    @property
    def formula(self) -> str:
        """What it looks like, "" for no form."""
        if not self.forms or not all(self.forms):
            return ""
        first, second = (LETTERS[state] for state in self.curve.states)
        law, other = self.forms[0][0], self.forms[1][0].text(second)
        if self.curve.shifts:
            return f"{law.text('s')}, s = {first} + {other}".replace("+ -", "- ")
        return f"({law.text(first)}) ({other})"

    def formula_at(self, first: Floats, second: Floats) -> Floats:
        """Return what the formula makes of states (...,), where there is one."""
        law, other = (form[0] for form in self.forms)
        if self.curve.shifts:
            return law.at(first + other.at(second))
        return law.at(first) * other.at(second)

    @property
    def form(self) -> str:
        """Its form in words: of which laws it is made, "" for a grid."""
        if not self.forms:
            return ""
        each = [f"a {form[0].form.name}" if form else "a law" for form in self.forms]
        does = " shifted by " if self.curve.shifts else " times "
        return does.join(
            f"{law} of {state}" for law, state in zip(each, self.curve.over, strict=True)
        )

    @property
    def absorbed(self) -> str:
        """Which names were part of it: of a surface, those are said to be replaced."""
        return ""

    def headline(self, masses: int) -> str:
        """Say it as the first line of an answer: where, over what, of which form, its worth."""
        curve, unit = self.curve, "N m" if self.found.final.model.nominal.rotary else "N"
        most = with_unit(float(np.abs(curve.at(*curve.seen.T)).max()), unit, 2)
        looks = f", which looks like {self.form}" if self.forms else ""
        return (
            f"a force acts {place_in_words(curve.physics.place, masses)} that has no name in the"
            f" library: up to {most} over {self.over} together{looks}; {self._worth}"
        )

    @property
    def sentence(self) -> str:
        """Say what was learned, and what it is worth."""
        looks = f", which looks like {self.formula}" if self.formula else ""
        return (
            f"learned from it: a force at {self.curve.physics.at} over {self.over} together"
            f"{looks}; {self._worth}"
        )

    @property
    def _worth(self) -> str:
        own, other = 100.0 * self.law.after, 100.0 * self.names.after
        return (
            f"error of free runs on held-out data {own:.2g} % of the motion with it, {other:.2g} %"
            " without"
        )

    @property
    def size(self) -> str:
        """How it stands in a device file."""
        if isinstance(self.curve.form, TablesForm):
            product = two_tables_of(self.curve.physics.values)
            return f"two tables of {len(product.first)} and {len(product.second)} points"
        grid = grid_of(self.curve.physics.values)
        return f"a table of {len(grid.rows)} rows and {len(grid.columns)} columns"

    @property
    def caption(self) -> str:
        """What its picture shows."""
        first, second = self.curve.over
        return (
            "Above the force over both states where the recording was, with its samples; below"
            f" over {first} at some of {second}, and over {second} at some of {first}, with the"
            " 95 % band, in which a damper, a spring and a scale of the command are too."
        )

    @property
    def others(self) -> list[str]:
        """Formulas that its band does not tell from the first, of either law."""
        return [
            f"{f.form.name} ({f.text(LETTERS[state])}) of {state}"
            for form, state in zip(self.forms, self.curve.states, strict=False)
            for f in form[1:ALIKE]
        ]

    @property
    def energy(self) -> str:
        """Say whether it ever makes energy along what was recorded, with its place's damper."""
        final, problem = self.found.final, self.found.problem
        place = self.curve.physics.place
        moved = predicted_states(problem, final)
        n = moved[0].shape[1] // 2
        i, j = place.ends
        v = np.concatenate([
            x[SETTLING:, n + i] - (x[SETTLING:, n + j] if j >= 0 else 0.0) for x in moved
        ])  # fmt: skip
        chain = final.model.build(final.x).chain
        dampers = chain.link_dampers if place.kind == "link" else chain.ground_dampers
        own = self.curve.at(*self.curve.seen.T) * v
        whole = own - float(dampers[place.index]) * v * v
        mean = with_unit(abs(float(own.mean())), "W", 2)
        does = "takes" if own.mean() <= 0.0 else "feeds in"
        said = f"by itself it {does} {mean} on the average of what was recorded"
        if float(whole.max()) <= LITTLE * float(np.abs(whole).max()):
            return f"{said}, and with its damper never generates energy"
        return f"{said}, and with its damper feeds in up to {with_unit(float(whole.max()), 'W', 2)}"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        curve = self.curve
        quantiles = np.quantile(curve.seen, QUANTILES, axis=0).T.tolist()
        return {
            "effect": curve.physics.effect.name,
            "at": curve.physics.at,
            "over": self.over,
            "states": list(curve.states),
            **(_tables_json(self) if isinstance(curve.form, TablesForm) else _grid_json(curve)),
            "seen": {
                state: dict(zip(map(str, QUANTILES), row, strict=True))
                for state, row in zip(curve.states, quantiles, strict=True)
            },
            "formula": self.formula or None,
            "formulas": [_formula_json(self)] if self.formula else [],
            "beside": list(curve.names),
            "absorbed": [],
            "replaced": list(curve.replaced),
            "energy": self.energy,
            "gained": curve.gained,
            "free_run": {"names": self.names.after, "law": self.law.after},
        }  # fmt: skip


def factors(curve: Surface) -> tuple[tuple[Formula, ...], ...]:
    """Return what either law of two tables looks like, () for a grid.

    A shift may have another constant, since nothing tells from where it is counted.
    """
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


def _formula_json(law: LearnedSurface) -> dict[str, Any]:
    """The likeliest formula of two tables, of its two parts."""
    each = zip(law.curve.states, law.forms, strict=True)
    return {
        "form": "shift" if law.curve.shifts else "product",
        "text": law.formula,
        "factors": [
            {"state": state, "form": form[0].form.name, "numbers": form[0].numbers}
            for state, form in each
        ],
    }


def _tables_json(law: LearnedSurface) -> dict[str, Any]:
    """Both tables with their bands, and what they look like."""
    curve = law.curve
    product = two_tables_of(curve.physics.values)
    found: dict[str, Any] = {}
    both = zip(("first", "second"), (product.first, product.second), (LAW_FIRST, LAW_SECOND),
               law.forms, curve.states, strict=True)  # fmt: skip
    for key, table, names, form, state in both:
        half = Z95 * np.sqrt(np.maximum(np.diag(curve.of(names[: len(table)])), 0.0))
        rows = zip(table, half.tolist(), strict=True)
        found[key] = {
            "points": [
                {"state": s, "law": f, "lower": f - h, "upper": f + h} for (s, f), h in rows
            ],
            "formulas": [
                {"form": f.form.name, "text": f.text(LETTERS[state]), "numbers": f.numbers,
                 "chance": f.chance, "cost": f.cost}
                for f in form
            ],
        }  # fmt: skip
    return found


def _grid_json(curve: Surface) -> dict[str, Any]:
    """The grid with the band of what was seen of it, null where nothing was."""
    grid = grid_of(curve.physics.values)
    first, second = np.meshgrid(np.array(grid.rows), np.array(grid.columns), indexing="ij")
    half = curve.half(first, second)
    seen = told(curve.seen, np.array(grid.rows), np.array(grid.columns))

    def of_what_is_told(values: Floats) -> list[list[float | None]]:
        return np.where(seen, values, None).tolist()  # pyright: ignore[reportArgumentType,reportCallIssue]

    return {
        "rows": list(grid.rows),
        "columns": list(grid.columns),
        "table": grid.values.tolist(),
        "lower": of_what_is_told(grid.values - half),
        "upper": of_what_is_told(grid.values + half),
    }
