"""Write the JSON schemas of device files and of results: `python docs/make_schemas.py`.

The schema of a device file follows from the declarations that its reader uses; those of results say
what programs may rely on.
"""

import json
from pathlib import Path
from typing import Any

from zwidth.diagnosis.answer.result import Verdict
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
MAYBE: Schema = {"type": ["number", "null"]}
OBJECT: Schema = {"type": "object"}


def closed(properties: Schema, optional: tuple[str, ...] = ()) -> Schema:
    """An object with these keys and no others, all of them but the optional ones required."""
    required = [key for key in properties if key not in optional]
    return {"type": "object", "properties": properties, "required": required,
            "additionalProperties": False}  # fmt: skip


def several(item: Schema) -> Schema:
    """A list of these."""
    return {"type": "array", "items": item}


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
    band |= keys("band", ["corrected"], TEXTS) | {"output": several(closed(outputs))}
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
        "band": closed(band, ("corrected",)), "posterior": closed(posterior),
        "physics": several({"oneOf": _effects()}),
    }  # fmt: skip
    assert set(top) == set(TOP_KEYS)
    found = closed(top, tuple(key for key in top if key not in ("name", "rotary")))
    either = {"oneOf": [{"required": ["chain"]}, {"required": ["modal"]}]}
    return {"$schema": DIALECT, "title": "zwidth device file", **found, **either}


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


def diagnosis() -> Schema:
    """The JSON of `zwidth diagnose`."""
    rival = closed({"effect": TEXT, "at": TEXT, "separation_sigma": MAYBE, "probability": MAYBE})
    finding = closed({
        "effect": TEXT, "at": TEXT,
        "parameters": {"type": "object", "additionalProperties": ESTIMATE},
        "separation_sigma": MAYBE, "probability": MAYBE, "probability_with_richer": MAYBE,
        "rivals": several(rival), "regimes": several(OBJECT), "worth": {"type": ["object", "null"]},
    })  # fmt: skip
    refit = closed({"nominal": MAYBE, **ESTIMATE["properties"]})
    share = closed({"before": MAYBE, "refit": MAYBE, "after": MAYBE, "noise_floor": MAYBE})
    fit = closed({"held_out": share, "one_step": share, "free_run": share,
                  "whole_run": several(OBJECT), "force": several(OBJECT)})  # fmt: skip
    fault = closed({"kind": TEXT, "sentence": TEXT, "wrong": YES, "value": MAYBE,
                    "recording": TEXT, "channels": TEXTS})  # fmt: skip
    maybe = {"type": ["object", "null"]}
    return {"$schema": DIALECT, "title": "zwidth diagnose --json"} | closed({
        "verdict": {"enum": [verdict.value for verdict in Verdict]},
        "headline": TEXT, "sentence": TEXT, "warnings": TEXTS, "findings": several(finding),
        "negligible": several(finding),
        "linear_refit": {"type": "object", "additionalProperties": refit}, "where": OBJECT,
        "fit": fit, "adequacy": maybe, "learned": maybe, "changes": several(OBJECT),
        "events": several(OBJECT), "upper_bounds": OBJECT, "faults": several(fault),
        "next_experiment": maybe, "next_level": maybe, "interrupted": YES, "facts": OBJECT,
        "cost": OBJECT, "errors": several(OBJECT), "boundary": maybe, "device": TEXT,
        "assumptions": TEXTS, "augmented_device": {"type": ["string", "null"]},
        "report": {"type": ["string", "null"]}, "logs": TEXTS,
    }, ("assumptions",))  # fmt: skip


def check() -> Schema:
    """The JSON of `zwidth check`."""
    output = closed({"output": TEXT, "unit": TEXT, "error": MAYBE, "most": NUMBER,
                     "diagnosed": NUMBER, "motion": NUMBER, "within": YES})  # fmt: skip
    recording = closed({"recording": TEXT, "within": YES, "outputs": several(output),
                        "faults": TEXTS, "remarks": TEXTS})  # fmt: skip
    changed = closed({"parameter": TEXT, "was": NUMBER, "now": NUMBER, "unit": TEXT,
                      "ci95": NUMBERS})  # fmt: skip
    return {"$schema": DIALECT, "title": "zwidth check --json"} | closed({
        "within": YES, "sentence": TEXT, "device": TEXT, "simulator": {"type": ["string", "null"]},
        "device_within": {"type": ["boolean", "null"]}, "recordings": several(recording),
        "changed": several(changed), "explains": YES,
    })  # fmt: skip


SCHEMAS = {"device": device, "diagnosis": diagnosis, "check": check}


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
