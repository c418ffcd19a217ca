"""The benchmarks: what they ask, by `nonlinear_benchmarks`' own loaders, and what others reach.

The loaders of `nonlinear_benchmarks` fetch their files from the web once and read them from a
folder afterwards. `placed` puts files that one has already into such a folder, so that the splits
and the windows of the first state are those of the package and not a copy of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from zwidth import Diagnosis, diagnose

Floats = NDArray[np.float64]
MACHINES = Path(__file__).parents[2] / "docs" / "machines"


@dataclass(frozen=True)
class Board:
    """A data set of the benchmarks: its loader, and what it is a recording of.

    scale: SI units of the command in one of the file's. shown: the unit in which errors are shown,
    and how many of it are one of the file's. published: test part -> what others reach, in the
    shown unit, and by what; in the order of the tests. identibench: its benchmark there.
    """

    name: str
    title: str
    loader: str
    device: Path
    scale: float
    shown: tuple[str, float]
    published: dict[str, str]
    identibench: str
    effort: Literal["quick", "normal", "thorough"] = "quick"

    @property
    def unit(self) -> str:
        """The unit in which errors are shown."""
        return self.shown[0]

    def load(self, folder: Path) -> tuple[Any, tuple[Any, ...]]:
        """Return train and tests as the package splits them, `Input_output_data` each."""
        import nonlinear_benchmarks

        train, tests = getattr(nonlinear_benchmarks, self.loader)(dir_placement=folder)
        return train, tests if isinstance(tests, tuple) else (tests,)

    def answer(self, train: Any, say: Callable[[str], None] | None = None) -> Diagnosis:
        """Return the diagnosis of the training data: nothing else is fitted to."""
        t = np.arange(len(train)) * float(train.sampling_time)
        return diagnose(
            {"t_s": t, "force_N": self.scale * np.ravel(train.u), "position_m": np.ravel(train.y)},
            self.device, time="t_s", command="force_N", position="position_m",
            effort=self.effort, say=say,
        )  # fmt: skip

    def predicted(self, answer: Diagnosis, u: Floats, first: Floats) -> Floats:
        """Return (ticks,) of a test: u (ticks,) in the file's unit, its first readings (n,)."""
        return answer.predict(self.scale * np.ravel(u), np.ravel(first))


BOARDS = {
    board.name: board
    for board in (
        Board(
            "emps", "EMPS, a positioning system", "EMPS", MACHINES / "emps" / "device.toml",
            35.150652, ("mm", 1e3),
            {"pulses": "black boxes: dynoNet 2.64, an automated search 4.10, LSTM 74, RNN 89, GRU"
                       " 220; textbook structure trained by gradients: 76 to 80"},
            "BenchmarkEMPS_Simulation",
        ),
        Board(
            "silverbox", "Silverbox, an electronic oscillator", "Silverbox",
            MACHINES / "silverbox" / "device.toml", 1.0, ("mV", 1e3),
            {"multisine": "black boxes: best 0.24 to 0.3, GRU 1.49",
             "arrow, full": "black boxes: best 0.24 to 0.3, GRU 2.80",
             "arrow, no extrapolation": "black boxes: GRU 0.947"},
            "BenchmarkSilverbox_Simulation",
        ),
    )
}  # fmt: skip


def placed(recordings: Path, folder: Path) -> Path:
    """Return a folder from which the loaders read the recordings' files without fetching any.

    recordings: the folder with `emps/DATA_EMPS.mat`, `official/DATA_EMPS_PULSES.mat` and
    `official/SNLS80mV.csv`. Raises OSError if one is missing.
    """
    emps, box = folder / "EMPS", folder / "Silverbox" / "SilverboxFiles"
    for place in (emps, box):
        place.mkdir(parents=True, exist_ok=True)
    for name, of in (("DATA_EMPS.mat", "emps"), ("DATA_EMPS_PULSES.mat", "official")):
        (emps / name).write_bytes((recordings / of / name).read_bytes())
    v1, v2 = np.loadtxt(
        recordings / "official" / "SNLS80mV.csv", delimiter=",", skiprows=1, usecols=(0, 1)
    ).T
    savemat(box / "SNLS80mV.mat", {"V1": v1[None], "V2": v2[None]})
    # A loader asks for the archive that it would fetch, and nothing more of it.
    for archive in (emps / "EMPS.zip", box.parent / "SilverboxFiles.zip"):
        with ZipFile(archive, "w"):
            pass
    return folder
