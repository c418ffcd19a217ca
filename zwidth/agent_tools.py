"""The tools that `zwidth mcp` offers to an agent: four commands of the command line.

Each tool runs its command in a separate process, so that a diagnosis neither blocks the server nor
writes into its protocol, and ends when the agent cancels it. It returns the JSON of the command;
for a diagnosis, the parts that an agent needs, and the path of the complete result.
"""

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import anyio  # pyright: ignore[reportMissingImports]
from mcp.server.mcpserver import MCPServer  # pyright: ignore[reportMissingImports]
from mcp.server.mcpserver.exceptions import ToolError  # pyright: ignore[reportMissingImports]

from zwidth.errors import Status

INSTRUCTIONS = (
    "zwidth finds why a recording of a machine differs from its simulation, whether a device file"
    " is still true, what a recording would show, and how stiff a virtual wall a device renders."
    " Quantities are SI. Files are read and written on the machine where this server runs; results"
    " go to the folder `out`."
)
SUMMARY = (
    "verdict", "headline", "sentence", "warnings", "assumptions", "findings", "negligible",
    "linear_refit", "changes", "events", "faults", "next_experiment", "boundary",
    "augmented_device", "report", "logs", "interrupted", "errors",
)  # fmt: skip
Effort = Literal["quick", "normal", "thorough"]


async def asked(command: str, options: dict[str, Any], *arguments: str) -> dict[str, Any]:
    """Return the JSON of a command, with its exit status.

    options: by their names; None leaves one out, a list gives it several values. Raises ToolError
    with the command's message if it gave no JSON, or only an error.
    """
    with TemporaryDirectory(prefix="zwidth-mcp-") as folder:
        file = Path(folder) / "result.json"
        words = [f"--json={file}"]
        for name, value in options.items():
            flag = f"--{name.replace('_', '-')}"
            if isinstance(value, list):
                words += [flag, *(f"{float(v):.17g}" for v in value)] if value else []
            elif value is not None:
                words.append(f"{flag}={value}")
        line = [sys.executable, "-m", "zwidth", command, *words, "--", *arguments]
        done = await anyio.run_process(line, check=False)
        if not file.is_file():
            said = done.stderr.decode(errors="replace").strip().splitlines()
            raise ToolError(said[-1] if said else f"exit status {done.returncode}")
        found = json.loads(file.read_text(encoding="utf-8"))
        if isinstance(found.get("error"), str):
            raise ToolError(found["error"])
        return {"status": done.returncode, **found}


async def diagnose(
    recordings: list[str],
    device: str | None = None,
    joint: str | None = None,
    effort: Effort = "normal",
    out: str = "runs",
) -> dict[str, Any]:
    """Say why recordings of a machine differ from its simulation: what physics is missing.

    recordings: files (CSV, MAT, MCAP, a ROS 2 bag's folder ...) of one device. device: its device
    file, or the name of a shipped one; without it a device is fitted. joint: the joint to diagnose,
    if recordings have several. Takes half a minute to some minutes; quick finds three effects at
    most. The report for people is `report`, the improved device `augmented_device`.
    """
    options = {"device": device, "joint": joint, "effort": effort, "out": out}
    found = await asked("diagnose", options, *recordings)
    return {"status": found["status"], **{key: found[key] for key in SUMMARY if key in found}}


async def check(
    device: str, recordings: list[str], model: str | None = None, joint: str | None = None
) -> dict[str, Any]:
    """Check whether a device file still describes its machine, and say what changed if not.

    device: the improved device of a diagnosis (`augmented_device`). recordings: later ones of the
    same machine. model, joint: an MJCF or URDF model that MuJoCo runs instead. Takes seconds.
    status 0: within the band, 1: outside. Bad input (2) or a check that failed (3) is an error of
    this tool and says nothing about the machine.
    """
    return await asked("check", {"model": model, "joint": joint}, device, *recordings)


async def plan(
    device: str, seconds: float = 20.0, noise: float | None = None, out: str = "runs/plan"
) -> dict[str, Any]:
    """Predict which effects a recording would show, and write commands worth recording.

    device: a device file or the name of a shipped one. seconds: length of the recording. noise: rms
    of a measured position [rad | m]; needed where the device has no encoder step. Takes minutes.
    """
    options = {"seconds": seconds, "noise": noise, "out": out}
    return await asked("plan", options, device)


async def boundary(
    device: str,
    delay_ms: list[float] | None = None,
    damping: list[float] | None = None,
    out: str = "runs/boundary",
) -> dict[str, Any]:
    """Say how stiff a virtual wall a haptic device can render: K over the damping B of the wall.

    device: a device file or the name of a shipped one. delay_ms: delays of its loop, by default its
    own. damping: B [N m s/rad | N s/m], by default a grid of 41.
    """
    options = {"delay_ms": delay_ms or [], "damping": damping or [], "out": out}
    return await asked("boundary", options, device)


def server() -> Any:
    """Return the server with its tools; raises ImportError without the protocol's SDK."""
    found = MCPServer("zwidth", instructions=INSTRUCTIONS)
    for tool in (diagnose, check, plan, boundary):
        found.tool()(tool)
    return found


def serve() -> int:
    """Serve on standard input and output until the client leaves."""
    server().run("stdio")
    return Status.DONE
