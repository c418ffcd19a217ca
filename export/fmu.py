"""A device as an FMU 3.0 for co-simulation: the C export with parameters that may be set.

The archive has the description, the sources with FMI's headers and, if there is a C compiler, the
binary for this machine. fmpy provides the headers and builds the binary (with CMake).
"""

import io
import os
import shutil
import subprocess
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from zwidth.export.c_source import c_source, settable_source
from zwidth.export.compiled import compiler
from zwidth.export.description import TOKEN, Variables, build_description, description
from zwidth.export.model import Exported, Floats
from zwidth.export.settable import Number, numbers_of, units
from zwidth.export.translate import literal
from zwidth.files.protection import reading
from zwidth.files.whole import write_bytes
from zwidth.sim.device import Device
from zwidth.sim.physics.points import of_points

HEADERS = ("fmi3PlatformTypes.h", "fmi3FunctionTypes.h", "fmi3Functions.h")
NEEDS = "writing an FMU needs fmpy, which is not installed; pip install 'zwidth[fmu]'"
EPOCH = (1980, 1, 1, 0, 0, 0)  # of all files in the archive: equal devices give equal bytes


@dataclass(frozen=True)
class Fmu(Exported):
    """An FMU. body: its C source; description: of the model, as XML; name: its identifier."""

    description: str = ""
    name: str = ""

    @cached_property
    def binary(self) -> tuple[str, bytes] | str:
        """The path in the archive and the bytes of the library built here, or why there is none."""
        if os.name != "nt" and compiler() is None:
            return "there is no C compiler here (cc, gcc or clang)"
        with TemporaryDirectory() as folder:
            root = Path(folder)
            for path, content in self._files("").items():
                write_bytes(root / path, content, wait=False, own=True)
            return _built(root)

    def content(self, cost: str = "") -> bytes:
        """Return the archive's bytes; cost: a sentence on how well it matches the device."""
        stream = io.BytesIO()
        files = self._files(cost)
        if not isinstance(self.binary, str):
            path, library = self.binary
            files[path] = library
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for path, content in files.items():
                archive.writestr(_entry(path), content)
        return stream.getvalue()

    def _files(self, cost: str) -> dict[str, bytes]:
        headers = _module().__file__
        folder = Path(str(headers)).parent / "c-code"
        lines = [*self.about, "", "Not held here:", *(self.lost or ("nothing",)), "", cost]
        page = "".join(f"<p>{escape(line)}</p>\n" for line in lines if line)
        return {
            "modelDescription.xml": self.description.encode(),
            "sources/buildDescription.xml": build_description(self.name).encode(),
            f"sources/{self.name}.c": self.text(cost).encode(),
            **{f"sources/{h}": reading(folder / h).read_bytes() for h in HEADERS},
            "documentation/index.html": f"<!doctype html>\n{page}".encode(),
        }


def fmu(device: Device, name: str, seed: int = 0) -> Fmu:
    """Return a device as an FMU of this name. seed: of random events.

    Raises ValueError without fmpy.
    """
    _module()
    plain = c_source(device, name, seed)
    kept = plain.held
    source, settings = settable_source(kept, name, seed)
    constants = _constants(kept, {s.name for s in settings})
    face, (force, length) = kept.interface, units(kept)
    variables = Variables(force, length, _states(kept), constants, settings)
    wrapper = reading(Path(__file__).with_name("fmu.c")).read_text(encoding="utf-8")
    tables = "\n".join([
        f"enum {{ STATES = {2 * kept.plant().dof}, CONSTANTS = {len(constants)},"
        f" SETTINGS = {len(settings)} }};",
        f"#define PERIOD {literal(face.period)}",
        f'#define TOKEN "{TOKEN}"',
        _table("zwidth_constants", [c.value for c in constants]),
        _table("zwidth_lower", [s.lower for s in settings]),
        _table("zwidth_upper", [s.upper for s in settings]),
    ])  # fmt: skip
    body = f"{source}\n{tables}\n{wrapper.replace('NAME', name)}"
    about = (
        f"{device.name}, exported by zwidth as an FMU 3.0 for co-simulation.",
        "",
        f"'command' [{force}] is held over each sampling period of {face.period:.9g} s, of which"
        f" every step is a multiple; 'measured' [{length}] is what the encoder reads at its end."
        " Parameters may be set before the run and in it; masses, springs and dampers are fixed.",
    )
    made = Fmu(body, about, plain.lost, kept, "/*", "*/", name=name)
    text, token = description(device.name, name, about[2], face.period, variables, body)
    return replace(made, description=text, body=body.replace(TOKEN, token))


def run_fmu(content: bytes, commands: Floats, settings: dict[str, float] | None = None) -> Floats:
    """Return the measured positions of an FMU of zwidth under commands (ticks,), run by fmpy.

    settings: parameters by name. Raises ValueError without fmpy, and fmpy's exceptions.
    """
    fmpy = _module()
    with TemporaryDirectory() as folder:
        archive = write_bytes(Path(folder) / "device.fmu", content, wait=False, own=True)
        unzipped = fmpy.extract(str(archive), str(Path(folder) / "unzipped"))
        told = fmpy.read_model_description(unzipped)
        at = {v.name: v.valueReference for v in told.modelVariables}
        slave = import_module("fmpy.fmi3").FMU3Slave(
            guid=told.guid, unzipDirectory=unzipped, instanceName="one",
            modelIdentifier=told.coSimulation.modelIdentifier,
        )  # fmt: skip
        slave.instantiate()
        try:
            for name, value in (settings or {}).items():
                slave.setFloat64([at[name]], [value])
            period = float(told.coSimulation.fixedInternalStepSize)
            return _driven(slave, at, commands, period)
        finally:
            slave.freeInstance()


def _driven(slave: Any, at: dict[str, int], commands: Floats, period: float) -> Floats:
    slave.enterInitializationMode(startTime=0.0)
    slave.exitInitializationMode()
    measured = np.empty(commands.size)
    for k, command in enumerate(commands.tolist()):
        (measured[k],) = slave.getFloat64([at["measured"]])
        slave.setFloat64([at["command"]], [command])
        slave.doStep(currentCommunicationPoint=k * period, communicationStepSize=period)
    slave.terminate()
    return measured


def fmi() -> Any:
    """Return the module fmpy; None if it is not installed."""
    try:
        return import_module("fmpy")
    except ImportError:
        return None


def _module() -> Any:
    found = fmi()
    if found is None:
        raise ValueError(NEEDS)
    return found


def _built(root: Path) -> tuple[str, bytes] | str:
    """Build the library in an unpacked FMU; return its path and bytes, or an error message."""
    cmake = shutil.which("cmake") or shutil.which("cmake", path=_folder_of_cmake())
    if cmake is None:
        return "there is no CMake here"
    build = import_module("fmpy.build")
    with TemporaryDirectory() as made:
        options = {"CMAKE_C_FLAGS:STRING": "" if os.name == "nt" else "-ffp-contract=off"}
        build.create_cmake_settings(root, Path(made), cmake_options=options)
        source = Path(str(build.__file__)).parent / "c-code"
        for line in (
            [cmake, "-S", str(source), "-B", made],
            [cmake, "--build", made, "--target", "install", "--config", "Release"],
        ):
            ran = subprocess.run(line, capture_output=True, text=True, check=False)
            if ran.returncode != 0:
                said = (ran.stderr.strip() or ran.stdout.strip()).splitlines()
                return f"CMake fails: {said[0][:200] if said else ran.returncode}"
    library = next(
        p for p in (root / "binaries").rglob("*") if p.suffix in (".so", ".dll", ".dylib")
    )
    return library.relative_to(root).as_posix(), library.read_bytes()


def _folder_of_cmake() -> str:
    try:
        return str(import_module("cmake").CMAKE_BIN_DIR)
    except (ImportError, AttributeError):
        return ""


def _entry(path: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(path, EPOCH)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    return entry


def _table(name: str, values: Sequence[float]) -> str:
    return f"static const double {name}[] = {{{', '.join(literal(v) for v in values)}}};"


def _states(device: Device) -> list[Number]:
    """Return positions and velocities, including extra modes, in the kernel's order."""
    (_, length), n = units(device), device.plant().dof
    return [Number(f"position_m{i + 1}", 0.0, length) for i in range(n)] + [
        Number(f"velocity_m{i + 1}", 0.0, f"{length}/s") for i in range(n)
    ]


def _constants(device: Device, settable: set[str]) -> list[Number]:
    """Return the numbers of a device that its FMU shows as constants."""
    chain, face, (force, length) = device.chain, device.interface, units(device)
    mass = "kg m2" if device.rotary else "kg"
    spring, damper = f"{force}/{length}", f"{force} s/{length}"
    found = [Number(f"chain.mass_m{i + 1}", v, mass) for i, v in enumerate(chain.masses.tolist())]
    found += [
        Number(f"chain.damper_m{i + 1}", v, damper)
        for i, v in enumerate(chain.ground_dampers.tolist())
    ]
    found.append(Number("chain.ground_spring", float(chain.ground_spring), spring))
    for i, (k, b) in enumerate(zip(chain.link_springs, chain.link_dampers, strict=True)):
        link = f"link{i + 1}{i + 2}"
        found += [Number(f"chain.spring_{link}", float(k), spring),
                  Number(f"chain.damper_{link}", float(b), damper)]  # fmt: skip
    found.append(Number("interface.period", face.period, "s"))
    found.append(Number("interface.delay", face.delay, "s"))
    for p in device.physics:
        if not of_points(p.effect.parameters) and p.effect.in_interface is None:
            found += [n for n in numbers_of(p, device.rotary) if n.name not in settable]
    return found
