"""The first session of a stranger, whole: own CSV, diagnosis, check in CI, export, MuJoCo.

The recordings come from scipy (`test_newcomer`), the check in CI is the steps of the Action, and
MuJoCo runs the exported model by its own Python package.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
from test_action import outputs, step  # noqa: E402
from test_newcomer import FRICTION, RATE, SHARP, Floats, command, save, swung  # noqa: E402


def rubbing(u: Floats, share: float = 1.0) -> Floats:
    """The angle [rad] of the rig with dry friction."""
    return swung(u, lambda _, v: -share * FRICTION * np.tanh(v / SHARP))


def zwidth(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """What a person types, without a terminal."""
    return subprocess.run(
        [sys.executable, "-m", "zwidth", *line.split()], cwd=folder, check=False,
        capture_output=True, text=True, timeout=1200,
    )  # fmt: skip


def in_mujoco(file: Path, u: Floats) -> Floats:
    """Return the angle of a free run of the model, with the command held over each sample."""
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    substeps = round(1.0 / RATE / model.opt.timestep)
    angle = np.empty(u.size)
    for k, force in enumerate(u):
        angle[k] = data.qpos[0]
        data.ctrl[0] = force
        mujoco.mj_step(model, data, substeps)
    return angle


@pytest.mark.truth
def test_from_a_csv_to_an_answer_a_check_in_ci_and_a_simulator(tmp_path: Path):
    (tmp_path / "bin").mkdir()
    for name, line in (("zwidth", "-m zwidth"), ("python", "")):
        script = tmp_path / "bin" / name
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" {line} "$@"\n')
        script.chmod(0o755)
    (tmp_path / "logs").mkdir()
    u = command(3.0)
    later = u[::-1].copy()
    save(tmp_path / "data.csv", u, rubbing(u))
    save(tmp_path / "logs" / "later.csv", later, rubbing(later))

    done = zwidth("diagnose data.csv --effort quick", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Coulomb friction" in done.stdout
    assert "wrote runs/data.augmented.toml" in done.stdout

    given = {"device": "runs/data.augmented.toml", "logs": "logs/*.csv"}
    done = step("Check", given, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "still describes the recording" in outputs(tmp_path)["sentence"]
    save(tmp_path / "logs" / "worn.csv", later, rubbing(later, 1.2))
    done = step("Check", given, tmp_path)
    assert done.returncode == 1, done.stdout + done.stderr
    assert outputs(tmp_path)["sentence"].endswith(
        "no longer describes worn.csv: Coulomb friction +20 %"
    )

    done = zwidth("export runs/data.augmented.toml --to mjcf --out robot.xml", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "robot.xml" in done.stdout
    angle = rubbing(later)
    wrong = in_mujoco(tmp_path / "robot.xml", later) - angle
    assert np.sqrt(np.mean(wrong**2)) < 0.05 * np.std(angle)
    on = "--model robot.xml --joint m1"
    line = f"check runs/data.augmented.toml logs/later.csv --rebase model.toml {on}"
    assert zwidth(line, tmp_path).returncode == 0
    done = zwidth(f"check model.toml logs/later.csv {on}", tmp_path)
    assert done.returncode == 0, done.stdout
