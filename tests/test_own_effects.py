"""Effects of the user's own: from a formula in a file into the kernels, the diagnosis and logs."""

import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from zwidth.cli import run
from zwidth.diagnosis.learning.formulas import LAWS
from zwidth.diagnosis.learning.own_effect import effect_text, law_of_two_text
from zwidth.errors import Status
from zwidth.sim.own_files import VARIABLE, own_files, source_hash
from zwidth.sim.physics.own import FIRST_CODE, PLAIN, OwnEffect, compiled, read_own, translated
from zwidth.sim.table import TableError

PAGE = Path(__file__).parent.parent / "docs" / "own_effects.md"
DRAG = """
name = "cubic_drag"
formula = "-c * v**3"
[parameters.c]
unit = "N m s3/rad3"
"""


def read(text: str) -> tuple[OwnEffect, str]:
    return read_own(Path("drag.toml"), text.encode(), FIRST_CODE)


@pytest.mark.parametrize(
    ("formula", "truth"),
    [
        ("-a * v**3", lambda q, v, u: -0.7 * v**3),
        ("a * exp(-((q - b) / 0.3)**2)", lambda q, v, u: 0.7 * math.exp(-(((q - 0.2) / 0.3) ** 2))),
        ("a * u if q > b else -v", lambda q, v, u: 0.7 * u if q > 0.2 else -v),
        ("min(a, max(q, -a)) - atan(v) * pi", lambda q, v, u: q - math.atan(v) * math.pi),
        ("a * abs(v)**1.5 * sign(v)", lambda q, v, u: math.copysign(0.7 * abs(v) ** 1.5, v)),
        ("clip(u, -b, b) + sqrt(abs(q)) - tan(q)",
         lambda q, v, u: 0.2 + math.sqrt(abs(q)) - math.tan(q)),
    ],
)  # fmt: skip
def test_a_formula_means_what_it_says(formula: str, truth: Callable[..., float]):
    law = translated(formula, ("q", "v", "u"), ("a", "b"))
    plain = eval(f"lambda q, v, u, p: {law}", dict(PLAIN))
    kernel = compiled("code, q, v, u, p", {FIRST_CODE: law}, "0.0")
    for q, v, u in ((0.5, -1.3, 2.0), (-0.4, 0.6, 1.0)):
        wanted = truth(q, v, u)
        assert plain(q, v, u, (0.7, 0.2)) == pytest.approx(wanted, rel=1e-12)
        found = kernel(FIRST_CODE, q, v, u, np.array([0.7, 0.2]))
        assert found == pytest.approx(wanted, rel=1e-12)
    assert kernel(FIRST_CODE + 1, 0.5, 1.0, 2.0, np.array([0.7, 0.2])) == 0.0


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("-c * w", "has 'w'"),
        ("c * __import__('os').getpid()", "it may use"),
        ("c * v.real", "it may use"),
        ("(lambda: c)()", "it may use"),
        ("c * (v and q)", "it may use"),
        ("c * True", "it may use"),
        ("c * [v][0]", "it may use"),
        ("c * min(v)", "min with 1 argument(s); it takes 2"),
        ("c * _power(v, 2)", "it may use"),
        ("c * v if 0 < v < 1 else 0", "it may use"),
        ("c *", "is not an expression"),
    ],
)
def test_nothing_but_arithmetic_is_a_formula(formula: str, said: str):
    with pytest.raises(TableError, match=re.escape(said)):
        translated(formula, ("q", "v", "u"), ("c",))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"cubic_drag"', '"Cubic drag"', "name is 'Cubic drag'"),
        ("-c * v**3", "-c * v**3 + 1", "with c at 0; it must then be 0"),
        ("[parameters.c]", "[parameters.v]", "parameters has 'v'"),
        ("[parameters.c]", 'enters = "sensor"\n[parameters.c]', "formula has 'v'"),
        ("[parameters.c]", 'at = ["m9"]\n[parameters.c]', "at has 'm9'"),
        ("[parameters.c]", 'colour = "red"\n[parameters.c]', "colour"),
        ("-c * v**3", "-tanh(c * v)", r"parameters\.c\.start is missing"),
        ("unit =", "lower = 2\nupper = 1\nunit =", r"lower is 2 and upper 1"),
        ("unit =", "lower = 'x'\nunit =", "lower"),
        ("unit =", 'role = "captain"\nunit =', "role is 'captain'"),
        ('name = "cubic_drag"', "name = ", "is not TOML"),
    ],
)  # fmt: skip
def test_a_file_that_is_wrong_is_said_in_one_sentence(old: str, new: str, said: str):
    assert old in DRAG
    with pytest.raises(TableError, match=said) as error:
        read(DRAG.replace(old, new))
    assert "\n" not in str(error.value)


def test_a_magnitude_is_found_from_the_formula_and_sought_by_what_moves():
    own, law = read(DRAG)
    (c,) = own.effect.parameters
    assert (c.role, c.neutral, c.lower) == ("magnitude", 0.0, 0.0)
    assert law == "((-p[0]) * (v * v * v))"
    assert own.source == source_hash(DRAG.encode())
    assert own.effect.code == FIRST_CODE
    assert "m1" in own.effect.places


def test_files_are_those_that_a_variable_names_or_of_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(VARIABLE, raising=False)
    assert own_files() == ()
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "b.toml").write_text(DRAG)
    (tmp_path / "effects" / "a.toml").write_text("title = 'something else'")
    assert own_files() == (Path("effects/b.toml"),)
    monkeypatch.setenv(VARIABLE, "")
    assert own_files() == ()
    monkeypatch.setenv(VARIABLE, f"x.toml{os.pathsep}effects")
    assert own_files() == (Path("x.toml"), Path("effects/b.toml"))


@pytest.mark.parametrize("effect", ["free_spring", "free_damper", "free_amplifier", "free_sensor"])
@pytest.mark.parametrize("form", list(LAWS))
def test_whatever_formula_was_learned_is_a_file_that_is_read(effect: str, form: str):
    numbers = dict.fromkeys("abcdefghijklmnopqrstuvwxyz", 0.5) | {"k1": 0.3, "k2": 0.2}
    own, _ = read(effect_text("mine", effect, form, numbers, "a test"))
    assert own.effect.hook == {"free_amplifier": "command", "free_sensor": "sensor"}.get(
        effect, "force"
    )
    assert all(p.unit_for(True) is not None for p in own.effect.parameters)


@pytest.mark.parametrize("second", list(LAWS))
@pytest.mark.parametrize("states", [("position", "velocity"), ("velocity", "command")])
def test_a_product_that_was_learned_is_a_file_that_is_read(states: tuple[str, str], second: str):
    """Its law is that of both formulas; mutation that breaks it: numbers of one for the other."""
    letters = "abcdefghijklmnopqrstuvwxyz"
    first = dict.fromkeys(letters, 0.5)
    numbers = dict.fromkeys(letters, 0.25)
    own, law = read(law_of_two_text("mine", states, [("cube", first), (second, numbers)], "a test"))
    assert own.effect.hook == "force"
    assert {"a", *(p.name for p in own.effect.parameters if p.name.endswith("_2"))} == {
        p.name for p in own.effect.parameters
    }
    letter = {"position": "q", "velocity": "v", "command": "u"}
    assert all(letter[state] in law for state in states if second != "offset" or state != states[1])
    found = {p.name: p.meaning for p in own.effect.parameters}
    assert found["a"] == "found as 0.5"
    assert all(value == "found as 0.25" for name, value in found.items() if name != "a")


@pytest.mark.parametrize("form", list(LAWS))
def test_whatever_formula_shifts_another_is_a_file_that_is_read(form: str):
    """Each as what shifts and as what is shifted. Mutation that breaks it: factors of no start."""
    numbers = dict.fromkeys("abcdefghijklmnopqrstuvwxyz", 0.5)
    for forms in ((form, "cube"), ("cube", form)):
        each = [(name, numbers) for name in forms]
        own, _ = read(law_of_two_text("mine", ("velocity", "command"), each, "a test", shifts=True))
        assert all(p.unit_for(True) is not None for p in own.effect.parameters)


@pytest.mark.parametrize("states", [("position", "velocity"), ("command", "position")])
def test_a_shift_that_was_learned_is_a_file_that_is_read(states: tuple[str, str]):
    """Mutations that break it: the shift taken off; added to the wrong state; a force's unit."""
    forms = [("cube", {"a": 3.0}), ("saturation", {"a": 0.2, "w": 0.5})]
    own, law = read(law_of_two_text("mine", states, forms, "a test", shifts=True))
    plain = eval(f"lambda q, v, u, p: {law}", dict(PLAIN))
    numbers = {"a": 3.0, "a_2": 0.2, "w_2": 0.5}
    at = {states[0]: 0.3, states[1]: 0.7}
    q, v, u = (at.get(state, 99.0) for state in ("position", "velocity", "command"))
    found = plain(q, v, u, [numbers[p.name] for p in own.effect.parameters])
    assert found == pytest.approx(3.0 * (0.3 + 0.2 * math.tanh(0.7 / 0.5)) ** 3)
    unit = own.effect.parameter("a_2").unit
    assert unit == ("rad" if states[0] == "position" else "N m")
    assert own.effect.summary.startswith(f"cube of the {states[0]} shifted by a saturation of")


def test_what_was_learned_is_kept_as_a_file_of_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    form = next(iter(LAWS))
    learned = {
        "effect": "free_damper", "formula": "f = -0.02 v^3",
        "formulas": [{"form": form, "numbers": dict.fromkeys("abcdefghijklmnopqrstuvwxyz", 0.5)}],
    }  # fmt: skip
    Path("answer.json").write_text(json.dumps({"learned": learned, "recordings": ["shake"]}))
    assert run(["effects", "mine", "--learned", "answer.json"]) == 0
    own, _ = read(Path("effects/mine.toml").read_text())
    assert own.effect.name == "mine"
    assert "shake" in own.effect.reference
    numbers = {"a": -0.1, "w": 0.2, "c": 0.0, "m": 0.1}
    parts = [{"state": "position", "form": "bump", "numbers": numbers},
             {"state": "velocity", "form": "saturation", "numbers": numbers}]  # fmt: skip
    learned = {"effect": "free_product", "formula": "f(q) g(v)",
               "formulas": [{"form": "product", "factors": parts}]}  # fmt: skip
    Path("both.json").write_text(json.dumps({"learned": learned}))
    assert run(["effects", "both", "--learned", "both.json"]) == 0
    own, _ = read(Path("effects/both.toml").read_text())
    assert own.effect.summary == "bump of the position times saturation of the velocity"
    moved = {**learned, "formulas": [{"form": "shift", "factors": parts}]}
    Path("moved.json").write_text(json.dumps({"learned": moved}))
    assert run(["effects", "moved", "--learned", "moved.json"]) == 0
    own, _ = read(Path("effects/moved.toml").read_text())
    assert own.effect.summary == "bump of the position shifted by a saturation of the velocity"
    capsys.readouterr()
    assert run(["effects", "coulomb_friction", "--learned", "answer.json"]) == Status.BAD_INPUT
    assert "not be the name of an effect of the library" in capsys.readouterr().err
    Path("half.json").write_text(json.dumps({"learned": {**learned, "formulas": [
        {"form": "shift", "factors": parts[:1]}]}}))  # fmt: skip
    assert run(["effects", "half", "--learned", "half.json"]) == Status.BAD_INPUT
    assert "half.json is not a result of" in capsys.readouterr().err
    del parts[1]["numbers"]
    Path("both.json").write_text(json.dumps({"learned": learned}))
    assert run(["effects", "less", "--learned", "both.json"]) == Status.BAD_INPUT
    assert "both.json is not a result of" in capsys.readouterr().err
    Path("answer.json").write_text(json.dumps({"learned": None}))
    assert run(["effects", "other", "--learned", "answer.json"]) == Status.BAD_INPUT
    assert "no learned law" in capsys.readouterr().err


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(), re.DOTALL)


CLOSED_FORM = """
import numpy as np
from zwidth.controllers.wall import wall
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate

m, c, v0 = 0.002, 2e-5, 20.0
drag = make_physics("cubic_drag", "m1", c=c)
chain = make_chain([m], [0.0], 0.0)
device = Device("mass", "", True, chain, Interface(period=1e-3)).with_physics(drag)
trace = simulate(device, wall(0.0, 0.0), duration=0.5, start=Start(0.0, v0), substeps=10).trace
v, t = trace["velocity_m1"], np.arange(trace["velocity_m1"].size) * 1e-3
print(float(np.abs(v / (v0 / np.sqrt(1.0 + 2.0 * c / m * v0**2 * t)) - 1.0).max()))
"""


@pytest.mark.truth
def test_the_documented_example_from_a_file_to_a_boundary(tmp_path: Path):
    """In a process of its own, since an effect is compiled into the kernels."""
    (tmp_path / "effects").mkdir()
    for text, name in zip(
        blocks("toml"), ("effects/cubic_drag.toml", "arm.toml", "shake.toml"), strict=True
    ):
        (tmp_path / name).write_text(text)
    exec(blocks("python")[0].replace('"commands.txt"', repr(str(tmp_path / "commands.txt"))), {})
    environment = {k: v for k, v in os.environ.items() if k != VARIABLE}

    def asked(*words: str) -> str:
        done = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True,
            text=True, timeout=900, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    # Second order in a substep of 0.1 ms: (c v0^2 / m h)^2, of which a tenth is its constant.
    assert float(asked("-c", CLOSED_FORM)) < 1e-6
    for line in blocks("sh")[0].strip().splitlines():
        words = line.split()[1:]
        words += ["--effort", "quick", "--json", "answer.json"] if words[0] == "diagnose" else []
        out = asked("-m", "zwidth", *words)
        if words[0] == "effects":
            assert "-c * v**3" in out
            assert "cubic_drag.toml" in out
    answer = json.loads((tmp_path / "answer.json").read_text())
    (found,) = answer["findings"]
    assert (answer["verdict"], found["effect"], found["at"]) == ("identified", "cubic_drag", "m1")
    assert found["parameters"]["c"]["value"] == pytest.approx(2e-5, rel=1e-4)

    # The log says which text it was; without the file, or with another, replay says so.
    log = str(tmp_path / "runs" / "shake.mcap")
    replayed = [sys.executable, "-m", "zwidth", "replay", log]
    alone = subprocess.run(
        replayed, cwd=tmp_path.parent, env=environment, capture_output=True, text=True, check=False
    )
    assert alone.returncode == Status.BAD_INPUT
    assert "'cubic_drag'" in alone.stderr
    assert "Traceback" not in alone.stderr
