"""A batch system's SIGTERM ends a search as Ctrl-C does: what was found until then is judged."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.intake.take_in import said_once

# The command, which waits when the search begins for a word that never comes.
WAITING = """
import sys
from zwidth.cli import main
from zwidth.diagnosis.selection import search
rounds = search._rounds
def searched(found):
    print("it searches", flush=True)
    sys.stdin.readline()
    rounds(found)
search._rounds = searched
sys.argv[0] = "zwidth"
main()
"""


@pytest.mark.skipif(os.name != "posix", reason="signals as a batch system sends them are POSIX")
def test_what_was_found_is_judged_and_written(tmp_path: Path) -> None:
    """Status 143, the report and the device are there, and no traceback is.

    Mutations: no handler of SIGTERM (-15, nothing written); the status of Ctrl-C.
    """
    random = np.random.default_rng(2)
    t = 0.002 * np.arange(1000)
    u = np.convolve(random.standard_normal(t.size), np.ones(20) / 20.0, mode="same")
    v = np.zeros(t.size)
    for k in range(1, t.size):
        v[k] = v[k - 1] + 0.002 * (u[k - 1] - 0.5 * v[k - 1]) / 0.1
    x = 0.002 * np.cumsum(v) + 1e-5 * random.standard_normal(t.size)
    rows = [f"{a:.6f},{b:.6f},{c:.8f}" for a, b, c in zip(t, u, x, strict=True)]
    (tmp_path / "rig.csv").write_text("\n".join(["time_s,torque_Nm,angle_rad", *rows, ""]))
    with subprocess.Popen(
        [sys.executable, "-c", WAITING, "diagnose", "rig.csv", "--effort", "quick", "--out", "."],
        cwd=tmp_path, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    ) as child:  # fmt: skip
        assert child.stdout is not None
        assert any(line == "it searches\n" for line in child.stdout)
        child.send_signal(signal.SIGTERM)
        said, error = child.communicate(timeout=300)
    assert child.returncode == 143, error
    assert "Traceback" not in error
    assert "interrupted" in said
    assert (tmp_path / "rig.diagnosis.html").exists()
    assert (tmp_path / "rig.augmented.toml").exists()


def test_what_is_odd_of_stretches_is_said_once_and_of_recordings_each() -> None:
    """Mutations: the recording, or the channel, left out of what is the same."""

    def repeats(share: float, channel: str = "position_m1", of: str = "rig") -> Fault:
        said = f"{share:.1f} % of the samples of {channel} of {of} repeat the one before"
        return Fault("repeated_samples", said, False, share, of)

    each = [repeats(6.9), repeats(8.7), repeats(7.0, "velocity_m1"), repeats(6.0, of="bench")]
    assert said_once(each) == [each[1], each[2], each[3]]
