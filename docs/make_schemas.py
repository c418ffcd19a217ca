"""Write the JSON schemas of device files and of results: `python docs/make_schemas.py`.

The schema of a device file is made from the declarations that its reader uses; the schemas of
results state what programs may rely on. A wheel has them in `zwidth/schemas`.
"""

import json
from inspect import cleandoc
from pathlib import Path
from typing import Any

import msgspec

from zwidth.diagnosis.answer.events import HIT, JAM, PUSH, SLIP, STOP, TOUCH, UNEXPLAINED
from zwidth.diagnosis.answer.result import Verdict
from zwidth.diagnosis.learning.changing import SHAPES
from zwidth.fleet.history import DRIFT, STEP
from zwidth.fleet.reasons import FAULTS
from zwidth.results import BoundaryResult
from zwidth.sim.device_file import (
    BAND_OUTPUT_KEYS,
    CHAIN_KEYS,
    INTERFACE_KEYS,
    INTERFACE_TEXTS,
    MODAL_KEYS,
    MODE_KEYS,
    POSTERIOR_KEYS,
    TOP_KEYS,
    UNCERTAINTY_FIELDS,
)
from zwidth.sim.device_keys import DEVICE_KEYS
from zwidth.sim.drive import KINDS, NEEDED, POSSIBLE
from zwidth.sim.fate import Fate
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.free_force import is_grid
from zwidth.sim.physics.free_law import is_table
from zwidth.sim.physics.two_tables import is_two_tables

Schema = dict[str, Any]
DIALECT = "https://json-schema.org/draft/2020-12/schema"
NUMBER: Schema = {"type": "number"}
NUMBERS: Schema = {"type": "array", "items": NUMBER}
TEXT: Schema = {"type": "string"}
TEXTS: Schema = {"type": "array", "items": TEXT}
YES: Schema = {"type": "boolean"}
COUNT: Schema = {"type": "integer", "minimum": 0}
MAYBE: Schema = {"type": ["number", "null"]}
MAYBES: Schema = {"type": "array", "items": MAYBE}
MAYBE_TEXT: Schema = {"type": ["string", "null"]}


def closed(properties: Schema, optional: tuple[str, ...] = ()) -> Schema:
    """An object with these keys and no others, all of them but the optional ones required."""
    required = [key for key in properties if key not in optional]
    return {"type": "object", "properties": properties, "required": required,
            "additionalProperties": False}  # fmt: skip


def several(item: Schema) -> Schema:
    """A list of items of this schema."""
    return {"type": "array", "items": item}


def table(item: Schema) -> Schema:
    """An object with keys of the data, all with values of this schema."""
    return {"type": "object", "additionalProperties": item}


def either(*schemas: Schema) -> Schema:
    """One of these, or null."""
    return {"anyOf": [*schemas, {"type": "null"}]}


def named(name: str, about: str, found: Schema) -> Schema:
    """A whole schema; its `$id` changes where files that were right before become wrong."""
    head = {"$schema": DIALECT, "$id": f"urn:zwidth:schema:{name}:1", "title": f"zwidth {about}"}
    return head | found


def device() -> Schema:
    """A device file, read by a parser of TOML."""
    said = {(key.table, key.name): key.comment(True) for key in DEVICE_KEYS}

    def keys(table: str, names: Any, kind: Schema = NUMBER) -> Schema:
        return {n: {**kind, "description": said.get((table, n), "")} for n in names}

    chain = keys("chain", CHAIN_KEYS, NUMBERS) | keys("chain", ["ground_spring"])
    modes = several(closed(keys("modal.mode", MODE_KEYS)))
    modal = {"oneOf": [closed(keys("modal", own) | {"mode": modes}, ("mode",))
                       for own in MODAL_KEYS.values()]}  # fmt: skip
    interface = keys("interface", INTERFACE_KEYS) | keys("interface", INTERFACE_TEXTS, TEXT)
    uncertainty = keys("uncertainty", UNCERTAINTY_FIELDS)
    outputs = keys("band.output", BAND_OUTPUT_KEYS) | keys("band.output", ["name"], TEXT)
    band = keys("band", ("window_s", "windows", "observer_ratio"))
    band |= keys("band", ["corrected"], TEXTS) | keys("band", ["simulator"], TEXT)
    band |= {"output": several(closed(outputs))}
    posterior = keys("posterior", POSTERIOR_KEYS[:1], TEXTS)
    posterior |= keys("posterior", POSTERIOR_KEYS[1:2], NUMBERS)
    posterior |= keys("posterior", POSTERIOR_KEYS[2:], several(NUMBERS))
    drives: list[Schema] = []
    for kind in KINDS:
        own = keys("drive", (*NEEDED[kind], *POSSIBLE[kind]))
        own |= {"when_off": TEXT} if "when_off" in own else {}
        drives.append(closed({"kind": {"const": kind}} | own, tuple(POSSIBLE[kind])))
    top: Schema = {
        **keys("", ("name", "source"), TEXT), **keys("", ["rotary"], YES), "schema": {"const": 1},
        "chain": closed(chain, ("ground_spring", "link_springs", "link_dampers")), "modal": modal,
        "interface": closed(interface, tuple(interface)),
        "uncertainty": closed(uncertainty, tuple(uncertainty)), "drive": {"oneOf": drives},
        "band": closed(band, ("corrected", "simulator")), "posterior": closed(posterior),
        "physics": several({"oneOf": _effects()}),
    }  # fmt: skip
    assert set(top) == set(TOP_KEYS)
    found = closed(top, tuple(key for key in top if key not in ("name", "rotary")))
    mechanism = {"oneOf": [{"required": ["chain"]}, {"required": ["modal"]}]}
    return named("device", "device file", {**found, **mechanism})


def _effects() -> list[Schema]:
    found: list[Schema] = []
    for name, effect in EFFECTS.items():
        own: Schema = {p.name: {**NUMBER, "description": p.meaning} for p in effect.parameters}
        optional: tuple[str, ...] = ()
        if any(is_(effect.parameters) for is_ in (is_grid, is_table, is_two_tables)):
            own = {key: {} for key in ("over", "rows", "columns", "table", "odd", "period",
                                       "first", "second")}  # fmt: skip
            own |= _tables()
            optional = tuple(own)
        found.append(closed({"effect": {"const": name}, "at": TEXT} | own, optional))
    return found


def _tables() -> Schema:
    from zwidth.sim.physics.two_tables import TABLES

    return {key: {"type": "array"} for key in TABLES}


ESTIMATE = closed({"value": MAYBE, "unit": TEXT, "ci95": several(MAYBE)})
FITS = ("before", "refit", "after")
EVENTS = (HIT, STOP, JAM, TOUCH, PUSH, SLIP, UNEXPLAINED)


def diagnosis() -> Schema:
    """The JSON of `zwidth diagnose`."""
    rival = closed({"effect": TEXT, "at": TEXT, "separation_sigma": MAYBE, "probability": MAYBE})
    regime = closed({"regime": TEXT, "other": TEXT, "sigma": MAYBE, "fails": YES})
    finding = closed({
        "effect": TEXT, "at": TEXT, "parameters": table(ESTIMATE),
        "separation_sigma": MAYBE, "probability": MAYBE, "probability_with_richer": MAYBE,
        "rivals": several(rival), "regimes": several(regime),
        "worth": either(closed(dict.fromkeys(("times", "sigma", "horizon"), MAYBE))),
    })  # fmt: skip
    refit = closed({"nominal": MAYBE, **ESTIMATE["properties"]})
    fault = closed({"kind": TEXT, "sentence": TEXT, "wrong": YES, "value": MAYBE,
                    "recording": TEXT, "channels": TEXTS})  # fmt: skip
    level = closed({"level": MAYBE, "unit": TEXT, "share": MAYBE, "differs": MAYBE, "now": MAYBE,
                    "sentence": TEXT})  # fmt: skip
    experiment = closed({"scenario": TEXT, "separates": TEXTS, "separation_sigma": MAYBE})
    point = closed({"damping": NUMBER, "nominal": MAYBES, "augmented": MAYBES})
    boundary = closed({"start": NUMBER, "points": several(point), "sentence": TEXT})
    facts = closed({"chi2_per_sample": closed({"refit": MAYBE, "final": MAYBE}), "samples": COUNT,
                    "left_chi2": MAYBE, "explained_chi2": MAYBE, "comparisons": COUNT})  # fmt: skip
    empty = {"type": "object", "maxProperties": 0}  # after an error
    error = closed({"stage": TEXT, "what": TEXT, "error": TEXT})
    return named("diagnosis", "diagnose --json", closed({
        "verdict": {"enum": [verdict.value for verdict in Verdict]},
        "headline": TEXT, "sentence": TEXT, "warnings": TEXTS, "findings": several(finding),
        "negligible": several(finding), "linear_refit": table(refit), "where": _where(),
        "fit": _fit(), "adequacy": either(_adequacy()), "learned": either(_learned()),
        "changes": several(_change()), "events": several(_event()),
        "upper_bounds": table(table(MAYBE)), "faults": several(fault),
        "next_experiment": either(experiment), "next_level": either(level),
        "interrupted": YES, "facts": {"anyOf": [facts, empty]},
        "cost": {"anyOf": [_cost(), empty]}, "errors": several(error),
        "boundary": either(boundary), "device": TEXT, "assumptions": TEXTS,
        "augmented_device": MAYBE_TEXT, "report": MAYBE_TEXT, "logs": TEXTS,
    }, ("assumptions",)))  # fmt: skip


def _where() -> Schema:
    """Shares of the difference, over spans and over names."""
    span = closed({"from": MAYBE, "to": MAYBE, "share": MAYBE})
    place = closed({"name": TEXT, "share": MAYBE})
    state = closed({"name": TEXT, "share": MAYBE, "time_share": MAYBE})
    return closed({"sentence": TEXT, "time": several(span), "frequency_hz": several(span),
                   "state": several(state), "entry": several(place)})  # fmt: skip


def _fit() -> Schema:
    share = closed({**dict.fromkeys(FITS, MAYBE), "noise_floor": MAYBE})
    three = closed(dict.fromkeys(FITS, MAYBE))
    four = closed(dict.fromkeys((*FITS, "law"), MAYBE), ("law",))
    run = closed({"recording": TEXT, "output": TEXT, "unit": TEXT, "rms": four,
                  "motion_rms": MAYBE, "share": four, "held_out": YES})  # fmt: skip
    force = closed({"recording": TEXT, "unit": TEXT, "band_hz": MAYBE, "rms": three,
                    "acting_rms": three, "share": three, "held_out": YES})  # fmt: skip
    return closed({"held_out": share, "one_step": share, "free_run": share,
                   "whole_run": several(run), "force": several(force)})  # fmt: skip


def _adequacy() -> Schema:
    ahead = dict.fromkeys(("horizon", "error", "expected", "most", "led", "most_led"), MAYBE)
    return closed({"adequate": YES, "better_sigma": MAYBE, "explained_share": MAYBE,
                   "horizons": several(closed(ahead))})  # fmt: skip


def _learned() -> Schema:
    """The keys that every law has; those of one state or two are in docs/diagnosis_json.md."""
    common = closed({
        "effect": TEXT, "at": TEXT, "over": TEXT, "formula": MAYBE_TEXT, "beside": TEXTS,
        "absorbed": TEXTS, "replaced": TEXTS, "energy": TEXT, "gained": MAYBE,
        "free_run": closed({"names": MAYBE, "law": MAYBE}),
    })  # fmt: skip
    return common | {"additionalProperties": True}


def _change() -> Schema:
    windows = closed(dict.fromkeys(("times", "values", "lower", "upper"), MAYBES))
    return closed({
        "parameter": TEXT, "effect": MAYBE_TEXT, "at": MAYBE_TEXT, "against": MAYBE_TEXT,
        "shape": {"enum": list(SHAPES)}, "recording": TEXT, "at_s": MAYBE,
        "at_s_ci95": either(MAYBES), "time_constant_s": MAYBE,
        "time_constant_s_ci95": either(MAYBES), "follows": MAYBE_TEXT, "follows_unit": MAYBE_TEXT,
        "follows_from_to": either(MAYBES), "recordings": table(ESTIMATE), "as_well": TEXTS,
        "before": ESTIMATE, "after": ESTIMATE, "by": ESTIMATE, "gained": MAYBE,
        "free_run": either(closed({"constant": MAYBE, "changing": MAYBE})), "windows": windows,
    })  # fmt: skip


def _event() -> Schema:
    course = closed(dict.fromkeys(("times", "force", "lower", "upper", "motion"), MAYBES))
    return closed({
        "kind": {"enum": list(EVENTS)}, "at": TEXT, "elsewhere": TEXTS, "recording": TEXT,
        "at_s": MAYBE, "at_s_ci95": MAYBES, "until_s": MAYBE, "until_s_ci95": either(MAYBES),
        **dict.fromkeys(("force", "impulse", "energy", "slip"), either(ESTIMATE)),
        "stop": MAYBE, "gained": MAYBE, "course": course,
    })  # fmt: skip


def _cost() -> Schema:
    row = closed({"stage": TEXT, "reason": TEXT, "calls": COUNT, "member_ticks": COUNT,
                  "simulations": NUMBER})  # fmt: skip
    return closed({"fitted_ticks": COUNT, "simulations": NUMBER, "calls": COUNT,
                   "member_ticks": COUNT, "by": several(row)})  # fmt: skip


def joints() -> Schema:
    """The JSON of `zwidth diagnose --joint all`: of each joint its answer, or why it has none."""
    answer = {key: value for key, value in diagnosis().items() if key[0] != "$"}
    either_of = {"anyOf": [{"$ref": "#/$defs/diagnosis"}, closed({"error": TEXT})]}
    found = closed({"joints": table(either_of), "still": TEXTS})
    return named("joints", "diagnose --joint all --json", found | {"$defs": {"diagnosis": answer}})


def fleet() -> Schema:
    """The JSON of `zwidth diagnose` of a folder or a table of recordings."""
    valued = closed({"value": MAYBE, "error": MAYBE})
    parameter = closed({
        "unit": TEXT, "center": MAYBE, "center_error": MAYBE, "shared": YES, "per_device": YES,
        "per_run": YES, "device_rms": MAYBE, "run_rms": MAYBE, "slopes": table(valued),
        "gains": table(MAYBE), "repeats_over_errors": MAYBE, "sentence": TEXT,
    })  # fmt: skip
    odd = closed({
        "recording": TEXT, "device": TEXT, "kind": {"enum": list(FAULTS)}, "what": TEXT,
        "sentence": TEXT, "gained": MAYBE, "parameters": TEXTS, "recording_fault": YES,
    })  # fmt: skip
    change = closed({
        "device": TEXT, "parameter": TEXT, "shape": {"enum": [STEP, DRIFT]}, "date": TEXT,
        "date_ci95": TEXTS, "before": MAYBE, "after": MAYBE, "unit": TEXT, "gained": MAYBE,
        "sentence": TEXT,
    })  # fmt: skip
    member = closed({
        "recording": TEXT, "device": TEXT, "date": MAYBE_TEXT, "known": table(NUMBER),
        "problem": MAYBE_TEXT, "parameters": table(valued), "pooled": table(valued),
        "noise": MAYBE, "free_run": MAYBE, "odd": YES,
    })  # fmt: skip
    return named("fleet", "diagnose FOLDER --json", closed({
        "fleet": {"const": True}, "headline": TEXT, "recordings": COUNT, "devices": COUNT,
        "structure": TEXTS, "candidates": table(MAYBE), "parameters": table(parameter),
        "odd": several(odd), "changes": several(change), "members": several(member),
        "notes": TEXTS,
    }))  # fmt: skip


def check() -> Schema:
    """The JSON of `zwidth check`: its answer, or why it has none."""
    output = closed({"output": TEXT, "unit": TEXT, "error": MAYBE, "most": NUMBER,
                     "diagnosed": NUMBER, "motion": NUMBER, "within": YES})  # fmt: skip
    recording = closed({"recording": TEXT, "within": YES, "outputs": several(output),
                        "faults": TEXTS, "remarks": TEXTS})  # fmt: skip
    changed = closed({"parameter": TEXT, "was": NUMBER, "now": NUMBER, "unit": TEXT,
                      "ci95": NUMBERS, "recording": MAYBE_TEXT})  # fmt: skip
    answer = closed({
        "within": YES, "sentence": TEXT, "device": TEXT, "simulator": MAYBE_TEXT,
        "device_within": {"type": ["boolean", "null"]}, "recordings": several(recording),
        "changed": several(changed), "explains": YES,
    })  # fmt: skip
    none = closed({"error": TEXT, "status": {"enum": [2, 3, 130]}})
    found = {"type": "object", "if": {"required": ["error"]}, "then": none, "else": answer}
    return named("check", "check --json", found)


def plan() -> Schema:
    """The JSON of `zwidth plan`."""
    better = closed({"excitation": TEXT, "separation_sigma": MAYBE})
    pair = closed({"effects": TEXTS, "separation_sigma": MAYBE, "better": either(better)})
    limit = closed({"magnitude": NUMBER, "unit": TEXT, "parameters": table(NUMBER)})
    one = closed({"excitation": TEXT, "seconds": NUMBER, "limits": table(either(limit)),
                  "confusable": several(pair)})  # fmt: skip
    return named("plan", "plan --json", closed({
        "device": TEXT, "seconds": NUMBER,
        "noise": closed({"process": NUMBER, "measurement": NUMBER}), "level": NUMBER,
        "travel": NUMBER, "shown_at_sigma": NUMBER, "compared_at_multiple": NUMBER,
        "plans": several(one), "files": TEXTS,
    }))  # fmt: skip


def boundary() -> Schema:
    """The JSON of `zwidth boundary`, made from the types that write it."""
    found = msgspec.json.schema(BoundaryResult)
    for part in found["$defs"].values():
        part["additionalProperties"] = part.get("additionalProperties", False)
        if "description" in part:  # before msgspec 0.23, as indented as in the code
            part["description"] = cleandoc(part["description"])
        for value in part["properties"].values():
            if "anyOf" in value:  # in an order that differs between versions of msgspec
                value["anyOf"].sort(key=lambda one: one == {"type": "null"})
    return named("boundary", "boundary --json", found)


def relay() -> Schema:
    """The JSON of `zwidth relay`."""
    reference = closed({"verdict": TEXT, "stiffness": MAYBE, "frequency_hz": MAYBE})
    cycle = closed({"stiffness": NUMBER, "frequency_hz": NUMBER, "amplitude": NUMBER,
                    "share": NUMBER, "start": either(NUMBERS)})  # fmt: skip
    condition = closed({
        "delay_s": NUMBER, "damping": NUMBER, "verdict": TEXT, "stiffness": MAYBE,
        "frequency_hz": MAYBE, "share": MAYBE, "reference": reference, "cycles": several(cycle),
        "diverging_share": NUMBER, "undecided_share": NUMBER,
    })  # fmt: skip
    return named("relay", "relay --json", closed({"conditions": several(condition)}))


def sweep() -> Schema:
    """The JSON of `zwidth sweep`."""
    step = closed({"value": MAYBE, "area": MAYBE, "linear_area": MAYBE, "stiffest": MAYBE,
                   "dampings": NUMBERS, "linear": MAYBES, "simulated": MAYBES})  # fmt: skip
    return named("sweep", "sweep --json", closed({
        "device": TEXT, "setting": TEXT, "unit": TEXT, "best": MAYBE, "best_by_theory": MAYBE,
        "steps": several(step),
    }))  # fmt: skip


def map_() -> Schema:
    """The JSON of `zwidth map`."""
    pair = either(NUMBERS)
    fate = closed({"share": NUMBER, "amplitude": pair, "encoder_steps": pair, "force": pair})
    transition = closed({"x": NUMBER, "rests_up_to": MAYBE, "grows_from": MAYBE})
    cycles = closed({"nonlinearity": TEXT, "points": COUNT, "frequency_error": NUMBER,
                     "amplitude_error": NUMBER})  # fmt: skip
    return named("map", "map --json", closed({
        "device": TEXT, "axes": TEXTS, "runs": COUNT, "lattice": COUNT, "perceptible": MAYBE,
        "perceptible_position": MAYBE, "fates": closed({f.word: fate for f in Fate}),
        "stable_but_not_resting": MAYBE, "stable_but_perceptible": MAYBE,
        "unstable_but_resting": MAYBE, "transitions": several(transition),
        "describing_function": either(cycles),
    }))  # fmt: skip


def identify() -> Schema:
    """The JSON of `zwidth identify`."""
    return named("identify", "identify --json", closed({
        "device": TEXT, "modes": COUNT, "parameters": table(ESTIMATE), "misfit": NUMBER,
        "noise_rms": NUMBER, "device_file": TEXT, "covariance_file": TEXT,
    }))  # fmt: skip


SCHEMAS = {"device": device, "diagnosis": diagnosis, "joints": joints, "fleet": fleet,
           "check": check, "plan": plan, "boundary": boundary, "relay": relay, "sweep": sweep,
           "map": map_, "identify": identify}  # fmt: skip


def texts() -> dict[str, str]:
    """Return the text of every schema by the name of its file."""
    return {f"{name}.schema.json": json.dumps(make(), indent=1) + "\n"
            for name, make in SCHEMAS.items()}  # fmt: skip


def main() -> None:
    """Write the schemas beside this file."""
    for name, text in texts().items():
        (Path(__file__).parent / "schemas" / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
