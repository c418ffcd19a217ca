"""Make `docs/reference/export.md`: what survives in which format, measured.

    python docs/make_export_page.py

Needs a C compiler, fmpy and MuJoCo. Every effect is added to one device,
at a tenth of what the device is driven by, and exported; both then follow the same command.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from zwidth.controllers.recorded import recorded
from zwidth.exam.odds import sized
from zwidth.export.c_source import c_source
from zwidth.export.cost import cost_of, percent
from zwidth.export.fmu import fmu
from zwidth.export.mjcf import mjcf
from zwidth.export.model import Exported, command_for
from zwidth.export.robots import sdf, urdf
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text
from zwidth.scenarios.concealed.shapes import Motion
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.physics import LIBRARY, make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import grid_values
from zwidth.sim.physics.free_law import table_values
from zwidth.sim.physics.two_tables import two_tables_values
from zwidth.sim.run import simulate

PAGE = Path(__file__).parent / "reference" / "export.md"
SECONDS, SHARE = 2.0, 0.1
MAKERS: dict[str, Callable[[Device], Exported]] = {
    "c": lambda d: c_source(d, "dev"),
    "fmu": lambda d: fmu(d, "dev"),
    "mjcf": lambda d: mjcf(d, "dev"),
    "urdf": lambda d: urdf(d, "dev"),
    "sdf": lambda d: sdf(d, "dev"),
}
TABLES = {  # (state, value) as shares of the motion and of the rms command
    "free_spring": ((-1.0, 0.2), (0.0, 0.0), (1.0, -0.1)),
    "free_damper": ((-1.0, 0.2), (0.0, 0.0), (1.0, -0.1)),
    "free_amplifier": ((-2.0, 0.2), (0.0, 0.0), (2.0, 0.2)),
    "free_sensor": ((-1.0, 0.1), (0.0, 0.0), (1.0, 0.1)),
}


def base() -> Device:
    """Return the device of the table: two masses on a belt."""
    chain = make_chain([3e-3, 1e-3], [2e-2, 5e-3], 0.05, [40.0], [4e-3])
    return Device("two masses on a belt", "docs/export.md", True, chain)


def motion(device: Device) -> Motion:
    """Return how the command of the comparison moves a device."""
    u = command_for(device, SECONDS)
    trace = simulate(device, recorded(u), duration=u.size * device.interface.period).trace
    q, v = trace["position_m1"], trace["velocity_m1"]
    return Motion(
        rms(u), float(np.abs(u).max()), rms(v), float(np.std(q)), float(np.ptp(q)),
        float(np.abs(q).max()),
        (rms(q - trace["position_m2"]),),
    )  # fmt: skip


def rms(values: np.ndarray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def with_effect(name: str, moves: Motion) -> Device:
    """Return the device with an effect at the first of its places."""
    place = LIBRARY[name].places[0]
    device = base()
    if name in TABLES:
        by = {"free_spring": moves.position, "free_sensor": moves.position,
              "free_damper": moves.speed, "free_amplifier": moves.force}[name]  # fmt: skip
        to = moves.position if name == "free_sensor" else moves.force
        values = table_values([(s * by, f * to) for s, f in TABLES[name]])
        return device.with_physics(make_physics(name, place, **values))
    if name == "free_force":
        rows, columns = moves.position * np.array([-1.0, 0.0, 1.0]), [-moves.speed, moves.speed]
        values = grid_values(
            ["position", "velocity"],
            rows.tolist(),
            columns,
            moves.force * np.array([[0.2, 0.1], [0.1, 0.0], [-0.1, -0.3]]),
        )
        return device.with_physics(make_physics(name, place, **values))
    if name == "free_product":
        first = [(share * moves.speed, -0.1 * share * moves.force) for share in (-1.0, 0.0, 1.0)]
        second = [(-moves.position, 2.0), (0.0, 0.5), (moves.position, 1.0)]
        values = two_tables_values(["velocity", "position"], first, second)
        return device.with_physics(make_physics(name, place, **values))
    if name == "free_shift":
        first = [(share * moves.speed, -0.1 * share * moves.force) for share in (-1.0, 0.0, 1.0)]
        second = [(-moves.position, 0.2 * moves.speed), (0.0, 0.0), (moves.position, 0.0)]
        values = two_tables_values(["velocity", "position"], first, second)
        return device.with_physics(make_physics(name, place, **values))
    if name.startswith("servo_"):
        device = device.with_physics(servo(moves))
    if name == "position_servo":
        return device.with_physics(servo(moves))
    if name == "servo_limit":
        return device.with_physics(make_physics(name, place, limit=moves.force))
    if name == "servo_dead_zone":
        return device.with_physics(make_physics(name, place, half=0.05 * moves.position))
    if name == "servo_integral":
        return device.with_physics(make_physics(name, place, rate=5.0, limit=moves.force))
    if name == "goal_rate_limit":
        rate = moves.speed
        return device.with_physics(servo(moves), make_physics(name, place, rate=rate))
    if name == "falling_limit":
        slope = 0.5 * moves.force / moves.speed
        return device.with_physics(make_physics(name, place, limit=moves.force, slope=slope))
    if name == "open_winding":
        return device.with_physics(make_physics(name, place, damping=1e-3))
    if name == "rate_limit":
        rate = moves.force / 0.01
        return device.with_physics(make_physics(name, place, rate=rate))
    if name == "rectified_sensor":
        return device.with_physics(make_physics(name, place))
    found = sized(np.random.default_rng(1), name, place, device, moves, SHARE)
    if found is None:
        raise ValueError(f"{name} cannot be as large as {SHARE:g} of the motion")
    return device.with_physics(found)


def servo(moves: Motion) -> Physics:
    """Return a loop that turns the device about as far as the command alone does."""
    stiffness = moves.force / moves.position
    return make_physics("position_servo", "m1", stiffness=stiffness, damping=1e-2, back_emf=1e-3)


def cell(device: Device, to: str) -> str:
    """Return the error of a format over the motion, and whether the format reports a loss."""
    made = MAKERS[to](device)
    share = cost_of(made, device, to, "dev", SECONDS).share
    if share is None:
        return "runs away"
    said = percent(share) if share > 0.0 else "exact"
    return said if made.lost else f"**{said}**"


def page() -> str:
    """Return the page."""
    moves = motion(base())
    rows = ["| effect | C, FMU | MJCF | URDF | SDF |", "|---|---|---|---|---|"]
    chosen = {"none": base()} | {name: with_effect(name, moves) for name in LIBRARY}
    for name, device in chosen.items():
        one, *others = (cell(device, to) for to in MAKERS)
        if others[0] != one:
            one += f", {others[0]}"
        rows.append(f"| {name} | {' | '.join((one, *others[1:]))} |")
        print(rows[-1])
    return TEXT.replace("[[table]]", "\n".join(rows)).replace("[[seconds]]", f"{SECONDS:g}")


TEXT = """\
# What each format holds

Every effect is added to one device, two masses on a belt, with a size of about a tenth of the
command. Device and export follow the same command for [[seconds]] s; the table shows the rms of
their difference divided by the rms of the motion. **Bold**: the format claims to hold all of the
device. *Exact*: the same bits. Made by `python docs/make_export_page.py`.

[[table]]

URDF loses the belt in every row. All five formats hold a device of one mass with a
damper, dry friction and a limit within 1 %. Isaac Lab, Newton and BAM take one body, as URDF does.
"""


if __name__ == "__main__":
    with writing_as("make_export_page", True):
        write_text(PAGE, page())
