"""`zwidth mcp`, asked by the client of the protocol's own SDK over standard input and output."""

import json
import os
import sys
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from test_check import banded, bench, heavier, recorded, write_csv

from zwidth.sim.device_file import save_device
from zwidth.sim.physics import make_physics

mcp = pytest.importorskip("mcp", reason="the SDK is not installed; pip install zwidth[mcp]")
if not hasattr(mcp, "Client"):
    pytest.skip("the SDK is of before 2.0", allow_module_level=True)
import anyio  # noqa: E402  # pyright: ignore[reportMissingImports]


def asked(talk: Callable[[Any], Coroutine[Any, Any, Any]], folder: Path) -> Any:
    """Start the server in a folder, as a client does, and return what a talk with it gives."""
    from mcp.client.stdio import (  # pyright: ignore[reportMissingImports]
        StdioServerParameters,
        stdio_client,
    )

    async def session() -> Any:
        program = StdioServerParameters(
            command=sys.executable, args=["-m", "zwidth", "mcp"], cwd=folder,
            env=dict(os.environ),
        )  # fmt: skip
        async with (
            stdio_client(program) as (reads, writes),
            mcp.ClientSession(reads, writes) as client,
        ):
            await client.initialize()
            return await talk(client)

    return anyio.run(session)


def answer(result: Any) -> dict[str, Any]:
    """The object in a result."""
    return json.loads(result.content[0].text)


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    save_device(banded(), tmp_path / "bench.toml")
    save_device(bench().without_physics("stribeck_friction"), tmp_path / "rough.toml")
    write_csv(tmp_path / "good.csv", recorded(bench(), 70).between(0.0, 3.0))
    write_csv(tmp_path / "bad.csv", recorded(heavier(bench()), 71).between(0.0, 3.0))
    return tmp_path


def test_an_agent_sees_four_tools_and_is_told_what_they_are_for(rig: Path):
    async def talk(client: Any) -> Any:
        return (await client.list_tools()).tools

    tools = {tool.name: tool for tool in asked(talk, rig)}
    assert set(tools) == {"diagnose", "check", "plan", "boundary"}
    assert all(len(tool.description) > 100 for tool in tools.values())


def test_a_check_answers_and_bad_input_is_one_sentence(rig: Path):
    """Mutation: what the command prints written into the protocol."""

    async def talk(client: Any) -> Any:
        lines = (
            {"device": "bench.toml", "recordings": ["good.csv"]},
            {"device": "bench.toml", "recordings": ["bad.csv"]},
            {"device": "none.toml", "recordings": ["good.csv"]},
            {"device": "bench.toml", "recordings": ["--diagnose"]},
        )
        return [await client.call_tool("check", line) for line in lines]

    good, bad, none, odd = asked(talk, rig)
    assert answer(good)["status"] == 0
    assert answer(good)["within"] is True
    assert answer(bad)["status"] == 1
    assert "the inertia m1 +5 %" in answer(bad)["sentence"]
    assert none.is_error
    assert "neither a file nor a shipped device" in none.content[0].text
    assert "--diagnose does not exist" in odd.content[0].text  # a name, and never an option


def test_a_diagnosis_names_what_is_missing_and_where_its_report_is(rig: Path):
    """Of a short recording of a rotor that rubs."""
    plain = bench().without_physics("gravity_pendulum", "stribeck_friction")
    rubs = plain.with_physics(make_physics("coulomb_friction", "m1", level=0.03))
    save_device(plain, rig / "rough.toml")
    write_csv(rig / "rubs.csv", recorded(rubs, 70).between(0.0, 3.0))

    async def talk(client: Any) -> Any:
        line = {"recordings": ["rubs.csv"], "device": "rough.toml", "effort": "quick"}
        wall = {"device": "phantom_1_0", "delay_ms": [2], "damping": [0.0, 0.01]}
        return (
            await client.call_tool("diagnose", line), await client.call_tool("boundary", wall),
        )  # fmt: skip

    found, wall = map(answer, asked(talk, rig))
    assert found["verdict"] == "identified"
    assert [f["effect"] for f in found["findings"]] == ["coulomb_friction"]
    assert (rig / found["report"]).is_file()
    assert (rig / found["augmented_device"]).is_file()
    (one,) = wall["boundaries"]
    assert one["delay_s"] == 0.002
    assert [point["damping"] for point in one["points"]] == [0.0, 0.01]


def test_a_plan_names_the_files_that_it_wrote(rig: Path):
    """Mutation: the files left out of the JSON of the command."""

    async def talk(client: Any) -> Any:
        line = {"device": "rough.toml", "seconds": 1.0, "noise": 1e-4}
        return await client.call_tool("plan", line)

    found = answer(asked(talk, rig))
    assert found["status"] == 0
    assert [one["excitation"] for one in found["plans"]]
    files = [rig / file for file in found["files"]]
    assert all(file.is_file() for file in files)
    assert {".toml", ".npy", ".png"} <= {file.suffix for file in files}
