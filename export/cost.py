"""The error of an export: the same command through device and export."""

from typing import NamedTuple

from zwidth.export.bam import has_bam, run_bam
from zwidth.export.compiled import compiler, run_c
from zwidth.export.fmu import Fmu, run_fmu
from zwidth.export.model import Exported, Floats, command_for, free_run, loss
from zwidth.export.mujoco_run import engine, run_mjcf, run_urdf
from zwidth.sim.device import Device


class Cost(NamedTuple):
    """share: rms error over rms motion, None if the export could not be run; said: a sentence."""

    share: float | None
    said: str


def cost_of(
    exported: Exported, device: Device, to: str, name: str, seconds: float, seed: int = 0
) -> Cost:
    """Run a device and its export under the same multisine and compare the measured positions.

    Raises ValueError if the compiler refuses a C file.
    """
    commands = command_for(device, seconds)
    if to == "c" and compiler() is None:
        return Cost(None, "Not measured: there is no C compiler here; install one, or set CC.")
    if to in ("mjcf", "urdf") and engine() is None:
        return Cost(None, "Not measured: MuJoCo is not installed here; pip install mujoco.")
    if to == "bam" and not has_bam():
        return Cost(
            None,
            "Not measured: BAM is not installed here; pip install better-actuator-models, on Python"
            " 3.12.",
        )
    if isinstance(exported, Fmu) and isinstance(exported.binary, str):
        return Cost(
            None,
            f"Not measured: {exported.binary}, so that the FMU has its sources and no binary; where"
            " there is one, 'fmpy compile FILE' adds it.",
        )
    theirs, how = _run(exported, to, name, commands)
    share = loss(free_run(device, commands, seed), theirs)
    return Cost(
        share if share < float("inf") else None,
        f"The export was {how} under the same multisine of {seconds:g} s: its rms difference from"
        f" zwidth is {percent(share)} of the motion.",
    )


def percent(share: float) -> str:
    """Return a share as a percentage: two digits, or whole percents if it is large."""
    if share == float("inf"):
        return "more than any share"
    return f"{100.0 * share:.0f} %" if share >= 0.995 else f"{100.0 * share:.2g} %"


def _run(exported: Exported, to: str, name: str, commands: Floats) -> tuple[Floats, str]:
    period = exported.held.interface.period
    match to:
        case "c":
            return run_c(exported.text(), name, commands), "compiled and run"
        case "mjcf":
            return run_mjcf(exported.text(), commands, period), "run in MuJoCo"
        case "fmu":
            return run_fmu(exported.content(), commands), "run by fmpy"
        case "bam":
            return run_bam(exported.text(), commands, period), "run in BAM's own simulator"
        case "urdf":
            limit = exported.held.interface.command_limit
            return run_urdf(exported.text(), commands, period, limit), "run in MuJoCo"
        case _:
            how = "simulated by zwidth itself, since nothing else here reads it,"
            return free_run(exported.held, commands), how
